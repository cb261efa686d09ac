"""Quantities by joint: `30 cm` is no position of a joint that turns."""

from collections.abc import Iterator
from typing import Any

from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import Testbed
from flexslew_plant.units import in_si, is_quantity, units_at

# of each kind, that of a joint that turns and of one that slides
_KINDS = (("rad", "m"), ("rad/s", "m/s"), ("N m", "N"))


def require_units_of_joints(kind: Any, values: Any, testbed: Testbed, source: str) -> None:
    """Check that no position, rate or effort of a joint is given in a unit of the other kind.

    Where no joint is named the kinds of all joints are allowed.

    Args:
        kind: of the settings, which names units such as `[rad or m]`.
        values: what YAML gave.
        testbed: whose joints are named.
        source: the file to name in an error.

    Raises:
        BadInput: the first that is, with the units that are allowed.
    """
    units: dict[str, str] | None = None
    for path, value in _quantities(values, ()):
        named = units_at(kind, path)
        pairs = [pair for pair in _KINDS if set(pair) <= set(named)]
        if not pairs:
            continue
        if units is None:
            model = testbed.model()
            units = dict(zip(model.joint_names, model.joint_units, strict=True))
        joint = next((part for part in reversed(path) if part in units), None)
        meant = units.values() if joint is None else (units[joint],)
        kinds = sorted({unit == "m" for unit in meant})
        try:
            in_si(value, [pair[slides] for pair in pairs for slides in kinds])
        except BadInput as error:
            raise BadInput(error.refusal.why, source, ".".join(path), value) from None


def _quantities(values: Any, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], str]]:
    """Yield where a text names a number with a unit."""
    inside = values.items() if isinstance(values, dict) else enumerate(values)
    for key, value in inside:
        place = (*path, str(key))
        if isinstance(value, dict | list):
            yield from _quantities(value, place)
        elif is_quantity(value):
            yield place, value
