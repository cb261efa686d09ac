"""Which testbeds there are. A new one is a file with kernels, a line here and one in dynamics.py."""

from collections.abc import Callable
from typing import Any, NamedTuple

from flexslew_plant import csa
from flexslew_plant.csa import CsaTestbed
from flexslew_plant.model import Model

Testbed = CsaTestbed  # the union of the `testbed` sections, told apart by `kind`


class _Kind(NamedTuple):
    number: int
    joint_names: tuple[str, ...]
    joint_units: tuple[str, ...]
    packed: Callable[[Any], Any]


TESTBEDS: dict[str, _Kind] = {
    "csa": _Kind(csa.KIND, csa.JOINTS, csa.JOINT_UNITS, csa.packed),
}


def build_model(testbed: Testbed) -> Model:
    """Return the equations of motion that a `testbed` section describes."""
    kind = TESTBEDS[testbed.kind]
    return Model(
        kind.number, kind.packed(testbed), kind.joint_names, kind.joint_units, testbed.modes
    )
