"""What reaction wheels store: their speeds, and the momentum of all."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from flexslew_lab.metrics.metric import Block, Ending, Key, MetricEntry, RunSetup, larger
from flexslew_plant.arrays import Vector
from flexslew_plant.testbeds.spacecraft.motions import Pointing as PointingTestbed


class Momentum:
    """Implements Metric; says nothing of a testbed without wheels.

    The momentum of the wheels is h = sum of I s a, with a wheel's inertia I, the speed s of its
    spin relative to the platform and its axis a, in body axes.
    """

    KEYS: ClassVar[Mapping[str, Key]] = {
        "peak_wheel_speed": Key(
            "rad/s", False, "by wheel: largest |speed| of its spin relative to the platform"
        ),
        "wheel_zero_crossings": Key(
            "-",
            False,
            "by wheel: how often its speed changes its sign after the manoeuvre's end",
        ),
        "peak_stored_momentum": Key(
            "N m s", False, "x y z: largest |momentum of the wheels' spins|, in body axes"
        ),
        "final_stored_momentum": Key(
            "N m s", False, "x y z: momentum of the wheels' spins at the end, in body axes"
        ),
    }

    def __init__(self, setup: RunSetup) -> None:
        testbed = setup.testbed
        self._testbed = testbed if isinstance(testbed, PointingTestbed) else None
        self._speed: dict[str, float] = {}
        self._crossings: dict[str, int] = {}
        self._sign: dict[str, float] = {}  # the last that was not zero
        self._stored: Vector | None = None
        self._last = np.zeros(3)

    def add(self, block: Block) -> None:
        """Take the next ticks."""
        if self._testbed is None:
            return
        spins = self._testbed.spins(block.velocity)
        if not spins.speeds:
            return
        for name, speed in spins.speeds.items():
            self._speed[name] = max(self._speed.get(name, 0.0), float(abs(speed).max()))
            self._count(name, np.sign(speed[block.over]))
        self._stored = larger(self._stored, spins.stored)
        self._last = spins.stored[-1]

    def _count(self, name: str, signs: Vector) -> None:
        """Count the changes of sign from one tick to a later one; zeros have none."""
        signs = signs[np.isfinite(signs) & (signs != 0.0)]
        before = self._sign.get(name)
        course = signs if before is None else np.concatenate(([before], signs))
        self._crossings[name] = self._crossings.get(name, 0) + int((np.diff(course) != 0.0).sum())
        if signs.size:
            self._sign[name] = float(signs[-1])

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return the values by wheel and by body axis."""
        if self._stored is None:
            return {}
        return {
            "peak_wheel_speed": self._speed,
            "wheel_zero_crossings": self._crossings,
            "peak_stored_momentum": self._stored.tolist(),
            "final_stored_momentum": self._last.tolist(),
        }


MOMENTUM = MetricEntry(Momentum)
