"""A finer mesh of a beam is never a worse one."""

import numpy as np
import pytest

from flexslew_plant.testbeds.spacecraft.shapes.beam import (
    ClampedBeam,
    TipBody,
    finite_element_beam,
)

# roots of 1 + cos b cosh b
CANTILEVER = np.array([1.8751040687119611, 4.694091132974175, 7.854757438237613])


@pytest.mark.parametrize("elements", [27, 60, 200])
def test_frequencies_of_a_cantilever_are_as_exact_as_the_mesh_is_fine(elements: int) -> None:
    """Cubic elements of length h miss by (b h)^4 / 1440; 200 missed by 4.6e-5 for rounding."""
    length, density, stiffness = 3.0, 0.7, 55.0
    beam = ClampedBeam(length, density, stiffness, 400.0 * stiffness)
    found = np.sqrt(finite_element_beam(beam, None, elements, 3).stiffness)
    exact = CANTILEVER**2 * np.sqrt(stiffness / density) / length**2
    allowed = (CANTILEVER / elements) ** 4 / 1000.0 + 1e-10
    assert (np.abs(found / exact - 1.0) < allowed).all()


def test_a_slow_twist_of_a_beam_that_hardly_bends_is_exact_on_a_fine_mesh() -> None:
    """B tan b = J L / I with the tip's inertia I; 200 elements missed by 0.3 %."""
    tip = TipBody(0.001, 0.3 * np.eye(3), np.zeros(3))
    beam = ClampedBeam(3.0, 0.7, 1e5, 1e5, 4.0, 0.05)
    (square,) = finite_element_beam(beam, tip, 200, 1).stiffness
    b = 0.6532711870944031  # b tan b = 0.5
    assert abs(np.sqrt(square) / (b * np.sqrt(4.0 / 0.05) / 3.0) - 1.0) < 1e-6


def test_shapes_do_not_depend_on_how_fine_the_mesh_is() -> None:
    """Modal mass one, and what the modes do to the clamp and to a tip off the axis."""
    tip = TipBody(2.0, np.diag([0.3, 0.4, 0.2]), np.array([0.2, -0.1, 0.3]))
    beam = ClampedBeam(4.0, 0.5, 90.0, 60.0, 40.0, 0.02)
    coarse, fine = (finite_element_beam(beam, tip, n, 4) for n in (26, 27))
    for one, other in (
        (coarse.integrals.translation, fine.integrals.translation),
        (coarse.integrals.rotation, fine.integrals.rotation),
        (coarse.tip.displacement, fine.tip.displacement),
        (coarse.tip.turn, fine.tip.turn),
    ):
        np.testing.assert_allclose(other, one, atol=1e-4 * abs(one).max())
