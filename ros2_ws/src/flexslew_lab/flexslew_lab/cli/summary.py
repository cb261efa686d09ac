"""What a run comes to, in a few lines of a terminal."""

from collections.abc import Mapping
from typing import Any

from flexslew_lab.cli.terminal import short
from flexslew_lab.report.metric_schema import METRICS

LINEAR = "m"  # unit of a joint that slides


def metric_rows(metrics: Mapping[str, Any], units: Mapping[str, str]) -> list[tuple[str, str, str]]:
    """Return (metric, value, unit), one row per number.

    Args:
        metrics: content of metrics.json.
        units: of the joints by name, rad or m.
    """
    rows = []
    for key, value in metrics.items():
        unit = METRICS[key].unit if key in METRICS else ""
        named = value.items() if isinstance(value, dict) else [("", value)]
        for joint, number in named:
            name = f"{key}.{joint}" if joint else key
            rows.append((name, short(number), _unit(unit, units, joint)))
    return rows


def headline(metrics: Mapping[str, Any], bare: Mapping[str, Any]) -> str:
    """Return the one thing that a person wants to know of a run.

    Args:
        metrics: content of metrics.json.
        bare: the same of the run without feedforward; empty where there is none.
    """
    left = metrics.get("residual_tip_deflection")
    if left is None:
        peak = short(metrics.get("peak_tip_deflection"))
        return f"tip deflection up to {peak} m; the run ends before its manoeuvre"
    words = f"tip deflection after the manoeuvre: {left:.3g} m"
    without = bare.get("residual_tip_deflection")
    if without is not None:
        words += f", without feedforward {without:.3g} m"
    return words


def _unit(unit: str, units: Mapping[str, str], joint: str) -> str:
    """Return the unit of a joint where the schema names one for each kind."""
    if " or " in unit:
        kinds = {units[joint]} if joint in units else set(units.values())
        if len(kinds) == 1:
            unit = unit.split(" or ")[1 if kinds == {LINEAR} else 0]
    return "" if unit in ("-", "hex") else unit
