"""Which testbeds there are. A new one is a file with kernels, a line here and in dynamics.py."""

from collections.abc import Callable
from typing import Annotated, Any, NamedTuple, TypeAlias

from pydantic import Discriminator, Tag

from flexslew_plant.arrays import Vector
from flexslew_plant.testbeds import csa, floating_oscillator, hub_with_appendages
from flexslew_plant.testbeds.csa import CsaTestbed
from flexslew_plant.testbeds.floating_oscillator import FloatingOscillatorTestbed
from flexslew_plant.testbeds.hub_with_appendages import HubTestbed
from flexslew_plant.testbeds.model import Model


def _kind(section: Any) -> str:
    """Return the tag of a `testbed` section; the CSA testbed where `kind` is left out."""
    if isinstance(section, dict):
        return str(section.get("kind", "csa"))
    return str(getattr(section, "kind", "csa"))


# the union of the `testbed` sections, told apart by `kind`
Testbed: TypeAlias = Annotated[
    Annotated[CsaTestbed, Tag("csa")]
    | Annotated[FloatingOscillatorTestbed, Tag("floating_oscillator")]
    | Annotated[HubTestbed, Tag("hub_with_appendages")],
    Discriminator(_kind),
]


class _Kind(NamedTuple):
    number: int
    joint_names: tuple[str, ...]
    joint_units: tuple[str, ...]
    packed: Callable[[Any], Vector]
    stiffness_scaled: Callable[[Vector, float], Vector]


TESTBEDS: dict[str, _Kind] = {
    "csa": _Kind(csa.KIND, csa.JOINTS, csa.JOINT_UNITS, csa.packed, csa.packed_frequency_scale),
    "floating_oscillator": _Kind(
        floating_oscillator.KIND,
        floating_oscillator.JOINTS,
        floating_oscillator.JOINT_UNITS,
        floating_oscillator.packed,
        floating_oscillator.packed_frequency_scale,
    ),
    "hub_with_appendages": _Kind(
        hub_with_appendages.KIND,
        hub_with_appendages.JOINTS,
        hub_with_appendages.JOINT_UNITS,
        hub_with_appendages.packed,
        hub_with_appendages.packed_frequency_scale,
    ),
}


def build_model(testbed: Testbed) -> Model:
    """Return the equations of motion that a `testbed` section describes."""
    kind = TESTBEDS[testbed.kind]
    return Model(
        kind.number, kind.packed(testbed), kind.joint_names, kind.joint_units, testbed.modes
    )


def with_stiffness(model: Model, factor: float) -> Model:
    """Return model with every appendage's stiffness times factor [-], damping ratio kept."""
    scaled = next(kind for kind in TESTBEDS.values() if kind.number == model.kind)
    packed = scaled.stiffness_scaled(model.packed, factor)
    return Model(model.kind, packed, model.joint_names, model.joint_units, model.modes)
