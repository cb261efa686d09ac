"""Whether the innovations of an estimator are as large as it states: chi-square tests by channel.

While the model, its noises and the sensors are right, e_i^2 / S_ii of each channel is chi-square
with one degree of freedom, and the sum over a window of W ticks is chi-square with W (the squared
innovations are white). Each tick and each window of each channel is tested against a limit that a
consistent filter exceeds so rarely that all tests together give the stated number of false alarms:
half of them to single ticks, which find what is grossly wrong at once, half to windows.
"""

from typing import Annotated, NamedTuple, Protocol, runtime_checkable

import numpy as np
from pydantic import Field
from scipy.special import chdtri

from flexslew_plant.arrays import Vector, called, compiled_once
from flexslew_plant.settings import Positive, section

_HOUR = 3600.0  # [s]


@section
class MonitorSettings:
    """The `monitor` section of a law with an estimator that has innovations."""

    # expected per simulated hour, over all channels, of a filter with the right model and noises
    false_alarms: Positive = 0.01
    # ticks of the slower test; the faster one tests single ticks
    window: Annotated[int, Field(ge=1)] = 20


@runtime_checkable
class Monitored(Protocol):
    """An estimator that states the variance of its innovations."""

    def innovation_variance(self) -> Vector:
        """Return the variance of each entry of the last innovation, shape (l,)."""


class FailedTest(NamedTuple):
    """A test that was failed."""

    channel: int
    statistic: float  # sum of e^2 / S over the ticks
    limit: float
    ticks: int  # that it is the sum over


class MonitorNumbers(NamedTuple):
    """Constants of the tests of one channel."""

    window: int  # W [ticks]
    single: float  # limit of e^2 / S of one tick
    window_limit: float  # limit of its sum over a window


class ChannelTest(NamedTuple):
    """The tests of one channel at one tick."""

    square: float  # e^2 / S
    window: float  # sum over the window that ends at this tick; 0: none does
    total: float  # memory: sum over the window so far, for the next tick
    passed: bool  # what is not a number does not


@called
def innovation_tests(
    n: MonitorNumbers, total: float, since: int, innovation: float, variance: float
) -> ChannelTest:
    """Return the tests of an innovation: e^2 / S by itself, and summed over each W ticks.

    Args:
        n: constants.
        total: memory, sum over the window before this tick; 0 at first.
        since: ticks since the tests began.
        innovation: e, in the unit of the channel.
        variance: S, in this unit squared.
    """
    square = innovation * innovation / variance
    total += square
    window = total if (since + 1) % n.window == 0 else 0.0
    passed = square <= n.single and window <= n.window_limit
    return ChannelTest(square, window, 0.0 if (since + 1) % n.window == 0 else total, passed)


@compiled_once("total", "square", "window")
def _all_pass(
    n: MonitorNumbers,
    total: Vector,
    since: int,
    innovation: Vector,
    variance: Vector,
    square: Vector,
    window: Vector,
) -> bool:
    """Return whether all channels pass; write their statistics."""
    passed = True
    for i in range(total.size):
        one = innovation_tests(n, total[i], since, innovation[i], variance[i])
        square[i], window[i], total[i] = one.square, one.window, one.total
        passed = passed and one.passed
    return passed


class Monitor:
    """The tests of one estimator, see `innovation_tests`.

    Args:
        settings: how often it may be wrong.
        period: one tick [s].

    Attributes:
        settings: as given.
    """

    def __init__(self, settings: MonitorSettings, period: float) -> None:
        self.settings, self._period = settings, period
        self.reset()

    def reset(self) -> None:
        """Forget what came: the estimator starts afresh."""
        self._total: Vector = np.zeros(0)
        self._since = 0

    def take(self, innovation: Vector, variance: Vector) -> FailedTest | None:
        """Return the first test that fails with the innovation of this tick, if one does.

        Args:
            innovation: measured minus predicted outputs, shape (l,).
            variance: of each, as the estimator states it, shape (l,).
        """
        if self._total.size != innovation.size:
            self._total = np.zeros(innovation.size)
            self._numbers = self.numbers(innovation.size)
        e, s = np.ascontiguousarray(innovation), np.ascontiguousarray(variance)
        n, square, window = self._numbers, np.empty(e.size), np.empty(e.size)
        passed = _all_pass(n, self._total, self._since, e, s, square, window)
        self._since += 1
        if passed:
            return None
        return _largest_failure(square, n.single, 1) or _largest_failure(
            window, n.window_limit, n.window
        )

    def numbers(self, channels: int) -> MonitorNumbers:
        """Return the limits of a tick and of a window that give the false alarms of the settings.

        Args:
            channels: how many are tested.
        """
        window, half = self.settings.window, 0.5 * self.settings.false_alarms
        ticks = channels * _HOUR / self._period  # tests in an hour
        single = min(half / ticks, 0.5)
        window_share = min(half * window / ticks, 0.5)
        return MonitorNumbers(window, float(chdtri(1, single)), float(chdtri(window, window_share)))


def _largest_failure(statistic: Vector, limit: float, ticks: int) -> FailedTest | None:
    channel = int(statistic.argmax())
    largest = float(statistic[channel])
    return FailedTest(channel, largest, limit, ticks) if largest > limit else None


def channel_name(number: int, joints: tuple[str, ...]) -> str:
    """Return a name for an output: joint positions, then rates, then what is beyond the joints."""
    kind, joint = divmod(number, len(joints))
    if kind > 1:
        return f"output {number}"
    return f"{('position', 'velocity')[kind]} of {joints[joint]}"
