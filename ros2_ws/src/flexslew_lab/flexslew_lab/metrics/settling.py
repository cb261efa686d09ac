"""When the joints stay at their goal, and how far they went beyond it."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from flexslew_lab.metrics.metric import (
    Block,
    Ending,
    FlownManoeuvre,
    Key,
    MetricEntry,
    RunSetup,
    by_joint,
)
from flexslew_plant.arrays import Vector

BAND = 0.02  # settling band, of the joint's commanded move [-]
_NOWHERE = 1e-9  # moves below this are rounding [rad or m]
_SAME_TIME = 1e-9  # [s]


def commanded_moves(displacement: Vector, first: Vector) -> Vector:
    """Return how far the joints of one or more runs are to go, (..., joints); 0: nowhere.

    Args:
        displacement: of the plan, (joints,); 0 of a step, which goes from where the run began.
        first: error of the joints at the first tick, (..., joints); NaN: there is no goal.
    """
    moves = np.where(displacement == 0.0, -first, displacement)
    return np.where(np.abs(moves) > _NOWHERE, moves, 0.0)


def settling_band(moves: Vector) -> Vector:
    """Return the band around the goal, (..., joints); a joint with nowhere to go has the largest.

    Args:
        moves: that are commanded, (..., joints).
    """
    size = np.abs(moves)
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
            "the manoeuvre has not begun",
            some=True,
        ),
    }

    def __init__(self, setup: RunSetup) -> None:
        self._setup = setup
        joints = len(setup.joint_names)
        self._moves: Vector | None = None  # known with the first tick, (joints,)
        self.outside = np.full(joints, -np.inf)  # last time outside of the band [s]
        self.beyond = np.full(joints, np.nan)  # the goal; NaN: it has not started
        self.last_time = 0.0  # [s]

    def add(self, block: Block) -> None:
        """Take the next ticks."""
        self.last_time = float(block.time[-1])
        if block.error is None:
            return
        if self._moves is None:
            self._moves = commanded_moves(self._setup.manoeuvre.displacement, block.error[0])
        if block.started.any():
            beyond = (block.error[block.started] * np.sign(self._moves)).max(axis=0)
            self.beyond = np.fmax(self.beyond, np.maximum(beyond, 0.0))
        for joint, band in enumerate(settling_band(self._moves)):
            outside = np.flatnonzero(np.abs(block.error[:, joint]) > band)
            if outside.size:
                self.outside[joint] = block.time[outside[-1]]

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return both values."""
        m = self._setup.manoeuvre
        if m.goal is None or self._moves is None:
            nowhere = by_joint(self._setup, np.full_like(self.outside, np.nan))
            return {"settling_time": nowhere, "overshoot": nowhere}
        settled = settling_times(m, self.outside, self.last_time)
        return {
            "settling_time": by_joint(self._setup, settled),
            "overshoot": by_joint(self._setup, overshoots(self._moves, self.beyond)),
        }


def settling_times(manoeuvre: FlownManoeuvre, outside: Vector, last_time: float) -> Vector:
    """Return when the joints of one or more runs have settled [s], NaN: never.

    Args:
        manoeuvre: that they flew.
        outside: last times outside of the band, (..., joints) [s].
        last_time: of the runs [s].
    """
    settled = np.maximum(outside - manoeuvre.start, 0.0)
    begun = last_time >= manoeuvre.start - _SAME_TIME
    return np.where((outside < last_time) & begun, settled, np.nan)


def overshoots(moves: Vector, beyond: Vector) -> Vector:
    """Return how far the joints went beyond the goal as shares of their moves; NaN: unknown.

    Args:
        moves: see commanded_moves, (..., joints).
        beyond: the goal, (..., joints); NaN: there was no time for it.
    """
    return np.asarray(beyond / np.where(moves == 0.0, np.nan, np.abs(moves)))


SETTLING = MetricEntry(Settling)
