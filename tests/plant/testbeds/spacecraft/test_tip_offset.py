"""Where a bent beam carries its tip body, against an inextensible rod that is bent exactly.

The curvatures and the twist rate of the rod are those of the modes, so its strain energy is the
model's; its frame follows R' = R [kappa]x from the clamp.
"""

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexslew_plant.arrays import Vector
from flexslew_plant.testbeds.spacecraft.shapes.beam import (
    ClampedBeam,
    TipBody,
    finite_element_beam,
)
from flexslew_plant.testbeds.spacecraft.shapes.integrals import second_order_rotation
from flexslew_plant.testbeds.spacecraft.shapes.shape import FlexibleShape

LENGTH, STEPS = 3.0, 300
BEAM = ClampedBeam(LENGTH, 0.5, 200.0, 300.0, 100.0, 0.01)
OFFSET = np.array([0.3, 0.2, 0.0])  # [m]


def carried(offset: Vector) -> FlexibleShape:
    """Return the beam with a body at an offset from its end."""
    tip = TipBody(5.0, np.diag([0.3, 0.3, 0.4]), offset)
    return finite_element_beam(BEAM, tip, 8, 3)


def error(offset: Vector, mode: int, deflection: float) -> float:
    """Return how far the body's place is off for a deflection of the end in one mode [m]."""
    along = carried(offset).along
    assert along is not None
    end = along.point(LENGTH)
    q = deflection / float(np.linalg.norm(end.displacement[:, mode]))
    turns = [along.point(float(s)).turn[:, mode] * q for s in np.linspace(0.0, LENGTH, STEPS + 1)]
    place, frame, bent = np.zeros(3), np.eye(3), 0.0
    for before, after in pairwise(turns):
        half = Rotation.from_rotvec(0.5 * (after - before)).as_matrix()
        place = place + LENGTH / STEPS * (frame @ half)[:, 2]
        frame = frame @ half @ half
        middle = 0.5 * (before + after)
        bent += 0.5 * LENGTH / STEPS * float(middle[:2] @ middle[:2])
    turn = end.turn[:, mode] * q
    second = 0.5 * q * q * second_order_rotation(end.turn, offset)[:, mode, mode]
    second = second - np.array([0.0, 0.0, bent])
    linear = end.displacement[:, mode] * q + np.cross(turn, offset)
    return float(np.abs(place + frame @ offset - (end.place + offset + linear + second)).max())


@pytest.mark.parametrize("mode", [0, 1])
def test_a_body_on_the_end_is_placed_to_second_order(mode: int) -> None:
    errors = [error(np.zeros(3), mode, deflection) for deflection in (0.1, 0.05)]
    assert errors[0] < 5e-5
    assert errors[0] / errors[1] == pytest.approx(8.0, rel=0.05)


@pytest.mark.parametrize(("mode", "most"), [(0, 3.6e-4), (1, 7.0e-4)])
def test_a_body_off_the_end_is_misplaced_by_what_the_docs_state(mode: int, most: float) -> None:
    """Bending and twist together move it in second order, which the model leaves out."""
    errors = [error(OFFSET, mode, deflection) for deflection in (0.1, 0.05)]
    assert 0.9 * most < errors[0] < most
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)
