"""Quantities with a unit, `57 deg` or `2 min`, as numbers in SI."""

import re
from collections.abc import Iterable
from dataclasses import fields, is_dataclass
from math import isfinite, nan, pi
from typing import Any, get_args, get_type_hints

from flexslew_plant.errors import BadInput
from flexslew_plant.keys.settings_fields import describe_section

# what a unit of SI may be given in, and how much of it that is
UNITS: dict[str, dict[str, float]] = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0},
    "rad": {
        "rad": 1.0, "mrad": 1e-3, "deg": pi / 180.0, "arcmin": pi / 10800.0,
        "arcsec": pi / 648000.0,
    },
    "rad/s": {"rad/s": 1.0, "deg/s": pi / 180.0, "rpm": pi / 30.0},
    "m": {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "km": 1e3},
    "m/s": {"m/s": 1.0, "mm/s": 1e-3, "cm/s": 1e-2},
    "N": {"N": 1.0, "mN": 1e-3, "kN": 1e3},
    "N m": {"N m": 1.0, "mN m": 1e-3, "kN m": 1e3},
    "Hz": {"Hz": 1.0, "mHz": 1e-3, "kHz": 1e3},
}  # fmt: skip
ABOVE = "unit of the section"  # marks a key in the unit of its section's own key
_QUANTITY = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-z][A-Za-z/ ]*)")
_BRACKETS = re.compile(r"\[([^\]]+)\]")
_EXAMPLE = re.compile(r"`[^`]*`")
Path = tuple[str, ...]


def units_in(words: str) -> tuple[str, ...]:
    """Return the units that the words of a key name in brackets: `[rad or m]` are two.

    An example, between backticks, may have brackets of its own.
    """
    found = _BRACKETS.search(_EXAMPLE.sub("", words))
    return tuple(re.split(r" or |, ", found.group(1))) if found else ()


def in_si(value: Any, units: Iterable[str]) -> Any:
    """Return a quantity in one of these units as a number, each of a list; all else as it is.

    Raises:
        BadInput: it is a quantity of another kind; with the units that are allowed.
    """
    if isinstance(value, list):
        return [in_si(one, units) for one in value]
    match = _matched(value)
    if match is None:
        return value
    allowed = {name: factor for unit in units for name, factor in UNITS.get(unit, {}).items()}
    if match[2] not in allowed:
        words = f"a number in {', '.join(allowed)}" if allowed else "a number without a unit"
        raise BadInput(f"give {words}", value=value)
    number = float(match[1]) * allowed[match[2]]
    if not isfinite(number):
        raise BadInput("give a finite number", value=value)
    return number


def number_in(value: Any, units: Iterable[str], key: str) -> float:
    """Return a finite number, or a quantity in one of these units in SI.

    Raises:
        BadInput: it is neither; with the key.
    """
    try:
        number = float(in_si(value, units))
    except BadInput as error:
        raise BadInput(error.refusal.why, key=key, value=value) from None
    except (TypeError, ValueError):
        number = nan
    if not isfinite(number):
        raise BadInput(f"a finite number [{' or '.join(units)}]", key=key, value=value)
    return number


def is_quantity(value: Any) -> bool:
    """Return whether a value is a text that names a number and a known unit."""
    return _matched(value) is not None


def convert_quantities(kind: Any, values: Any, places: Iterable[Path], source: str) -> Any:
    """Return settings with the quantities at some places as numbers in SI.

    Args:
        kind: the section, or any type that holds sections.
        values: what YAML gave.
        places: keys and places in lists, from the top on.
        source: the file (or node) to name in an error.

    Raises:
        BadInput: a quantity is of another kind than its key.
    """
    for path in places:
        try:
            values = _convert_at(values, path, units_at(kind, path))
        except BadInput as error:
            why = error.refusal
            raise BadInput(why.why, source, ".".join(path), why.value) from None
    return values


def units_at(kind: Any, path: Path) -> tuple[str, ...]:
    """Return the units of the key at a place; none where the code names none."""
    kinds: list[Any] = [kind]
    units: tuple[str, ...] = ()
    for part in path:
        sections = [owner for one in kinds for owner in _sections(one)]
        sections = [owner for owner in sections if part in {item.name for item in fields(owner)}]
        if sections:
            named = [units_in(describe_section(owner)[part].words) for owner in sections]
            key_units = tuple(dict.fromkeys(unit for one in named for unit in one))
            units = units if key_units == (ABOVE,) else key_units
            kinds = [get_type_hints(owner, include_extras=True)[part] for owner in sections]
    return units


def _sections(kind: Any) -> list[type[Any]]:
    if isinstance(kind, type) and is_dataclass(kind):
        return [kind]
    return [found for part in get_args(kind) for found in _sections(part)]


def _matched(value: Any) -> re.Match[str] | None:
    match = _QUANTITY.fullmatch(value.strip()) if isinstance(value, str) else None
    return match if match and any(match[2] in known for known in UNITS.values()) else None


def _convert_at(values: Any, path: Path, units: tuple[str, ...]) -> Any:
    if not path:
        return in_si(values, units)
    if isinstance(values, dict):
        return {
            key: _convert_at(value, path[1:], units) if str(key) == path[0] else value
            for key, value in values.items()
        }
    if isinstance(values, list | tuple):
        return [
            _convert_at(value, path[1:], units) if str(k) == path[0] else value
            for k, value in enumerate(values)
        ]
    return values
