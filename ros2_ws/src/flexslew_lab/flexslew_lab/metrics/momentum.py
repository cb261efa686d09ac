"""What wheels and gyros store, how fast and how far they turn, how near gyros are to locking."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from flexslew_lab.metrics.metric import Block, Ending, Key, MetricEntry, RunSetup, update_maximum
from flexslew_plant.arrays import Vector
from flexslew_plant.testbeds.contract import Pointing as PointingTestbed

_REST_SPEED = 1e-9  # of the peak: the speed of a wheel at rest, by rounding [-]


class Momentum:
    """Implements Metric; returns no value for a testbed without wheels and gyros.

    The momentum of the wheels is h = sum of I s a, with a wheel's inertia I, the speed s of its
    spin relative to the platform and its axis a, in body axes; a gyro adds its rotor's.
    """

    KEYS: ClassVar[Mapping[str, Key]] = {
        "peak_wheel_speed": Key(
            "rad/s", False, "by wheel: largest |speed| of its spin relative to the platform"
        ),
        "wheel_zero_crossings": Key(
            "-",
            False,
            "by wheel: how often its speed changes its sign after the manoeuvre's end; below 1e-9 "
            "of its peak it has none",
        ),
        "peak_stored_momentum": Key(
            "N m s",
            False,
            "x y z: largest |momentum of the wheels' spins and gyros' rotors|, in body axes",
        ),
        "final_stored_momentum": Key(
            "N m s",
            False,
            "x y z: momentum of the wheels' spins and gyros' rotors at the end, in body axes",
        ),
        "peak_gimbal_angle": Key("rad", False, "by gyro: largest |angle| of its gimbal"),
        "least_gyro_authority": Key(
            "-",
            False,
            "smallest torque about any axis that equal gimbal rates give, over the largest about "
            "any, at its least; 0: they were at a singularity",
        ),
    }

    def __init__(self, setup: RunSetup) -> None:
        known: Any = setup.testbed
        self._testbed: PointingTestbed = known
        self._speed: dict[str, float] = {}
        self._crossings: dict[str, int] = {}
        self._sign: dict[str, float] = {}  # the last that was not zero
        self._stored: Vector | None = None
        self._angle: dict[str, float] = {}
        self._authority = np.inf
        self._last = np.zeros(3)

    def add(self, block: Block) -> None:
        """Take the next ticks."""
        spins = self._testbed.spins(block.velocity)
        if not (spins.speeds or spins.gimbals):
            return
        for name, angle in spins.gimbals.items():
            self._angle[name] = max(self._angle.get(name, 0.0), float(abs(angle).max()))
        self._authority = min(self._authority, float(spins.authority.min()))
        for name, speed in spins.speeds.items():
            self._speed[name] = max(self._speed.get(name, 0.0), float(abs(speed).max()))
            after = speed[block.over]
            at_rest = abs(after) <= _REST_SPEED * self._speed[name]
            self._count(name, np.where(at_rest, 0.0, np.sign(after)))
        self._stored = update_maximum(self._stored, spins.stored)
        self._last = spins.stored[-1]

    def _count(self, name: str, signs: Vector) -> None:
        """Count the changes of sign from one tick to a later one; zeros have none."""
        signs = signs[np.isfinite(signs) & (signs != 0.0)]
        before = self._sign.get(name)
        sign_sequence = signs if before is None else np.concatenate(([before], signs))
        self._crossings[name] = self._crossings.get(name, 0) + int(
            (np.diff(sign_sequence) != 0.0).sum()
        )
        if signs.size:
            self._sign[name] = float(signs[-1])

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return the values by wheel and by body axis."""
        if self._stored is None:
            return {}
        wheels = {"peak_wheel_speed": self._speed, "wheel_zero_crossings": self._crossings}
        gyros = {"peak_gimbal_angle": self._angle, "least_gyro_authority": self._authority}
        return {
            **(gyros if self._angle else {}),
            **(wheels if self._speed else {}),
            "peak_stored_momentum": self._stored.tolist(),
            "final_stored_momentum": self._last.tolist(),
        }


MOMENTUM = MetricEntry(Momentum, "effort", PointingTestbed)
