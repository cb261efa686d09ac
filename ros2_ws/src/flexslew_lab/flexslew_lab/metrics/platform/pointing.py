"""Platforms with appendages that point somewhere: errors, turns, positions, efforts."""

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
from flexslew_lab.metrics.tip_deflection import TipDeflection
from flexslew_plant.arrays import Vector
from flexslew_plant.testbeds.contract import Pointing as PointingTestbed


class PointingMetric:
    """Implements Metric; returns no value for a testbed that points nowhere."""

    KEYS: ClassVar[Mapping[str, Key]] = {
        "pointing_error": Key(
            "rad",
            False,
            "by appendage, x y z: largest |attitude error + tip rotation| after the "
            "manoeuvre's end; null: it has not come",
            axes=True,
        ),
        "residual_tip_rotation": Key(
            "rad",
            False,
            "by appendage, x y z: largest |tip rotation| after the manoeuvre's end; null: it has "
            "not come",
            axes=True,
        ),
        "pointing_settled_at": Key(
            "s",
            False,
            "by appendage: last time with any component above the pointing tolerance; "
            "null: not settled",
            never="peak_platform_attitude",
        ),
        "control_effort_by_actuator": Key(
            "(N m)^2 s or N^2 s", False, "by actuator: integral of its squared effort"
        ),
        "peak_platform_attitude": Key("rad", False, "x y z: largest |rotation| from inertial axes"),
        "peak_platform_position": Key("m", False, "x y z: largest |position| of the body origin"),
        "peak_tip_deflection": TipDeflection.KEYS["peak_tip_deflection"],
        "peak_wheel_momentum": Key(
            "N m s", False, "by wheel: largest momentum of its spin relative to the platform"
        ),
    }

    def __init__(self, setup: RunSetup) -> None:
        known: Any = setup.testbed
        self._testbed: PointingTestbed = known
        self._names, self._goal = setup.joint_names, goal_by_joint(setup)
        self._error: dict[str, Vector] = {}
        self._tip_rotation: dict[str, Vector] = {}
        self._tip: dict[str, float] = {}
        self._settling_time: dict[str, float] = {}
        self._wheels: dict[str, float] = {}
        self._effort = np.zeros(len(self._names))
        self._attitude, self._place = np.zeros(3), np.zeros(3)
        self._last_time = 0.0

    def add(self, block: Block) -> None:
        """Take the next ticks."""
        m = block_motions(self._testbed, block, self._goal)
        self._effort = add_rows(self._effort, block.effort**2 * block.held[:, None])
        self._last_time = float(block.time[-1])
        self._attitude = np.maximum(self._attitude, abs(m.turned).max(axis=0))
        self._place = np.maximum(self._place, abs(m.place).max(axis=0))
        for name, momentum in m.wheels.items():
            self._wheels[name] = max(self._wheels.get(name, 0.0), float(abs(momentum).max()))
        for name, tip in m.tips.items():
            largest_distance = float(np.linalg.norm(tip, axis=1).max())
            self._tip[name] = max(self._tip.get(name, 0.0), largest_distance)
            error = m.attitude + m.turns[name]
            outside = np.flatnonzero((abs(error) > self._testbed.pointing_tolerance).any(axis=1))
            if outside.size:
                self._settling_time[name] = float(block.time[outside[-1]])
            if block.over.any():
                self._error[name] = update_maximum(self._error.get(name), error[block.over])
                self._tip_rotation[name] = update_maximum(
                    self._tip_rotation.get(name), m.turns[name][block.over]
                )

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return the values by appendage, actuator and wheel."""
        last = self._last_time
        settling_times = {name: self._settling_time.get(name, 0.0) for name in self._tip}
        no_values = dict.fromkeys(self._tip)  # where the end has not come
        return {
            "pointing_error": no_values | plain(self._error),
            "residual_tip_rotation": no_values | plain(self._tip_rotation),
            "pointing_settled_at": {k: t if t < last else None for k, t in settling_times.items()},
            "control_effort_by_actuator": dict(
                zip(self._names, self._effort.tolist(), strict=True)
            ),
            "peak_platform_attitude": self._attitude.tolist(),
            "peak_platform_position": self._place.tolist(),
            "peak_tip_deflection": self._tip,
            "peak_wheel_momentum": self._wheels,
        }


POINTING = MetricEntry(PointingMetric, of=PointingTestbed)
