"""Metrics of platforms whose appendages point somewhere: errors, turns, positions, efforts."""

from typing import Any

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.spacecraft.motions import Pointing


class PointingMetrics:
    """Numbers of one epoch, block after block.

    Args:
        testbed: that has flown.
        goal: where its joints go, by name; empty: nowhere.
        end: of the manoeuvre [s].
        names: of the actuators.
    """

    def __init__(
        self, testbed: Pointing, goal: dict[str, float], end: float, names: tuple[str, ...]
    ) -> None:
        self._testbed, self._goal, self._end, self._names = testbed, goal, end, names
        self._error: dict[str, Vector] = {}
        self._turn: dict[str, Vector] = {}
        self._tip: dict[str, float] = {}
        self._settled: dict[str, float] = {}
        self._wheels: dict[str, float] = {}
        self._effort = np.zeros(len(names))
        self._attitude, self._place = np.zeros(3), np.zeros(3)
        self._last_time: float | None = None

    def add(self, time: Vector, position: Matrix, velocity: Matrix, effort: Matrix) -> None:
        """Take the next ticks."""
        m = self._testbed.motions(position, velocity, self._goal)
        before = time[0] if self._last_time is None else self._last_time
        self._effort += (effort**2).T @ np.diff(time, prepend=before)
        self._last_time = float(time[-1])
        self._attitude = np.maximum(self._attitude, abs(m.turned).max(axis=0))
        self._place = np.maximum(self._place, abs(m.place).max(axis=0))
        over = time >= self._end - 1e-9
        for name, momentum in m.wheels.items():
            self._wheels[name] = max(self._wheels.get(name, 0.0), float(abs(momentum).max()))
        for name, tip in m.tips.items():
            farthest = float(np.linalg.norm(tip, axis=1).max())
            self._tip[name] = max(self._tip.get(name, 0.0), farthest)
            error = m.attitude + m.turns[name]
            beyond = np.flatnonzero((abs(error) > self._testbed.pointing_tolerance).any(axis=1))
            if beyond.size:
                self._settled[name] = float(time[beyond[-1]])
            if over.any():
                self._error[name] = _larger(self._error.get(name), error[over])
                self._turn[name] = _larger(self._turn.get(name), m.turns[name][over])

    def result(self) -> dict[str, Any]:
        """Return the keys of metrics.json; see metric_schema."""
        last = self._last_time or 0.0
        settled = {name: self._settled.get(name, 0.0) for name in self._tip}
        return {
            "pointing_error": _plain(self._error),
            "residual_tip_rotation": _plain(self._turn),
            "pointing_settled_at": {k: t if t < last else None for k, t in settled.items()},
            "control_effort_by_actuator": dict(
                zip(self._names, self._effort.tolist(), strict=True)
            ),
            "peak_platform_attitude": self._attitude.tolist(),
            "peak_platform_position": self._place.tolist(),
            "peak_tip_deflection": self._tip,
            "peak_wheel_momentum": self._wheels,
        }


def _larger(before: Vector | None, values: Matrix) -> Vector:
    """Return the largest absolute values so far, shape (3,)."""
    largest: Vector = abs(values).max(axis=0)
    return largest if before is None else np.maximum(before, largest)


def _plain(values: dict[str, Vector]) -> dict[str, list[float]]:
    return {name: value.tolist() for name, value in values.items()}
