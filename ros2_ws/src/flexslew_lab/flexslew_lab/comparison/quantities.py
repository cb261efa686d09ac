"""What laws are compared by: numbers of metrics.json, each as one number."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

Metrics = Mapping[str, Any]


class ComparisonMetric(NamedTuple):
    """One column of the table."""

    key: str  # in JSON
    title: str
    unit: str
    of: Callable[[Metrics], float | None]  # None: there is none, or never
    drawn: bool = False  # against errors of stiffness and inertia


def _largest(key: str) -> Callable[[Metrics], float | None]:
    """Return what takes the largest number below a key; None where one of them is None."""

    def of(metrics: Metrics) -> float | None:
        numbers = _numbers(metrics.get(key))
        return None if not numbers or None in numbers else max(n for n in numbers if n is not None)

    return of


def _norm(key: str) -> Callable[[Metrics], float | None]:
    """Return what takes the length of a vector."""

    def of(metrics: Metrics) -> float | None:
        vector = metrics.get(key)
        return float(np.linalg.norm(vector)) if vector else None

    return of


def _numbers(value: Any) -> list[float | None]:
    if isinstance(value, Mapping):
        return [number for part in value.values() for number in _numbers(part)]
    if isinstance(value, list | tuple):
        return [number for part in value for number in _numbers(part)]
    return [value]


# of a platform that points and its antennas
_PLATFORM = (
    ComparisonMetric(
        "platform_place", "platform position, rms", "m", _largest("rms_platform_position"),
    ),
    ComparisonMetric(
        "platform_turn", "platform attitude, rms", "rad", _largest("rms_platform_attitude"),
        drawn=True,
    ),
    ComparisonMetric("peak_place", "platform position, peak", "m", _norm("peak_platform_position")),
    ComparisonMetric(
        "peak_turn", "platform attitude, peak", "rad", _norm("peak_platform_attitude"),
    ),
    ComparisonMetric(
        "line_of_sight", "line of sight after its turn", "rad", _largest("line_of_sight_error"),
        drawn=True,
    ),
    ComparisonMetric("vibration", "tip, peak", "m", _largest("peak_tip_deflection"), drawn=True),
    ComparisonMetric("settled", "tip settled after", "s", _largest("vibration_settling_time")),
)  # fmt: skip
# of joints that go to a goal
_JOINTS = (
    ComparisonMetric(
        "joint_error",
        "joints, after the end",
        "rad or m",
        _largest("residual_attitude_error"),
        drawn=True,
    ),
    ComparisonMetric("settled", "joints settled after", "s", _largest("settling_time")),
    ComparisonMetric(
        "residual_tip", "tip, after the end", "m", _largest("residual_tip_deflection"), drawn=True
    ),
    ComparisonMetric("vibration", "tip, peak", "m", _largest("peak_tip_deflection")),
)
_ANY = (
    ComparisonMetric(
        "effort", "effort", "(N m)² s or N² s", _largest("control_effort"), drawn=True
    ),
    ComparisonMetric("peak_effort", "largest effort", "N m or N", _largest("peak_effort")),
)


def quantities(metrics: Metrics) -> tuple[ComparisonMetric, ...]:
    """Return what a run with these metrics is compared by."""
    return (*(_PLATFORM if "rms_platform_attitude" in metrics else _JOINTS), *_ANY)
