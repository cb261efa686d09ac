"""A testbed's tick as one function: motors, equations of motion and sensors, as Bench has them."""

import numpy as np

from flexslew_plant.arrays import EMPTY, Vector
from flexslew_plant.bench.divergence import integration_of
from flexslew_plant.bench.records import BenchSettings
from flexslew_plant.bench.retarget import with_schedule
from flexslew_plant.errors import BadInput
from flexslew_plant.hardware.actuator import minimum_impulse, motor_numbers
from flexslew_plant.hardware.friction import friction_of
from flexslew_plant.hardware.motor_step import drive_motors
from flexslew_plant.hardware.sensor_step import add_errors
from flexslew_plant.hardware.sensors import Readings, channel_bounds, exact_readings, sensor_numbers
from flexslew_plant.hardware.spin_limits import spin_limits_of
from flexslew_plant.testbeds import initial_state
from flexslew_plant.testbeds.instruments import channels


class PlantTick:
    """The tick of a testbed with its motors and sensors.

    Args:
        settings: of the bench, whose sensors are without noise; see noise_free.

    Attributes:
        x: state.
        motors: what the motors hold, see drive_motors.
        instruments: memory of all instruments, one after another.
        seen: their last readings, among all tips, shape (tips,).

    Raises:
        BadInput: it has friction.
    """

    def __init__(self, settings: BenchSettings) -> None:
        testbed, period = with_schedule(settings.testbed, settings.schedule), settings.period
        self.model = model = testbed.model()
        if friction_of(settings.actuator, model, period) is not None:
            words = "friction is solved for until it converges, which is not written out; give 0.0"
            raise BadInput(words, key="actuator")
        limit, names = np.array(settings.testbed.effort_limit, dtype=float), model.joint_names
        impulse = minimum_impulse(settings.actuator, names, limit, period)
        given = settings.actuator, limit, period, impulse, model.one_way
        self.motor_numbers = motor_numbers(*given)
        self.wheel_limits = spin_limits_of(model, period)
        self.errors, self.period = sensor_numbers(settings.sensors, model), period
        self.no_noise = np.zeros(self.errors.noise.size)
        self.bounds = channel_bounds(model.joints, len(model.appendages.names))
        self.x: Vector = initial_state(settings.testbed)
        given_steps = settings.integration_steps
        place = model.split(self.x)[0], period, settings.duration, given_steps
        self.steps = integration_of(model, *place).steps
        self.motors = np.zeros((3, model.joints))
        rng = np.random.default_rng(0)  # no draw counts
        self._readers = [
            (channels(one), one.reader(period, rng)) for one in model.appendages.instruments
        ]
        self.instruments = np.concatenate((EMPTY, *(r.memory for _, r in self._readers)))
        self.seen = np.zeros(len(model.appendages.names))
        self._read_instruments(0)

    def step(self, time: float, demand: Vector, disturbance: Vector) -> tuple[Readings, Vector]:
        """Return the readings at the end of a tick, and the effort that acted in it.

        Args:
            time: at the start of the tick [s].
            demand: of the motors, shape (joints,) [N m or N].
            disturbance: that acts beside the motors, shape (joints,) [N m or N].
        """
        model, memory, effort = self.model, self.motors.copy(), np.empty(demand.size)
        drive_motors(self.motor_numbers, demand, memory, effort)
        self.motors = memory
        if self.wheel_limits is not None:
            effort = self.wheel_limits.apply(effort, self.x)
        total = effort + disturbance
        x = model.apply_impulse(self.x, 0.5 * self.period, time)
        x = model.advance(x, total, self.period, self.steps, time)
        self.x = model.apply_impulse(x, -0.5 * self.period, time + self.period)
        self._read_instruments(int(np.rint(time / self.period)) + 1)
        return self.readings(total, time + self.period), effort

    def _read_instruments(self, tick: int) -> None:
        """Let every instrument read at a tick, in order from 0 on."""
        platform = self.model.appendages.body
        if platform is None:
            return
        memory, seen, end = self.instruments.copy(), self.seen.copy(), 0
        body = np.concatenate(platform(self.x))
        for where, reader in self._readers:
            start, end = end, end + reader.memory.size
            no_draws = np.zeros(reader.uniform + reader.normal)
            read, constants = reader.read, reader.constants
            read(tick, constants, body, no_draws, memory[start:end], seen[where])
        self.instruments, self.seen = memory, seen

    def readings(self, effort: Vector, time: float) -> Readings:
        """Return the readings at a time [s] after a tick with this effort."""
        exact = exact_readings(self.model, self.x, effort, time)
        values = np.concatenate((exact[0], exact[1], exact[2], exact[3]))
        if self.errors.place.size:
            add_errors(self.errors, self.no_noise, values)
        a, b, c, d, e = self.bounds
        tips = values[c:d].copy()
        for where, _ in self._readers:
            tips[where] = self.seen[where]
        return Readings(values[a:b], values[b:c], tips, values[d:e])
