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

from flexslew_plant.arrays import Vector
from flexslew_plant.settings import Positive, section

_HOUR = 3600.0  # [s]


@section
class MonitorSettings:
    """The `monitor` section of a law whose estimator has innovations."""

    # expected per simulated hour, over all channels, of a filter whose model and noises are right
    false_alarms: Positive = 0.01
    # ticks of the slower test; the faster one looks at single ticks
    window: Annotated[int, Field(ge=1)] = 20


@runtime_checkable
class Monitored(Protocol):
    """An estimator that states the variance of its innovations."""

    def innovation_variance(self) -> Vector:
        """Return the variance of each entry of the last innovation, shape (l,)."""


class Doubt(NamedTuple):
    """A test that was failed."""

    channel: int
    statistic: float  # sum of e^2 / S over the ticks
    limit: float
    ticks: int  # that it is the sum over


class Monitor:
    """The tests of one estimator.

    Args:
        settings: how often it may be wrong.
        period: one tick [s].

    Attributes:
        settings: as given.
    """

    def __init__(self, settings: MonitorSettings, period: float) -> None:
        self.settings, self._period = settings, period
        self._limits = np.inf, np.inf  # of one tick, of a window
        self.reset()

    def reset(self) -> None:
        """Forget what came: the estimator starts afresh."""
        self._sum: Vector = np.zeros(0)
        self._count = 0

    def take(self, innovation: Vector, variance: Vector) -> Doubt | None:
        """Return the first test that fails with the innovation of this tick, if one does.

        Args:
            innovation: measured minus predicted outputs, shape (l,).
            variance: of each, as the estimator states it, shape (l,).
        """
        if self._sum.size != innovation.size:
            self._sum = np.zeros(innovation.size)
            self._limits = self.limits(innovation.size)
        square = innovation * innovation / variance
        self._sum = self._sum + square
        self._count += 1
        over = self._worst(square, self._limits[0], 1)
        if self._count == self.settings.window:
            over = over or self._worst(self._sum, self._limits[1], self._count)
            self._sum, self._count = np.zeros(innovation.size), 0
        return over

    def _worst(self, statistic: Vector, limit: float, ticks: int) -> Doubt | None:
        channel = int(statistic.argmax())
        largest = float(statistic[channel])
        return Doubt(channel, largest, limit, ticks) if largest > limit else None

    def limits(self, channels: int) -> tuple[float, float]:
        """Return the limits of a tick and of a window that give the false alarms of the settings.

        Args:
            channels: how many are tested.
        """
        window, half = self.settings.window, 0.5 * self.settings.false_alarms
        ticks = channels * _HOUR / self._period  # tests in an hour
        single = min(half / ticks, 0.5)
        several = min(half * window / ticks, 0.5)
        return float(chdtri(1, single)), float(chdtri(window, several))


def channel_name(number: int, joints: tuple[str, ...]) -> str:
    """Return a name for an output: joint positions, then rates, then what is beyond the joints."""
    kind, joint = divmod(number, len(joints))
    if kind > 1:
        return f"output {number}"
    return f"{('position', 'velocity')[kind]} of {joints[joint]}"
