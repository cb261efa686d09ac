"""What laws and planners are designed for in the tests."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from flexslew_control.law import PlantDescription
from flexslew_plant.hardware.actuator import ActuatorSettings
from flexslew_plant.own_code import ANY_CODE
from flexslew_plant.testbeds import Testbed, default_testbed

AXES = {"roll": (1.0, 0.0, 0.0), "pitch": (0.0, 1.0, 0.0), "yaw": (0.0, 0.0, 1.0)}


def plant(
    period: float = 0.01,
    limit: Sequence[float] = (150.0, 150.0),
    testbed: Testbed | None = None,
) -> PlantDescription:
    """Return the default testbed, or another one, on a bench."""
    efforts = np.array(limit, dtype=float)
    return PlantDescription(testbed or default_testbed(), period, efforts, ANY_CODE)


def torques(*limits: float) -> dict[str, Any]:
    """Return a torque about each axis of a craft, of one limit for all or one for each [N m]."""
    most = limits if len(limits) > 1 else limits * 3
    return {
        name: {"kind": "torque", "direction": list(axis), "limit": limit}
        for (name, axis), limit in zip(AXES.items(), most, strict=True)
    }


def with_dish(**motion: float) -> dict[str, Any]:
    """Return a craft with three torques of 3 N m, whose dish turns by a motion."""
    return {
        "kind": "spacecraft",
        "platform": {"mass": 200.0, "inertia": {"xx": 40.0, "yy": 45.0, "zz": 50.0}},
        "appendages": {
            "dish": {
                "hinge": {"place": [0.3, 0.2, 0.4], "axis": [1.0, 0.3, 0.0], "motion": motion},
                "body": {"mass": 8.0, "inertia": {"xx": 2.0, "yy": 2.0, "zz": 1.5}},
            }
        },
        "actuators": torques(3.0),
    }


def late(bench: PlantDescription, lag: float, delay: float) -> PlantDescription:
    """Return the bench with motors that have a lag [s] and get commands some ticks late."""
    ticks = np.full(len(bench.joint_names), delay)
    return replace(bench, actuator=ActuatorSettings(lag=lag), delay=ticks)
