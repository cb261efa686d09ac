"""The model of a black box: names, units and sizes, and no equations."""

import numpy as np

from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.appendages import Appendages
from flexslew_plant.testbeds.contract import require_no_payload
from flexslew_plant.testbeds.kernels import NO_EQUATIONS
from flexslew_plant.testbeds.model import Model
from flexslew_plant.testbeds.scene import Scene, schematic


def black_box_model(
    joints: tuple[str, ...],
    joint_units: tuple[str, ...],
    tips: tuple[str, ...],
    tip_units: tuple[str, ...],
) -> Model:
    """Return the model of a plant with one effort per joint and with readings at its tips.

    The readings take the place of the modal coordinates, one each (see contract.BlackBox).
    Whatever needs equations raises a BadInput.

    Args:
        joints: names, in the order of the efforts and positions.
        joint_units: rad or m, per joint.
        tips: names of the readings besides those of the joints.
        tip_units: of each, empty for a plain number.
    """
    count = len(tips)
    appendages = Appendages(tips, np.eye(count), np.zeros((count, count)), units=tip_units)
    return Model(NO_EQUATIONS, np.zeros(0), joints, joint_units, count, appendages)


def black_box_scene(
    kind: str, joints: tuple[str, ...], joint_units: tuple[str, ...], tips: tuple[str, ...]
) -> Scene:
    """Return a schematic drawing, in which every tip moves by its own reading."""
    return schematic(kind, joints, tips, np.eye(len(tips)), joint_units)


def require_unscaled(kind: str, name: str, stiffness: float, payload: float) -> None:
    """Check that a black box is used as it is: its own `parameters` change it.

    Args:
        kind: of the testbed.
        name: for the message, as "an FMU".
        stiffness: requested factor.
        payload: likewise.

    Raises:
        BadInput: if another stiffness or payload is requested.
    """
    require_no_payload(kind, payload)
    if stiffness != 1.0:
        words = f"{name} has no such key; change its `parameters`"
        raise BadInput(words, key="stiffness", value=stiffness)
