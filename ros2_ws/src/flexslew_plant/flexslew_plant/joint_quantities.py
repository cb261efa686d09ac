"""Quantities by joint: `30 cm` is no position of a joint that turns."""

from collections.abc import Iterator, Mapping
from typing import Any

from flexslew_plant.errors import BadInput
from flexslew_plant.keys.units import in_si, is_quantity, units_at
from flexslew_plant.testbeds import Testbed
from flexslew_plant.testbeds.model import Model

# of each kind, that of a joint that turns and of one that slides
_KINDS = (
    ("rad", "m"), ("rad/s", "m/s"), ("rad/s^2", "m/s^2"), ("N m", "N"), ("N m/s", "N/s"),
    ("N m/rad", "N/m"), ("N m s/rad", "N s/m"), ("kg m^2", "kg"), ("rad/m", "-"),
)  # fmt: skip


def require_units_of_joints(kind: Any, values: Any, testbed: Testbed, source: str) -> None:
    """Check that no position, rate or effort of a joint is given in a unit of the other kind.

    A joint is named by a key above, or by a value next to the quantity; without one the kinds of
    all joints are allowed. Next to a `channel` of sensors the units of its readings are.

    Args:
        kind: settings class, which names units such as `[rad or m]`.
        values: the data from YAML.
        testbed: testbed with the named joints.
        source: the file to name in an error.

    Raises:
        BadInput: the first that is, with the units that are allowed.
    """
    model: Model | None = None
    for path, value, context in _quantities(values, (), {}):
        named = units_at(kind, path, values)
        pairs = [pair for pair in _KINDS if set(pair) <= set(named)]
        if not pairs:
            continue
        model = model or testbed.model()
        units = model.units_by_joint
        candidate_names = [
            *reversed(path),
            *(name for name in context.values() if isinstance(name, str)),
        ]
        joint = next((name for name in candidate_names if name in units), None)
        if "channel" in context:
            allowed = _read_by(model, str(context["channel"]), str(context.get("of")))
        else:
            joint_units = units.values() if joint is None else (units[joint],)
            kinds = sorted({unit == "m" for unit in joint_units})
            allowed = [pair[is_linear] for pair in pairs for is_linear in kinds]
        try:
            in_si(value, allowed)
        except BadInput as error:
            raise BadInput(error.refusal.why, source, ".".join(path), value) from None


def _read_by(model: Model, channel: str, of: str) -> list[str]:
    """Return the units of what a channel of sensors reads, of all or of one joint or appendage."""
    if channel.startswith("joint"):
        per = "/s" if channel == "joint_velocity" else ""
        names, units = model.joint_names, tuple(f"{unit}{per}" for unit in model.joint_units)
    else:
        names = model.appendages.names
        tips = model.appendages.units or ("m",) * len(names)
        units = tips if channel == "tip_deflection" else ("1/m",) * len(names)
    return [unit for name, unit in zip(names, units, strict=True) if name == of or of not in names]


def _quantities(
    values: Any, path: tuple[str, ...], context: Mapping[str, Any]
) -> Iterator[tuple[tuple[str, ...], str, Mapping[str, Any]]]:
    """Yield where a text names a number with a unit, and the section that it stands in."""
    items = values.items() if isinstance(values, dict) else enumerate(values)
    for key, value in items:
        place, section = (*path, str(key)), values if isinstance(values, dict) else context
        if isinstance(value, dict | list):
            yield from _quantities(value, place, section)
        elif is_quantity(value):
            yield place, value, section
