"""Responses of the uncertain loop over frequency, at single points of its box."""

from time import thread_time
from typing import NamedTuple

import numpy as np

from flexslew_lab.guarantee.box import corners_and_inner
from flexslew_lab.guarantee.model.uncertain_loop import GainLimit, UncertainLoop
from flexslew_lab.guarantee.scalings.frequency_cover import LoopChannels
from flexslew_plant.arrays import Matrix, Vector

_GRID, _LOWEST = 80, 1e-4  # angles of z, the first one [rad]
_NEAR = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])  # about a pole, in half widths
_SAMPLES, _MOST_CORNERS = 40, 32


class Peak(NamedTuple):
    """A largest singular value over frequency.

    Args:
        size: of the response [-].
        delta: where, normalised, shape (m,).
    """

    size: float
    delta: Vector


def peak_at(loop: UncertainLoop, delta: Vector, gain: GainLimit) -> float:
    """Return the peak over frequency of a response at normalised coordinates [-]."""
    system = loop.response(loop.box.at(delta), gain)
    return float(sizes(system, grid_of(system.a)).max())


def largest_peak(loop: UncertainLoop, gain: GainLimit, end: float = np.inf) -> Peak:
    """Return the largest peak at corners and random points of the box: a lower bound.

    Args:
        loop: over its box.
        gain: whose peak it is.
        end: of the search, as time.thread_time counts [s]; the centre is always tried.
    """
    peaks: list[Peak] = []
    for delta in sample_points(loop):
        peaks.append(Peak(peak_at(loop, delta, gain), delta))
        if thread_time() > end:
            break
    return max(peaks, key=lambda peak: peak.size)


def sample_points(loop: UncertainLoop) -> Matrix:
    """Return the centre, corners and random points of the box, normalised, shape (k, m)."""
    m, rng = len(loop.box.centre), np.random.default_rng(4)
    return np.vstack((np.zeros((1, m)), corners_and_inner(m, _MOST_CORNERS, _SAMPLES, rng)))


def sizes(system: LoopChannels, angles: Vector) -> Vector:
    """Return the largest singular values at angles of z [rad], shape (k,)."""
    return np.asarray(np.linalg.norm(system.at(angles), 2, axis=(1, 2)))


def grid_of(a: Matrix) -> Vector:
    """Return a grid that is dense near the poles [rad]."""
    z = np.linalg.eigvals(a)
    angle, width = abs(np.angle(z)), 1.0 - abs(z)
    near = (angle[:, None] + width[:, None] * _NEAR).ravel()
    near = near[(near > _LOWEST) & (near < np.pi)]
    return np.unique(np.concatenate((np.geomspace(_LOWEST, np.pi, _GRID), near)))
