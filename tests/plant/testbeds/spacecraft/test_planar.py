"""The CSA testbed as the planar special case of the spacecraft."""

import numpy as np
import pytest
from tests.plant.testbeds.spacecraft.crafts import csa_hub, fly

from flexslew_plant.testbeds.csa import CsaTestbed
from flexslew_plant.testbeds.spacecraft.assembly.craft import (
    Spacecraft,
    SpacecraftActuator,
)
from flexslew_plant.testbeds.spacecraft.assembly.packing import packed
from flexslew_plant.testbeds.spacecraft.equations import layout as at

MODES = 2
TESTBED = CsaTestbed(modes=MODES)
Z, Y = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])


def torques(rng: np.random.Generator) -> list[np.ndarray]:
    return [60.0 * rng.standard_normal(2) for _ in range(20)]


def test_a_pivoted_platform_with_a_hub_on_a_hinge_is_the_csa_testbed() -> None:
    base = np.eye(3) * TESTBED.parameters.base_inertia
    drives = (SpacecraftActuator("yaw", at.TORQUE, -1, Z), SpacecraftActuator("pitch", at.HINGE, 0))
    craft = Spacecraft(
        1.0, np.zeros(3), base, (csa_hub(TESTBED, Y, False),), (), drives, at.PIVOT, Z
    )
    compare(packed(craft), [0, 1], np.array([0.2, 0.3]))


def test_a_held_platform_with_a_hub_that_turns_is_the_csa_testbed_in_the_plane() -> None:
    part = csa_hub(TESTBED, Z, False, TESTBED.parameters.base_inertia)
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
