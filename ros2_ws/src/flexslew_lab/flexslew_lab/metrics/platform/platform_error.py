"""How far a platform is from its goal: where it is, and how it is turned."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from flexslew_lab.metrics.metric import (
    Block,
    Ending,
    Key,
    MetricEntry,
    RunSetup,
    add_rows,
    goal_by_joint,
    plain,
    update_maximum,
)
from flexslew_lab.metrics.platform.block_motions import block_motions
from flexslew_plant.arrays import Vector
from flexslew_plant.testbeds.contract import Pointing as PointingTestbed


class PlatformError:
    """Implements Metric, of a platform that points."""

    KEYS: ClassVar[Mapping[str, Key]] = {
        "residual_platform_position": Key(
            "m",
            False,
            "x y z: largest |position - goal| of the body origin after the manoeuvre's end",
            axes=True,
        ),
        "residual_platform_attitude": Key(
            "rad", False, "x y z: largest |attitude error| after the manoeuvre's end", axes=True
        ),
        "rms_platform_position": Key(
            "m", False, "root mean square of the body origin's distance from its goal over the run"
        ),
        "rms_platform_attitude": Key(
            "rad", False, "root mean square of the attitude error over the run"
        ),
    }

    def __init__(self, setup: RunSetup) -> None:
        known: Any = setup.testbed
        self._testbed: PointingTestbed = known
        self._goal = goal_by_joint(setup)
        self._left: dict[str, Vector] = {}  # after the end, by kind
        self._squares, self._time = np.zeros(2), np.zeros(1)  # integrals over the run

    def add(self, block: Block) -> None:
        """Take the next ticks."""
        m = block_motions(self._testbed, block, self._goal)
        for k, (kind, error) in enumerate((("position", m.away), ("attitude", m.attitude))):
            terms = (error**2).sum(axis=1) * block.held
            self._squares[k : k + 1] = add_rows(self._squares[k : k + 1], terms[:, None])
            if block.over.any():
                self._left[kind] = update_maximum(self._left.get(kind), error[block.over])
        self._time = add_rows(self._time, block.held[:, None])

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return the four values; what is left is None where the log ends too early."""
        left = plain(self._left)
        position, attitude = np.sqrt(
            self._squares / self._time if self._time.any() else self._squares
        )
        return {
            "residual_platform_position": left.get("position"),
            "residual_platform_attitude": left.get("attitude"),
            "rms_platform_position": float(position),
            "rms_platform_attitude": float(attitude),
        }


PLATFORM_ERROR = MetricEntry(PlatformError, of=PointingTestbed)
