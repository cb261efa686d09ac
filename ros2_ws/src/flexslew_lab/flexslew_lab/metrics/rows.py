"""The content of metrics.json as rows: one name and one value each."""

from collections.abc import Collection, Iterator, Mapping
from typing import Any

from flexslew_lab.metrics import KEYS, Key

AXES = "xyz"
_UNKNOWN = Key("-", False, "")
NO_KEYS: Mapping[str, Key] = {}


def flat(metrics: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values by dotted name: `final_error.x`, `pointing_error.antenna.z`."""
    found: dict[str, Any] = {}
    for key, value in metrics.items():
        found.update(_rows(key, value))
    return found


def key_of(name: str, others: Mapping[str, Key] = NO_KEYS) -> Key:
    """Return what a row holds; of what is no key, nothing is known.

    Args:
        name: of the row.
        others: keys besides those of the bench, see own.keys_of.
    """
    key = name.split(".")[0]
    return KEYS.get(key) or others.get(key, _UNKNOWN)


def unit_of(name: str, kinds: Collection[str], others: Mapping[str, Key] = NO_KEYS) -> str:
    """Return the unit of a row, empty where it has none.

    Args:
        name: of the row.
        kinds: units of the joints that it is about; where the key has one unit for angles and one
            for lengths, theirs is the one.
        others: see key_of.
    """
    unit = key_of(name, others).unit
    if " or " in unit and len(set(kinds)) == 1:
        unit = unit.split(" or ")[1 if "m" in kinds else 0]
    return "" if unit in ("-", "hex") else unit


def row_unit(name: str, joints: Mapping[str, str], others: Mapping[str, Key] = NO_KEYS) -> str:
    """Return the unit of a row of a bench, see unit_of.

    Args:
        name: of the row; behind a dot may stand the joint that it is about.
        joints: units of the bench's joints by name.
        others: see key_of.
    """
    joint = name.partition(".")[2]
    kinds = {joints[joint]} if joint in joints else set(joints.values())
    return unit_of(name, kinds, others)


def _rows(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    if value is None or isinstance(value, float):  # most of them
        yield name, value
    elif isinstance(value, Mapping):
        for part, inner in value.items():
            if inner is None or isinstance(inner, float):
                yield f"{name}.{part}", inner
            else:
                yield from _rows(f"{name}.{part}", inner)
    elif isinstance(value, list) and len(value) == len(AXES) and not isinstance(value[0], str):
        for axis, inner in zip(AXES, value, strict=True):
            yield from _rows(f"{name}.{axis}", inner)
    elif isinstance(value, list) and value and isinstance(value[0], float):
        yield name, "; ".join(f"{number:.3g}" for number in value)
    elif isinstance(value, list):
        yield name, "; ".join(map(str, value))
    else:
        yield name, value
