"""The bench without ROS: the testbed, its motors, sensors and drive, tick by tick.

One tick is one question and one answer: read `question`, `offer` commands until one is taken,
then `advance`. Advancing without an answer is a missed tick.
"""

from collections import deque
from math import inf
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from flexslew_plant import dynamics
from flexslew_plant.actuator import Actuator, ActuatorSettings
from flexslew_plant.appendages import appendages_of
from flexslew_plant.arrays import Vector
from flexslew_plant.csa import CsaTestbed
from flexslew_plant.drive import Drive
from flexslew_plant.errors import BadInput
from flexslew_plant.events import Event, Level
from flexslew_plant.measurement import EffortCommand, Measurement
from flexslew_plant.schedule import Schedule
from flexslew_plant.sensors import Readings, Sensors, SensorSettings
from flexslew_plant.settings import NonNegative, Positive, section
from flexslew_plant.testbeds import Testbed, build_model


@section
class BenchSettings:
    """Everything that determines the trajectory, but for the answers."""

    testbed: Testbed = CsaTestbed()
    period: Positive = 0.01  # one tick [s]
    duration: NonNegative = 0.0  # [s]; 0: until somebody stops it
    seed: Annotated[int, Field(ge=0)] = 1  # of the sensors' noise
    actuator: ActuatorSettings = ActuatorSettings()
    sensors: SensorSettings = SensorSettings()
    active: str = "pd_feedforward"  # who is in charge at the start
    fallback: tuple[str, ...] = ()  # who takes over in turn
    max_missed: Annotated[int, Field(ge=1)] = 5  # ticks in a row without a valid answer
    brake_damping_ratio: Positive = 0.25  # brake = ratio M_jj omega_1, omega_1 the first free mode
    schedule: Schedule = ()


class Truth(NamedTuple):
    """The state at a tick; see flexslew_msgs/PlantState."""

    tick: int
    time: float
    epoch: int
    position: Vector
    velocity: Vector
    applied_effort: Vector
    disturbance: Vector
    tip_deflection: Vector
    energy: float


class SwitchRequest(NamedTuple):
    """Give the bench to a controller at a tick."""

    controller: str
    tick: int
    strict: bool = False
    max_effort_step: float = inf  # [N m or N]


class SwitchResult(NamedTuple):
    """What became of a request."""

    request: SwitchRequest
    ok: bool
    message: str
    tick: int
    effort_step: Vector  # (joints,) [N m or N]; zero if refused


