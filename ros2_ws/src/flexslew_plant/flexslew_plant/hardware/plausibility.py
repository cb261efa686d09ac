"""Whether the joint sensors agree: an encoder must move at the rate of its rate sensor."""

from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from flexslew_plant.arrays import Matrix, Vector, called, compiled_once
from flexslew_plant.settings import Positive, section


@section
class PlausibilitySettings:
    """The `plausibility` section."""

    # largest allowed difference between the mean rates of encoder and rate sensor [rad/s or m/s]
    rate_difference: Positive = 0.01
    window: Annotated[int, Field(ge=1)] = 10  # ticks over which both are compared


class JointMismatch(NamedTuple):
    """A joint of which the sensors disagree."""

    joint: int
    difference: float  # mean rate from the positions, minus that of the rate sensor [rad/s or m/s]


class PlausibilityNumbers(NamedTuple):
    """Constants of the comparison."""

    rate_difference: float  # largest allowed, over a full window [rad/s or m/s]
    window: int  # W [ticks]
    period: float  # T [s]


def plausibility_memory(window: int) -> int:
    """Return the size of the memory of one joint: its last readings of both sensors."""
    return 2 * (window + 1)


@called
def compare_rates(
    n: PlausibilityNumbers, memory: Vector, since: int, position: float, velocity: float
) -> tuple[float, bool]:
    """Return the difference of a joint's mean rates, and whether it is allowed.

    It is (q_k - q_k-n) / (n T) minus the mean of the rates between, by the trapezoidal rule, over
    the last n = min(since, W) ticks. A window that is not full averages the noise less: W / n times
    the difference of a full one is allowed. What is not a number is not allowed.

    Args:
        n: constants.
        memory: last positions, then rates, each written round and round; advanced.
        since: ticks since the comparison began.
        position: as the encoder reads it [rad or m].
        velocity: as the rate sensor reads it [rad/s or m/s].
    """
    places, count = n.window + 1, min(since, n.window)
    now, first = since % places, (since - count) % places
    memory[now], memory[places + now] = position, velocity
    if count == 0:
        return 0.0, True
    total, at = 0.0, first
    for _ in range(count + 1):
        total += memory[places + at]
        at = at + 1 if at < n.window else 0
    mean = (total - 0.5 * (memory[places + first] + velocity)) / count
    difference = (position - memory[first]) / (count * n.period) - mean
    return difference, abs(difference) <= n.rate_difference * n.window / count


@compiled_once("memory", "difference")
def _compare_all(
    n: PlausibilityNumbers,
    memory: Matrix,
    since: int,
    position: Vector,
    velocity: Vector,
    difference: Vector,
) -> bool:
    """Return whether the differences of all joints, which are written, are allowed."""
    consistent = True
    for i in range(difference.size):
        difference[i], one = compare_rates(n, memory[i], since, position[i], velocity[i])
        consistent = consistent and one
    return consistent


class Plausibility:
    """The comparison of all joints on the bench, see `compare_rates`.

    Args:
        settings: what is allowed.
        period: one tick T [s].
    """

    def __init__(self, settings: PlausibilitySettings, period: float) -> None:
        self._numbers = PlausibilityNumbers(settings.rate_difference, settings.window, period)
        self._memory: Matrix = np.zeros((0, 0))
        self._since = 0

    def reset(self) -> None:
        """Forget what was read."""
        self._since = 0

    def look(self, position: Vector, velocity: Vector) -> JointMismatch | None:
        """Return the joint that disagrees most, beyond what is allowed; None: all is well.

        Until the window is full it compares what there is. What is not a number disagrees. A
        finding empties the window, so the next one rests on what is read from then on.

        Args:
            position: as the encoders read it, shape (joints,) [rad or m].
            velocity: as the rate sensors read it, shape (joints,) [rad/s or m/s].
        """
        joints, difference = position.size, np.empty(position.size)
        if len(self._memory) != joints:
            self._memory = np.zeros((joints, plausibility_memory(self._numbers.window)))
        q, v = np.ascontiguousarray(position), np.ascontiguousarray(velocity)
        if _compare_all(self._numbers, self._memory, self._since, q, v, difference):
            self._since += 1
            return None
        self.reset()
        difference[~np.isfinite(difference)] = np.finfo(np.float64).max
        joint = int(np.abs(difference).argmax())
        return JointMismatch(joint, float(difference[joint]))
