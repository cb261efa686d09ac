"""The CSA testbed as the planar special case of the spacecraft."""

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from tests.plant.testbeds.spacecraft.crafts import fly

from flexslew_plant.testbeds.csa import CsaTestbed, beam
from flexslew_plant.testbeds.spacecraft.assembly.craft import (
    Appendage,
    Spacecraft,
    SpacecraftActuator,
)
from flexslew_plant.testbeds.spacecraft.assembly.packing import packed
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.shapes.integrals import Points, integrals_of, second_of

MODES = 2
TESTBED = CsaTestbed(modes=MODES)
Z, Y = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])


def hub(hinge_axis: np.ndarray, extra: float) -> Appendage:
    """Return the hub with both beams on a driven hinge, and an extra inertia about z."""
    p, b = TESTBED.parameters, beam(TESTBED)
    x, w = leggauss(16)
    edges = np.linspace(0.0, p.length, 4 * MODES + 1)
    h = np.diff(edges)[:, None]
    s = (edges[:-1, None] + h * (1.0 + x) / 2.0).ravel()
    mass = (p.linear_density * h * w / 2.0).ravel()
    phi = b.shape(s).T  # (k, modes)
    place, shape = np.zeros((s.size, 3)), np.zeros((s.size, 3, MODES))
    place[:, 0], shape[:, 1] = p.hub_radius + s, phi
    straight = np.zeros((s.size, 3, MODES, MODES))
    both = Points(place, mass, shape, straight).extend(Points(-place, mass, -shape, straight))
    i = integrals_of(both).first_order()  # the CSA model has no terms of second order
    own = np.diag([p.hub_inertia_1, p.hub_inertia_2, p.hub_inertia_1 + extra])
    i = i.__class__(i.mass, i.first, i.second + second_of(own), *list(vars(i).values())[3:])
    modal = 2.0 * p.linear_density * b.integral(0, 2, 0)
    stiffness = 2.0 * p.bending_stiffness * b.integral(0, 2, 2)
    still = np.zeros((MODES, MODES))
    return Appendage(
        "hub",
        i,
        modal,
        stiffness,
        still,
        np.zeros(3),
        np.eye(3),
        at.DRIVEN,
        hinge_axis,
        second_order=False,
    )


def torques(rng: np.random.Generator) -> list[np.ndarray]:
    return [60.0 * rng.standard_normal(2) for _ in range(20)]


def test_a_pivoted_platform_with_a_hub_on_a_hinge_is_the_csa_testbed() -> None:
    base = np.eye(3) * TESTBED.parameters.base_inertia
    drives = (SpacecraftActuator("yaw", at.TORQUE, -1, Z), SpacecraftActuator("pitch", at.HINGE, 0))
    craft = Spacecraft(1.0, np.zeros(3), base, (hub(Y, 0.0),), (), drives, at.PIVOT, Z)
    compare(packed(craft), [0, 1], np.array([0.2, 0.3]))


def test_a_held_platform_with_a_hub_that_turns_is_the_csa_testbed_in_the_plane() -> None:
    part = hub(Z, TESTBED.parameters.base_inertia)
    drives = (SpacecraftActuator("yaw", at.HINGE, 0),)
    craft = Spacecraft(1.0, np.zeros(3), np.eye(3), (part,), (), drives, at.HELD)
    compare(packed(craft), [0], np.array([0.2, 0.0]))


@pytest.mark.filterwarnings("error")
def compare(p: np.ndarray, joints: list[int], start: np.ndarray) -> None:
    """Fly both for 100 s under the same random torques and compare all coordinates."""
    model = TESTBED.model()
    n = 2 + MODES
    x = np.concatenate((start, np.zeros(n + MODES)))
    kept = [*joints, *range(2, n)]
    y = x[[*kept, *(n + k for k in kept)]]
    for effort in torques(np.random.default_rng(4)):
        effort = effort * np.isin([0, 1], joints)
        x = model.advance(x, effort, 5.0, 100)
        y = fly(p, 0.0, y, effort[joints], len(kept), 0.05, 100)
        expected = x[[*kept, *(n + k for k in kept)]]
        np.testing.assert_allclose(y, expected, rtol=0, atol=1e-9 * max(1.0, abs(expected).max()))
