"""The error sources of a trial, each as what it adds to the pointing error by the linear loop."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from flexslew_control.analysis.signals import CHANNELS
from flexslew_lab.budget.closed_loop import ErrorInputs, ErrorLoop, response_to
from flexslew_lab.budget.contribution import Contribution, fixed_parts, noise_parts
from flexslew_lab.budget.error_free import without_imbalance, without_orbit
from flexslew_lab.budget.windows import Windows
from flexslew_lab.trial.trial import Trial
from flexslew_plant.arrays import Matrix
from flexslew_plant.bench.schedule import ScheduleEntry
from flexslew_plant.errors import BadInput
from flexslew_plant.hardware.disturbances import TimedDisturbance, disturbance_effort
from flexslew_plant.hardware.sensors import Readings
from flexslew_plant.testbeds import Testbed
from flexslew_plant.testbeds.instruments import (
    Gyro,
    Resolver,
    StarTracker,
    SunSensor,
    Tachometer,
)

_WHITE = "white noise of every tick, by the linear loop"
_CONSTANT = "constant, by the linear loop"


class ObservedLoop(NamedTuple):
    """What sources act on.

    Args:
        trial: of the budget.
        loop: of its errors.
        windows: that are observed.
    """

    trial: Trial
    loop: ErrorLoop
    windows: Windows

    @property
    def ticks(self) -> int:
        """Number of ticks with a truth."""
        return self.windows.last + 1

    def noise(self, name: str, kind: str, about: str, inputs: ErrorInputs) -> Contribution:
        """Return the part of white noises, their standard deviations in the inputs."""
        variances = self.windows.of_noise(self.loop.responses(inputs, self.ticks))
        return Contribution(name, kind, about, noise_parts(self.loop.named(variances)))

    def constant(self, name: str, kind: str, about: str, inputs: ErrorInputs) -> Contribution:
        """Return the part of constants, their sizes in the inputs."""
        together = inputs.times(np.ones((inputs.columns.shape[1], 1)))
        error = np.cumsum(self.loop.responses(together, self.ticks)[:, :, 0], axis=0)
        return self.error(name, kind, about, error)

    def error(self, name: str, kind: str, about: str, error: Matrix) -> Contribution:
        """Return the part of an error, the same in every member, shape (ticks, outputs)."""
        return Contribution(name, kind, about, fixed_parts(self.metrics(error)))

    def metrics(self, error: Matrix) -> dict[str, Matrix]:
        """Return the metrics of errors of pointing, and of knowledge if there are such columns."""
        return self.loop.named(self.windows.of_series(error))


def channel_signals(at: ObservedLoop, key: str, word: str) -> tuple[str, ...]:
    """Return the signals of a channel of Readings, word of signals.CHANNELS first."""
    model = at.loop.point.rest.model
    names = model.joint_names if key.startswith("joint") else model.appendages.names
    return tuple(f"{word}.{name}" for name in names)


def sensor_sources(at: ObservedLoop) -> Iterator[Contribution]:
    """Yield noises and biases of the sensors of the trial and of single tips."""
    for key, word in zip(Readings._fields, CHANNELS, strict=True):
        errors = getattr(at.trial.sensors, key)
        inputs = at.loop.signal_inputs(channel_signals(at, key, word))
        sizes = np.tile([errors.noise, errors.bias], (inputs.columns.shape[1], 1)).T
        yield from _reading_errors(at, f"sensors.{key}", inputs, sizes)
    if (single := at.loop.point.rest.model.appendages.errors) is not None:
        inputs = at.loop.signal_inputs(channel_signals(at, "tip_deflection", "tip"))
        yield from _reading_errors(at, "testbed.sensors", inputs, single[:2])


def _reading_errors(
    at: ObservedLoop, name: str, inputs: ErrorInputs, sizes: Matrix
) -> Iterator[Contribution]:
    """Yield errors of a channel; sizes: noise and bias of each reading, shape (2, readings)."""
    noise, bias = sizes
    unread = "" if inputs.columns.any() else "; the law does not read it"
    if noise.any():
        yield at.noise(f"{name}.noise", "noise", _WHITE + unread, inputs.times(noise))
    if bias.any():
        yield at.constant(f"{name}.bias", "bias", _CONSTANT + unread, inputs.times(bias))


def instrument_sources(at: ObservedLoop) -> Iterator[Contribution]:
    """Yield noises of instruments, of gyro and star tracker through the filter's settled gains.

    Biases of gyros decay with the gains of its start: see flown_sources.gyro_bias_sources.

    Raises:
        BadInput: if a Sun sensor has noise; instruments before it have been yielded.
    """
    model, period = at.loop.point.rest.model, at.trial.period
    tips = model.appendages.names
    for one in model.appendages.instruments:
        count = 3 if isinstance(one, StarTracker) else len(one.axes)  # of its quaternion: a turn
        read = tips[one.first : one.first + count]
        inputs = at.loop.signal_inputs(tuple(f"tip.{name}" for name in read))
        place = f"testbed.sensors.{one.name}"
        if isinstance(one, Gyro):
            yield from _gyro_errors(at, one, place, inputs)
        elif isinstance(one, StarTracker):
            sizes, axes = np.linalg.eigh(one.covariance)
            share = (1.0 - one.settings.dropout) / max(1, round(one.settings.interval / period))
            root = axes * np.sqrt(np.maximum(sizes, 0.0) / share)
            if root.any():
                words = "white, readings of every tick with as much information; by the linear loop"
                yield at.noise(f"{place}.noise", "noise", words, inputs.times(root))
        elif isinstance(one, Tachometer | Resolver) and one.settings.noise:
            noise = inputs.times(one.settings.noise * np.ones(count))
            yield at.noise(f"{place}.noise", "noise", _WHITE, noise)
        elif isinstance(one, SunSensor) and one.settings.noise:
            raise BadInput(f"the noise of {place} is not taken through the attitude filter")


def _gyro_errors(
    at: ObservedLoop, one: Gyro, place: str, inputs: ErrorInputs
) -> Iterator[Contribution]:
    s, period, w = one.settings, at.trial.period, at.windows
    white = s.angle_random_walk / np.sqrt(period)
    if white:
        yield at.noise(
            f"{place}.angle_random_walk", "noise", _WHITE, inputs.times(white * np.ones(3))
        )
    responses = at.loop.responses(inputs, at.ticks)
    if walk := s.rate_random_walk * np.sqrt(period):
        # the mean of a tick: half of its own step, and an independent part of variance 1 / 12
        steps = np.cumsum(responses, axis=0) - 0.5 * responses
        variances = w.of_noise(np.concatenate((steps, responses / np.sqrt(12.0)), axis=2) * walk)
        words = "random walk from tick 0 on, by the linear loop"
        yield Contribution(
            f"{place}.rate_random_walk", "noise", words, noise_parts(at.loop.named(variances))
        )


def disturbance_sources(at: ObservedLoop) -> Iterator[Contribution]:
    """Yield disturbances of the schedule."""
    for number, entry in enumerate(at.trial.schedule):
        if entry.disturbance is not None:
            series = _disturbance_series(at, entry)
            error = response_to(at.loop.responses(at.loop.effort_inputs(), at.ticks), series)
            words = "efforts of all ticks, by the linear loop"
            yield at.error(f"schedule.{number}.disturbance", "torque", words, error)


def _disturbance_series(at: ObservedLoop, entry: ScheduleEntry) -> Matrix:
    """Return the efforts of an entry by tick, shape (ticks, efforts) [N m or N]."""
    assert entry.disturbance is not None
    names, period = at.loop.point.rest.model.joint_names, at.trial.period
    end = np.inf if entry.until is None else round(entry.until / period)
    timed = TimedDisturbance(entry.disturbance, round(entry.at / period), end)
    return np.array([
        disturbance_effort(timed, k, names, period) if timed.start <= k < end
        else np.zeros(len(names)) for k in range(at.ticks)
    ])  # fmt: skip


def outside_sources(at: ObservedLoop, states: Matrix) -> Iterator[Contribution]:
    """Yield torques of the orbit and forces of unbalanced wheels along an error-free flight.

    Args:
        at: what they act on.
        states: of the flight, shape (ticks, size of a state).
    """
    testbed = at.trial.testbed
    for name, kind, single in (
        ("testbed.orbit", "torque", without_imbalance(testbed)),
        ("testbed.wheels", "imbalance", without_orbit(testbed)),
    ):
        forces = _outside_series(at, single, states)
        if forces is not None and forces.any():
            error = response_to(at.loop.responses(at.loop.force_inputs(), at.ticks), forces)
            words = "forces along the error-free flight, by the linear loop"
            yield at.error(name, kind, words, error)


def _outside_series(at: ObservedLoop, testbed: Testbed, states: Matrix) -> Matrix | None:
    """Return the mean generalised force of every tick, shape (ticks, n); None: there is none."""
    outside, period = testbed.model().outside, at.trial.period
    if outside is None:
        return None
    return np.array([outside(x, k * period, period) for k, x in enumerate(states)])
