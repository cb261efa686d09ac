"""The content of metrics.json as rows: one name and one value each."""

from collections.abc import Collection, Mapping
from typing import Any

from flexslew_lab.metrics import KEYS, Key

_AXES = "xyz"


def flat(metrics: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values by dotted name: `final_error.x`, `pointing_error.antenna.z`."""
    rows: dict[str, Any] = {}
    for key, value in metrics.items():
        rows |= dict(_rows(key, value))
    return rows


def key_of(name: str) -> Key:
    """Return what a row holds; of a metric that is not the bench's own, nothing is known."""
    return KEYS.get(name.split(".")[0], Key("-", False, ""))


def unit_of(name: str, kinds: Collection[str]) -> str:
    """Return the unit of a row, empty where it has none.

    Args:
        name: of the row.
        kinds: units of the joints that it is about; where the key has one unit for angles and one
            for lengths, theirs is the one.
    """
    unit = key_of(name).unit
    if " or " in unit and len(set(kinds)) == 1:
        unit = unit.split(" or ")[1 if "m" in kinds else 0]
    return "" if unit in ("-", "hex") else unit


def _rows(name: str, value: Any) -> list[tuple[str, Any]]:
    if isinstance(value, Mapping):
        return [row for part, inner in value.items() for row in _rows(f"{name}.{part}", inner)]
    if isinstance(value, list) and value and isinstance(value[0], float):
        return [(f"{name}.{axis}", part) for axis, part in zip(_AXES, value, strict=True)]
    if isinstance(value, list):
        return [(name, "; ".join(map(str, value)))]
    return [(name, value)]
