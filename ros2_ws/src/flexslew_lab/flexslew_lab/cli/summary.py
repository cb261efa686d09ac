"""What a run comes to, in a few lines of a terminal."""

from collections.abc import Mapping
from typing import Any

from flexslew_lab.cli.terminal import short
from flexslew_lab.metrics.goal import missed_goal
from flexslew_lab.metrics.rows import flat, unit_of


def metric_rows(metrics: Mapping[str, Any], units: Mapping[str, str]) -> list[tuple[str, str, str]]:
    """Return (metric, value, unit), one row per number.

    Args:
        metrics: content of metrics.json.
        units: of the joints by name, rad or m.
    """
    return [
        (name, short(value), unit_of(name, _about(name, units)))
        for name, value in flat(metrics).items()
    ]


def headline(metrics: Mapping[str, Any], bare: Mapping[str, Any], tolerance: float) -> str:
    """Return the one thing that a person wants to know of a run; a missed goal comes first.

    Args:
        metrics: content of metrics.json.
        bare: the same of the run without feedforward; empty where there is none.
        tolerance: `goal_tolerance` of the trial [-].
    """
    missed = missed_goal(metrics, tolerance)
    return f"{missed}; {_vibration(metrics, bare)}" if missed else _vibration(metrics, bare)


def _vibration(metrics: Mapping[str, Any], bare: Mapping[str, Any]) -> str:
    left = metrics.get("residual_tip_deflection")
    if left is None:
        peak = short(metrics.get("peak_tip_deflection"))
        return f"tip deflection up to {peak} m; the manoeuvre was not completed"
    words = f"tip deflection after the manoeuvre: {left:.3g} m"
    without = bare.get("residual_tip_deflection")
    if without is not None:
        words += f", without feedforward {without:.3g} m"
    return words


def _about(name: str, units: Mapping[str, str]) -> set[str]:
    """Return the units of the joints that a row is about."""
    joint = name.partition(".")[2]
    return {units[joint]} if joint in units else set(units.values())
