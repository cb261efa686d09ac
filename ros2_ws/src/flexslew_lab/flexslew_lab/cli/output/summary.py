"""What a run comes to, in a few lines of a terminal."""

from collections.abc import Mapping
from typing import Any

from flexslew_lab.metrics import GROUPS, Key
from flexslew_lab.metrics.rows import NO_KEYS, flat, row_unit
from flexslew_lab.short_values import short

_DIGITS = 4  # of each number, so that a column compares
_OTHERS = "your metrics"  # heading of the trial's own


def metric_rows(
    metrics: Mapping[str, Any], units: Mapping[str, str], user_keys: Mapping[str, Key] = NO_KEYS
) -> list[tuple[str, ...]]:
    """Return the heading of each group, then (metric, value, unit), one row per number.

    The joints of a metric come in the order of the bench.

    Args:
        metrics: content of metrics.json.
        units: of the joints by name, rad or m.
        user_keys: keys of the trial's own metrics.
    """
    order = {name: i for i, name in enumerate(units)}
    groups: dict[str, list[tuple[str, ...]]] = {name: [] for name in GROUPS.values()}
    for key, content in metrics.items():
        value = content
        if isinstance(content, dict):
            value = dict(sorted(content.items(), key=lambda item: order.get(item[0], len(order))))
        groups.setdefault(GROUPS.get(key, _OTHERS), []).extend(
            (name, short(number, _DIGITS), row_unit(name, units, user_keys))
            for name, number in flat({key: value}).items()
            if key != "trajectory_hash"  # as wide as the table
        )
    return [row for name, rows in groups.items() if rows for row in ((name,), *rows)]
