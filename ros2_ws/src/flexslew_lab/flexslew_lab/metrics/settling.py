"""When the joints stay at their goal, and how far they went beyond it."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from flexslew_lab.metrics.metric import (
    Block,
    Ending,
    Key,
    MetricEntry,
    ReferenceManoeuvre,
    RunSetup,
    by_joint,
)
from flexslew_plant.arrays import Vector

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
        self.outside = np.full(joints, -np.inf)  # last time outside of the band [s]
        self.limit_excess = np.full(joints, np.nan)  # the goal; NaN: it has not started
        self.last_time = 0.0  # [s]

    def add(self, block: Block) -> None:
        """Take the next ticks."""
        self.last_time = float(block.time[-1])
        if block.error is None:
            return
        if self._move is None:
            self._move = goal_displacement(self._setup.manoeuvre.displacement, block.error[0])
        if block.started.any():
            excess = (block.error[block.started] * np.sign(self._move)).max(axis=0)
            self.limit_excess = np.fmax(self.limit_excess, np.maximum(excess, 0.0))
        for joint, band in enumerate(settling_band(self._move)):
            outside = np.flatnonzero(np.abs(block.error[:, joint]) > band)
            if outside.size:
                self.outside[joint] = block.time[outside[-1]]

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return both values."""
        m = self._setup.manoeuvre
        if m.goal is None or self._move is None:
            no_values = by_joint(self._setup, np.full_like(self.outside, np.nan))
            return {"settling_time": no_values, "overshoot": no_values}
        times = settling_times(m, self.outside, self.last_time)
        return {
            "settling_time": by_joint(self._setup, times),
            "overshoot": by_joint(self._setup, relative_overshoot(self._move, self.limit_excess)),
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
        excess: the goal, (..., joints); NaN: there was no time for it.
    """
    return np.asarray(excess / np.where(move == 0.0, np.nan, np.abs(move)))


SETTLING = MetricEntry(Settling)
