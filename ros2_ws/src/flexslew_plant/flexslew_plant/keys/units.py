"""Quantities with a unit, `57 deg` or `0.66 deg/sqrt(h)`, as numbers in the unit of their key."""

import itertools
import re
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from math import isfinite, nan, pi
from typing import Any, TypeAlias, get_args, get_type_hints

from flexslew_plant.errors import BadInput
from flexslew_plant.keys.settings_fields import describe_section

_BASES = ("m", "kg", "s", "rad", "A")
_Kind: TypeAlias = tuple[float, ...]  # exponents of the bases
_NONE: _Kind = (0.0,) * len(_BASES)
# units by symbol, in other units; of one with several meanings the key decides, and of a key the
# first counts
_SYMBOLS: dict[str, tuple[tuple[float, str], ...]] = {
    "sec": ((1.0, "s"),), "min": ((60.0, "s"),), "h": ((3600.0, "s"),), "hr": ((3600.0, "s"),),
    "d": ((86400.0, "s"),),
    "deg": ((pi / 180.0, "rad"),), "arcmin": ((pi / 10800.0, "rad"),),
    "arcsec": ((pi / 648000.0, "rad"),), "mas": ((pi / 648e6, "rad"),), "rev": ((2 * pi, "rad"),),
    "rpm": ((pi / 30.0, "rad/s"),), "Hz": ((1.0, "1/s"), (2.0 * pi, "rad/s")),
    "N": ((1.0, "kg m/s^2"),), "Nm": ((1.0, "N m"),), "Nms": ((1.0, "N m s"),),
    "Pa": ((1.0, "N/m^2"),), "g": ((1e-3, "kg"), (9.80665, "m/s^2")), "t": ((1e3, "kg"),),
    "in": ((0.0254, "m"),), "ft": ((0.3048, "m"),), "slug": ((14.593902937206364, "kg"),),
    "lb": ((4.4482216152605, "N"), (0.45359237, "kg")), "lbf": ((4.4482216152605, "N"),),
    "oz": ((0.27801385095378125, "N"), (0.028349523125, "kg")), "psi": ((1.0, "lb/in^2"),),
    "%": ((0.01, "-"),), "ppm": ((1e-6, "-"),), "-": ((1.0, ""),),
}  # fmt: skip
_PREFIXES = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "k": 1e3, "M": 1e6, "G": 1e9}
_PREFIXED = ("m", "s", "g", "rad", "A", "N", "Nm", "Nms", "Pa", "Hz")
_USUAL = {  # what a message names where a unit of SI is expected
    "s": "s, ms, us, min, h",
    "rad": "rad, mrad, deg, arcmin, arcsec",
    "rad/s": "rad/s, deg/s, deg/h, rpm",
    "m": "m, mm, cm, km",
    "N": "N, mN, kN",
    "N m": "N m, mN m, kN m",
    "kg": "kg, g",
    "-": "%, or without a unit",
}
_SPELLINGS = str.maketrans({"°": "deg", "µ": "u", "μ": "u", "·": " ", "*": " ", "²": "^2"})
ABOVE = "unit of the section"  # marks a key in the unit of its section's own key
_SYSTEM = "units"  # key of a section with the system of units in which its numbers are
_QUANTITY = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\D.{,40})")
_FACTOR = re.compile(
    r"(/?)\s*(sqrt(?=\()|√)?(?:\(([^()]{1,8})\)|([A-Za-z%]+|1(?=/)))"
    r"(?:\^?(-?[1-4]))?(?:\s+|-(?=[A-Za-z])|(?=/)|$)"
)
_BRACKETS = re.compile(r"\[([^\]]+)\]")
_EXAMPLE = re.compile(r"`[^`]*`")
_NOTHING: Mapping[str, Any] = {}
Path = tuple[str, ...]


def units_in(words: str, beside: Mapping[str, Any] = _NOTHING) -> tuple[str, ...]:
    """Return the units that the words of a key name in brackets: `[rad or m]` are two.

    `[N or lb; torque: N m or lb ft]` are those of a section of kind `torque`, and of the others.
    An example, between backticks, may have brackets of its own.

    Args:
        words: description of the key.
        beside: values of its section; without a `kind` the units of all kinds are returned.
    """
    found = _BRACKETS.search(_EXAMPLE.sub("", words))
    groups = [part.rpartition(": ") for part in found.group(1).split("; ")] if found else []
    kinds = {kind: units for kind, _, units in groups}
    kind = beside.get("kind")
    kind = kind if isinstance(kind, str) and kind in kinds else ""
    chosen = [kinds[kind]] if "kind" in beside and kind in kinds else kinds.values()
    return tuple(dict.fromkeys(unit for one in chosen for unit in re.split(r" or |, ", one)))


