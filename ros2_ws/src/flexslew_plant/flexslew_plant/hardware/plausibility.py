"""Whether the joint sensors agree: an encoder must move as its rate sensor says."""

from collections import deque
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from flexslew_plant.arrays import Vector
from flexslew_plant.settings import Positive, section


@section
class PlausibilitySettings:
    """The `plausibility` section."""

    # largest allowed difference between the mean rates of encoder and rate sensor [rad/s or m/s]
    rate_difference: Positive = 0.01
    window: Annotated[int, Field(ge=1)] = 10  # ticks over which both are compared


class Implausible(NamedTuple):
    """A joint whose sensors disagree."""

    joint: int
    difference: float  # mean rate from the positions, minus that of the rate sensor [rad/s or m/s]


class Plausibility:
    """Compares (q_k - q_k-W) / (W T) with the mean of the rates between, by the trapezoidal rule.

    Args:
        settings: what is allowed.
        period: one tick T [s].
    """

    def __init__(self, settings: PlausibilitySettings, period: float) -> None:
        self._settings, self._period = settings, period
        self._read: deque[tuple[Vector, Vector]] = deque(maxlen=settings.window + 1)

    def reset(self) -> None:
        """Forget what was read."""
        self._read.clear()

    def look(self, position: Vector, velocity: Vector) -> Implausible | None:
        """Return the joint that disagrees most, beyond what is allowed; None: all is well.

        Until the window is full it compares what there is. What is not a number disagrees. A
        finding empties the window, so the next one rests on what is read from then on.

        Args:
            position: as the encoders read it, shape (joints,) [rad or m].
            velocity: as the rate sensors read it, shape (joints,) [rad/s or m/s].
        """
        self._read.append((position, velocity))
        count = len(self._read) - 1
        if not count:
            return None
        rates = np.array([rate for _, rate in self._read])
        mean = (rates.sum(axis=0) - 0.5 * (rates[0] + rates[-1])) / count
        moved = (position - self._read[0][0]) / (count * self._period)
        difference = moved - mean
        difference[~np.isfinite(difference)] = np.finfo(np.float64).max
        size = np.abs(difference)
        # a window that is not full averages the noise less
        allowed = self._settings.rate_difference * self._settings.window / count
        joint = int(size.argmax())
        if size[joint] <= allowed:
            return None
        self.reset()
        return Implausible(joint, float(difference[joint]))
