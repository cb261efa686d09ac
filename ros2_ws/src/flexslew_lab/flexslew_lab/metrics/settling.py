"""When the joints stay at their goal, and how far they went beyond it."""

from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np

from flexslew_lab.metrics.metric import (
    Block,
    Ending,
    Key,
    MetricEntry,
    ReferenceManoeuvre,
    RunSetup,
    ready,
)
from flexslew_plant.arrays import Number, Vector

BAND = 0.02  # settling band, of the joint's commanded move [-]
_MIN_MOVE = 1e-9  # moves below this are rounding [rad or m]
_SAME_TIME = 1e-9  # [s]


def goal_displacement(displacement: Vector, first: Vector) -> Vector:
    """Return how far the joints of one or more runs are to go, (..., joints); 0: nowhere.

    Args:
        displacement: of the plan, (joints,); 0 of a step, which goes from where the run began.
        first: error of the joints at the first tick, (..., joints); NaN: there is no goal.
    """
    move = np.where(displacement == 0.0, -first, displacement)
    return np.where(np.abs(move) > _MIN_MOVE, move, 0.0)


def settling_band(move: Vector) -> Vector:
    """Return the band around the goal, (..., joints); a joint with nowhere to go has the largest.

    Args:
        move: that are commanded, (..., joints).
    """
    size = np.abs(move)
    return np.asarray(BAND * np.where(size == 0.0, size.max(axis=-1, keepdims=True), size))


def goal_excess(error: Number, direction: Number) -> Number:
    """Return how far a joint is beyond its goal.

    Args:
        error: joint position - goal [rad or m].
        direction: sign of its commanded move.
    """
    return error * direction


def band_excess(error: Number, band: Number) -> Number:
    """Return how far a joint is outside of its settling band; above 0: outside."""
    return abs(error) - band


class SettlingExtremes(NamedTuple):
    """What one or more runs have accumulated, each of shape (..., joints)."""

    outside: Vector  # last time outside of the band [s]; -inf: never
    excess: Vector  # farthest beyond the goal; -inf: the manoeuvre has not started


class Settling:
    """Implements Metric."""

    KEYS: ClassVar[Mapping[str, Key]] = {
        "settling_time": Key(
            "s",
            True,
            "from the start of the manoeuvre until the joint stays within 2 % of its commanded "
            "move around the goal, without one within 2 % of the largest; null: never",
            never="overshoot",
        ),
        "overshoot": Key(
            "-",
            True,
            "overshoot as a fraction of the commanded move, after the start; null: no move, or "
            "the manoeuvre has not started",
            some=True,
        ),
    }

    def __init__(self, setup: RunSetup) -> None:
        self._setup = setup
        joints = len(setup.joint_names)
        self._move: Vector | None = None  # known with the first tick, (joints,)
        self.extremes = SettlingExtremes(np.full(joints, -np.inf), np.full(joints, -np.inf))
        self.last_time = 0.0  # [s]

    def add(self, block: Block) -> None:
        """Take the next ticks."""
        self.last_time = float(block.time[-1])
        if block.error is None:
            return
        if self._move is None:
            self._move = goal_displacement(self._setup.manoeuvre.displacement, block.error[0])
        outside, excess = self.extremes
        if block.started.any():
            farthest = goal_excess(block.error[block.started], np.sign(self._move)).max(axis=0)
            np.fmax(excess, farthest, out=excess)
        for joint, band in enumerate(settling_band(self._move)):
            ticks = np.flatnonzero(band_excess(block.error[:, joint], band) > 0.0)
            if ticks.size:
                outside[joint] = block.time[ticks[-1]]

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return both values."""
        move = np.zeros(len(self._setup.joint_names)) if self._move is None else self._move
        values = settling_values(self._setup.manoeuvre, move, self.extremes, self.last_time)
        return ready(self._setup, self.KEYS, values)


def settling_values(
    manoeuvre: ReferenceManoeuvre, move: Vector, extremes: SettlingExtremes, last_time: float
) -> dict[str, Vector]:
    """Return the values of one or more runs by key, each of shape (..., joints); NaN: unknown.

    Args:
        manoeuvre: that they flew.
        move: see goal_displacement, (..., joints).
        extremes: of the runs.
        last_time: of the runs [s].
    """
    if manoeuvre.goal is None:
        return dict.fromkeys(Settling.KEYS, np.full_like(move, np.nan))
    return {
        "settling_time": settling_times(manoeuvre, extremes.outside, last_time),
        "overshoot": relative_overshoot(move, extremes.excess),
    }


def settling_times(manoeuvre: ReferenceManoeuvre, outside: Vector, last_time: float) -> Vector:
    """Return when the joints of one or more runs have settled [s], NaN: never.

    Args:
        manoeuvre: that they flew.
        outside: last times outside of the band, (..., joints) [s].
        last_time: of the runs [s].
    """
    times = np.maximum(outside - manoeuvre.start, 0.0)
    has_started = last_time >= manoeuvre.start - _SAME_TIME
    return np.where((outside < last_time) & has_started, times, np.nan)


def relative_overshoot(move: Vector, excess: Vector) -> Vector:
    """Return how far the joints went beyond the goal as shares of their moves; NaN: unknown.

    Args:
        move: see goal_displacement, (..., joints).
        excess: farthest beyond the goal, (..., joints); -inf: the manoeuvre has not started.
    """
    beyond = np.where(np.isneginf(excess), np.nan, np.maximum(excess, 0.0))
    return np.asarray(beyond / np.where(move == 0.0, np.nan, np.abs(move)))


SETTLING = MetricEntry(Settling, needs_truth=False)
