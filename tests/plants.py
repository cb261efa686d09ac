"""What laws and planners are designed for in the tests."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flexslew_control.law import PlantDescription
from flexslew_plant.hardware.actuator import ActuatorSettings
from flexslew_plant.own_code import ANY_CODE
from flexslew_plant.testbeds import Testbed, default_testbed


def plant(
    period: float = 0.01,
    limit: Sequence[float] = (150.0, 150.0),
    testbed: Testbed | None = None,
) -> PlantDescription:
    """Return the default testbed, or another one, on a bench."""
    efforts = np.array(limit, dtype=float)
    return PlantDescription(testbed or default_testbed(), period, efforts, ANY_CODE)


def late(bench: PlantDescription, lag: float, delay: float) -> PlantDescription:
    """Return the bench with motors that have a lag [s] and get commands some ticks late."""
    ticks = np.full(len(bench.joint_names), delay)
    return replace(bench, actuator=ActuatorSettings(lag=lag), delay=ticks)
