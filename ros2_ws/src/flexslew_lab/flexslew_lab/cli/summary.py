"""What a run comes to, in a few lines of a terminal."""

from collections.abc import Mapping
from typing import Any

from flexslew_lab.metrics import Key
from flexslew_lab.metrics.rows import NO_KEYS, flat, row_unit
from flexslew_lab.short_values import short


def metric_rows(
    metrics: Mapping[str, Any], units: Mapping[str, str], user_keys: Mapping[str, Key] = NO_KEYS
) -> list[tuple[str, str, str]]:
    """Return (metric, value, unit), one row per number.

    Args:
        metrics: content of metrics.json.
        units: of the joints by name, rad or m.
        user_keys: keys of the trial's own metrics.
    """
    each = flat(metrics).items()
    return [(name, short(value), row_unit(name, units, user_keys)) for name, value in each]
