"""What a run comes to, in a few lines of a terminal."""

from collections.abc import Mapping
from typing import Any

from flexslew_lab.metrics.rows import flat, unit_among
from flexslew_lab.short_values import short


def metric_rows(metrics: Mapping[str, Any], units: Mapping[str, str]) -> list[tuple[str, str, str]]:
    """Return (metric, value, unit), one row per number.

    Args:
        metrics: content of metrics.json.
        units: of the joints by name, rad or m.
    """
    return [(name, short(value), unit_among(name, units)) for name, value in flat(metrics).items()]
