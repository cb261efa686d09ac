"""Testbeds with joints that follow a shaped command by a motion of their own."""

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.contract.testbed import Testbed


class ShapedMotion(NamedTuple):
    """Joints that follow a shaped command, on a grid, and how they drive the modes."""

    position: Matrix  # (times, joints) [rad or m]
    velocity: Matrix  # (times, joints) [rad/s or m/s]
    # w of M_qq q'' + C q' + K q = -coupling^T w, its mean over each interval, (times - 1, joints)
    drive: Matrix


@runtime_checkable
class Shaped(Protocol):
    """A testbed with its own joint motion for a shaped drive of its modes."""

    def shaped_motion(
        self, path: Vector, rate: Vector, first: Vector, last: Vector, h: float
    ) -> ShapedMotion:
        """Return the motion that drives the modes linearly in the derivatives of the path.

        Args:
            path, rate: a shaped command from 0 to 1 and its derivative, shape (times,) [-, 1/s].
            first, last: joints at its ends, shape (joints,) [rad or m].
            h: interval of the grid [s].

        Raises:
            BadInput: there is no such motion between these ends.
        """


def shaped_motion(
    testbed: Testbed, path: Vector, rate: Vector, first: Vector, last: Vector, h: float
) -> ShapedMotion:
    """Return how the joints follow a shaped command; see Shaped.

    Unless the testbed is a Shaped one every joint follows the command itself, which drives the
    modes by its second derivative.
    """
    if isinstance(testbed, Shaped):
        return testbed.shaped_motion(path, rate, first, last, h)
    span = last - first
    return ShapedMotion(
        first + np.outer(path, span), np.outer(rate, span), np.outer(np.diff(rate) / h, span)
    )
