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


def settling_band(displacement: Vector) -> Vector:
    """Return the band around the goal, (joints,); a joint with nowhere to go has the largest."""
    return BAND * np.where(
        displacement == 0.0, np.abs(displacement).max(initial=0.0), np.abs(displacement)
    )


class Settling:
    """Implements Metric."""

    KEYS: ClassVar[Mapping[str, Key]] = {
        "settling_time": Key(
            "s",
            True,
            "from the start of the manoeuvre until the joint stays within 2 % of its commanded "
            "move around the goal; null: never",
        ),
        "overshoot": Key(
            "-",
            True,
            "overshoot as a fraction of the commanded move, after the start; null: no move",
        ),
    }

    def __init__(self, setup: RunSetup) -> None:
        self._setup = setup
        self._band = settling_band(setup.manoeuvre.displacement)
        joints = len(setup.joint_names)
        self.outside = np.full(joints, -np.inf)  # last time outside of the band [s]
        self.beyond = np.zeros(joints)  # the goal
        self.last_time = 0.0  # [s]

    def add(self, block: Block) -> None:
        """Take the next ticks."""
        self.last_time = float(block.time[-1])
        if block.error is None:
            return
        if block.started.any():
            direction = np.sign(self._setup.manoeuvre.displacement)
            beyond = (block.error[block.started] * direction).max(axis=0)
            self.beyond = np.maximum(self.beyond, beyond)
        for joint, band in enumerate(self._band):
            outside = np.flatnonzero(np.abs(block.error[:, joint]) > band)
            if outside.size:
                self.outside[joint] = block.time[outside[-1]]

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return both values."""
        m = self._setup.manoeuvre
        if m.goal is None:
            nowhere = by_joint(self._setup, np.full_like(self.outside, np.nan))
            return {"settling_time": nowhere, "overshoot": nowhere}
        settled = settling_times(m, self.outside, self.last_time)
        return {
            "settling_time": by_joint(self._setup, settled),
            "overshoot": by_joint(self._setup, overshoots(m, self.beyond)),
        }


def settling_times(manoeuvre: FlownManoeuvre, outside: Vector, last_time: float) -> Vector:
    """Return when the joints of one or more runs have settled [s], NaN: never.

    Args:
        manoeuvre: that they flew.
        outside: last times outside of the band, (..., joints) [s].
        last_time: of the runs [s].
    """
    settled = np.maximum(outside - manoeuvre.start, 0.0)
    return np.where(outside < last_time, settled, np.nan)


def overshoots(manoeuvre: FlownManoeuvre, beyond: Vector) -> Vector:
    """Return how far the joints went beyond the goal, (..., joints), as shares of their moves."""
    move = manoeuvre.displacement
    return np.asarray(beyond / np.where(move == 0.0, np.nan, np.abs(move)))


SETTLING = MetricEntry(Settling)