class Bench:
    """The tick machine.

    Args:
        settings: a trial's plant.

    Raises:
        BadInput: a schedule entry names a joint that the testbed does not have.
    """

    def __init__(self, settings: BenchSettings) -> None:
        self.settings = settings
        self.model = build_model(settings.testbed)
        self.appendages = appendages_of(settings.testbed)
        self.limit: Vector = np.array(settings.testbed.effort_limit, dtype=float)
        joints = [getattr(settings.testbed.initial, name) for name in self.model.joint_names]
        rest = np.concatenate((joints, np.zeros(self.model.modes)))  # straight appendages
        self._start = np.concatenate((rest, np.zeros(rest.size)))
        free = self.model.linearise(rest)
        brake = settings.brake_damping_ratio * free.frequencies[0] * np.diag(free.mass)
        self.drive = Drive(
            settings.active, settings.fallback, settings.max_missed, brake[: self.model.joints]
        )
        self.actuator = Actuator(settings.actuator, self.limit, settings.period)
        self.last_tick = round(settings.duration / settings.period) if settings.duration else None
        self._disturbances = [self._disturbance(entry) for entry in settings.schedule]
        self.epoch = -1
        self.reset()

    def reset(self) -> None:
        """Return to tick 0 in a new epoch."""
        self.epoch += 1
        self.tick = 0
        self.drive.reset()
        self.actuator.reset()
        self.saturated_ticks = 0
        self.faulted = False  # a controller had to be replaced
        self._sensors = Sensors(
            self.settings.sensors, np.random.default_rng([self.settings.seed, self.epoch])
        )
        self._x: Vector = self._start
        self._applied: Vector = np.zeros(self.model.joints)
        self._extra: Vector = np.zeros(self.model.joints)  # disturbance during the last tick
        self._answer: Vector | None = None
        self._handover: tuple[SwitchRequest, str] | None = None
        self.events: deque[Event] = deque()
        self.switch_results: deque[SwitchResult] = deque()
        ticks = [self._tick_of(entry.at) for entry in self.settings.schedule]
        self._switches = [
            SwitchRequest(entry.switch, tick)
            for entry, tick in zip(self.settings.schedule, ticks, strict=True)
            if entry.switch is not None
        ]
        self._ask()

    @property
    def time(self) -> float:
        """Simulated time of the tick [s]."""
        return self.tick * self.settings.period

    @property
    def done(self) -> bool:
        """The duration is over."""
        return self.last_tick is not None and self.tick >= self.last_tick

    @property
    def answered(self) -> bool:
        """A valid answer to the question is held, or none is needed because the brake is on."""
        return self._answer is not None or not self.drive.active

    def truth(self) -> Truth:
        """Return the state at this tick."""
        n = self.model.coordinates
        q = self._x[:n]
        return Truth(
            self.tick,
            self.time,
            self.epoch,
            q,
            self._x[n:],
            self._applied,
            self._extra,
            self.appendages.tip @ q[self.model.joints :],
            dynamics.energy(self.model.kind, self.model.packed, self._x, self.model.joints),
        )

    def offer(self, command: EffortCommand) -> bool:
        """Return whether the command was taken as the answer; a second answer is not needed."""
        objection = self.drive.objection(self.question, command)
        if objection is not None:
            kind, words = objection
            count = self.drive.rejected[kind]
            if count & (count - 1) == 0:  # the 1st, 2nd, 4th, 8th, ...: a flood stays readable
                self._event(
                    Level.WARNING,
                    "rejected",
                    f"effort command rejected ({kind}): {words}; {count} so far",
                    {"reason": kind, "count": count, "controller": command.controller},
                )
            return False
        if self._answer is not None:
            return False
        if self._handover is not None and not self._finish_handover(command.effort):
            return False
        self._answer = command.effort
        return True

    def advance(self) -> None:
        """Integrate [t_k, t_k+1) with the answer, or with the last one if there is none."""
        if self._answer is not None:
            self.drive.take(self._answer)
        elif self.drive.active:
            self._miss()
        n, m, period = self.model.coordinates, self.model.joints, self.settings.period
        velocity = self._x[n : n + m]
        self._applied = self.actuator.apply(self.drive.effort(velocity))
        self.saturated_ticks += self.actuator.saturated
        self._extra = self._disturbance_at(self.tick)
        total = self._applied + self._extra
        friction = self.actuator.friction(velocity)
        if friction is not None:
            total = total + friction
        self._x = self.model.advance(self._x, total, period)
        if not np.isfinite(self._x).all():
            raise FloatingPointError(f"the state is not finite after tick {self.tick}")
        self.tick += 1
        self._ask()

    def request_switch(self, request: SwitchRequest) -> str | None:
        """Schedule a switch; return why it is refused, or None."""
        if request.tick <= self.tick:
            request = request._replace(tick=self.tick + 1)
        if any(other.tick == request.tick for other in self._switches):
            return f"another switch is already due at tick {request.tick}"
        if request.controller == self.drive.active and not self._switches:
            return f"{request.controller} is already in charge"
        self._switches.append(request)
        return None

    def _tick_of(self, time: float) -> int:
        return round(time / self.settings.period)

    def _ask(self) -> None:
        for request in [r for r in self._switches if r.tick <= self.tick]:
            self._switches.remove(request)
            if request.controller != self.drive.active:
                self._handover = request, self.drive.active
                self.drive.hand_over(request.controller)
        self._answer = None
        n, m = self.model.coordinates, self.model.joints
        modes = self._x[m:n]
        readings = self._sensors.read(
            Readings(
                self._x[:m],
                self._x[n : n + m],
                self.appendages.tip @ modes,
                self.appendages.curvature @ modes,
            )
        )
        self.question = Measurement(
            self.tick, self.epoch, self.time, self.drive.active, *readings, self._applied
        )

    def _finish_handover(self, effort: Vector) -> bool:
        """Measure the step of the incoming controller; give the bench back if it is too large."""
        assert self._handover is not None
        (request, outgoing), self._handover = self._handover, None
        step = effort - self._applied
        largest = float(np.abs(step).max())
        ok = not (request.strict and largest > request.max_effort_step)
        data = {
            "from": outgoing,
            "to": request.controller,
            "effort_step": step.tolist(),
        }
        if ok:
            words = f"{outgoing or 'brake'} -> {request.controller}, effort step {largest:.3g}"
            self._event(Level.INFO, "switched", words, data)
        else:
            words = (
                f"switch to {request.controller} refused: its effort would step by {largest:.3g}, "
                f"max_effort_step is {request.max_effort_step:.3g}"
            )
            self._event(Level.WARNING, "switch_refused", words, data)
            self.drive.hand_over(outgoing)
            self.question = self.question._replace(controller=outgoing)
            step = np.zeros_like(step)
        self.switch_results.append(SwitchResult(request, ok, words, self.tick, step))
        return ok

    def _miss(self) -> None:
        if self._handover is not None:  # the incoming controller never answered
            self._handover = None
        silent = self.drive.active
        successor = self.drive.miss()
        row = self.drive.missed_in_a_row
        self._event(
            Level.WARNING,
            "missed",
            f"no valid answer from {silent}, last effort held ({row} in a row)",
            {"controller": silent, "in_a_row": row},
        )
        if successor is None:
            return
        self.drive.hand_over(successor)
        self.faulted = True
        self._event(
            Level.FAULT,
            "fallback" if successor else "brake",
            f"{silent} is silent: {successor or 'the brake'} takes over",
            {"from": silent, "to": successor},
        )

    def _disturbance(self, entry: object) -> tuple[int, float, Vector] | None:
        """Return the first tick, the end tick and the effort on each joint of an entry."""
        wanted = getattr(entry, "disturbance", None)
        if wanted is None:
            return None
        names = self.model.joint_names
        for name in wanted:
            if name not in names:
                raise BadInput(
                    f"schedule: disturbance: {name} is not a joint of the testbed; "
                    f"allowed: {', '.join(names)}"
                )
        effort = np.array([wanted.get(name, 0.0) for name in names], dtype=float)
        until = getattr(entry, "until", None)
        start = self._tick_of(getattr(entry, "at", 0.0))
        return start, inf if until is None else self._tick_of(until), effort

    def _disturbance_at(self, tick: int) -> Vector:
        total = np.zeros(self.model.joints)
        for entry in self._disturbances:
            if entry is None:
                continue
            start, end, effort = entry
            if start <= tick < end:
                total = total + effort
            if tick in (start, end):
                word = "on" if tick == start else "off"
                values = dict(zip(self.model.joint_names, effort.tolist(), strict=True))
                self._event(Level.INFO, "disturbance", f"disturbance {word}: {values}", values)
        return total

    def _event(self, level: Level, kind: str, message: str, data: dict[str, object]) -> None:
        self.events.append(
            Event(self.tick, self.time, self.epoch, level, "plant", kind, message, dict(data))
        )