def in_si(value: Any, units: Iterable[str]) -> Any:
    """Return a quantity as a number in that of these units which is of its kind.

    Each entry of a list is converted; anything else is returned as it is, also a quantity in one
    of several systems of units, which only its whole section decides.

    Raises:
        BadInput: it is a quantity of another kind; with the units that are allowed.
    """
    if isinstance(value, list):
        return [in_si(one, units) for one in value]
    match = _matched(value)
    if match is None:
        return value
    sizes, known = _sizes(match[2]), [unit for unit in units if _sizes(unit)]
    factors = {sizes[k] / s for k, s in map(_first, known) if k in sizes}
    if len(factors) > 1:
        return value
    if not factors:
        usual = ", ".join(dict.fromkeys(_USUAL.get(unit, unit) for unit in known))
        words = f"a number in {usual}" if usual else "a number without a unit"
        raise BadInput(f"give {words}", value=value)
    number = float(match[1]) * factors.pop()
    if not isfinite(number):
        raise BadInput("give a finite number", value=value)
    return number


def _first(unit: str) -> tuple[_Kind, float]:
    """Return the kind and the size of a unit of a key; of several meanings the first."""
    return next(iter(_sizes(unit).items()))


def names_of(unit: str) -> list[str]:
    """Return all symbols, without products, of the kind of a unit; of ABOVE those of any kind."""
    kind = next(iter(_sizes(unit)), None)
    prefixed = (prefix + symbol for symbol in _PREFIXED for prefix in _PREFIXES)
    every = dict.fromkeys((*_BASES, *_SYMBOLS, *prefixed))
    return [name for name in every if name != "-" and (unit == ABOVE or kind in _sizes(name))]


@cache
def _sizes(unit: str) -> dict[_Kind, float]:
    """Return the size of a unit in the bases, by the kinds that it may have; empty: no unit."""
    text = unit.translate(_SPELLINGS).strip()
    if text in _BASES:
        return {tuple(float(text == base) for base in _BASES): 1.0}
    if text in _SYMBOLS:
        return {k: s * size for s, one in _SYMBOLS[text] for k, size in _sizes(one).items()}
    if text[1:] in _PREFIXED and text[0] in _PREFIXES:
        return {kind: _PREFIXES[text[0]] * size for kind, size in _sizes(text[1:]).items()}
    product, place = {_NONE: 1.0}, 0
    while place < len(text):
        factor = _FACTOR.match(text, place)
        if factor is None or factor[4] == text:
            return {}
        slash, root, group, symbol, exponent = factor.groups()
        power = int(exponent or 1) * (0.5 if root else 1.0) * (-1.0 if slash else 1.0)
        sizes = {_NONE: 1.0} if symbol == "1" else _sizes(symbol or group)
        before, product, place = product, {}, factor.end()
        for (one, size), (other, more) in itertools.product(before.items(), sizes.items()):
            kind = tuple(a + power * b for a, b in zip(one, other, strict=True))
            product.setdefault(kind, size * more**power)
    return product


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
            values = _convert_at(values, path, units_at(kind, path, values))
        except BadInput as error:
            why = error.refusal
            raise BadInput(why.why, source, ".".join(path), why.value) from None
    return values


def units_at(kind: Any, path: Path, values: Any) -> tuple[str, ...]:
    """Return the units of the key at a place, one of a kind: that of its section's system.

    Args:
        kind: the section, or any type that holds sections.
        path: keys and places in lists, from the top on.
        values: data from YAML, which select one of several sections, and a system of units.
    """
    kinds: list[Any] = [kind]
    units: tuple[str, ...] = ()
    system = "si"
    for part in path:
        beside = values if isinstance(values, dict) else {}
        system = beside.get(_SYSTEM, system)
        sections = [owner for one in kinds for owner in _sections(one)]
        sections = [owner for owner in sections if _has_key(owner, part, beside)]
        if sections:
            named = [units_in(describe_section(owner)[part].words, beside) for owner in sections]
            key_units = tuple(dict.fromkeys(unit for one in named for unit in one))
            units = units if key_units == (ABOVE,) else key_units
            kinds = [get_type_hints(owner, include_extras=True)[part] for owner in sections]
        items = enumerate(values) if isinstance(values, list | tuple) else beside.items()
        values = next((value for key, value in items if str(key) == part), None)
    given = units if system == "si" else units[::-1]
    return tuple({_first(u)[0] if _sizes(u) else u: u for u in reversed(given)}.values())[::-1]


def _has_key(owner: type[Any], key: str, beside: Mapping[str, Any]) -> bool:
    """Return whether a section has a key, and is of the kind that its values name."""
    names = {item.name for item in fields(owner)}
    kinds = get_args(get_type_hints(owner)["kind"]) if "kind" in names else ()
    return key in names and ("kind" not in beside or not kinds or beside["kind"] in kinds)


def _sections(kind: Any) -> list[type[Any]]:
    if isinstance(kind, type) and is_dataclass(kind):
        return [kind]
    return [found for part in get_args(kind) for found in _sections(part)]


def _matched(value: Any) -> re.Match[str] | None:
    match = _QUANTITY.fullmatch(value.strip()) if isinstance(value, str) else None
    return match if match and _sizes(match[2]) else None


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
