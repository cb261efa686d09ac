"""The public numbers of SCOLE-S and of the full-scale SCOLE (Sung and Joo)."""

import numpy as np
from scipy.linalg import eigh
from tests.plant.testbeds.spacecraft.crafts import mass_and_bias
from tests.plant.testbeds.spacecraft.scole import FULL, SMALL, scole

from flexslew_plant.testbeds.spacecraft.assembly.packing import packed
from flexslew_plant.testbeds.spacecraft.units import UNITS

UNIT = UNITS["slug_ft_lb"]


def test_the_mast_s_clamped_frequencies_and_damping_ratios() -> None:
    mast = scole(SMALL).appendages[0]
    omega = np.sqrt(mast.stiffness / mast.mass)
    hertz = omega[:4] / (2.0 * np.pi)
    np.testing.assert_allclose(hertz[:3], [0.95629, 1.02209, 2.4668], rtol=1.3e-5)
    np.testing.assert_allclose(hertz[3], 4.398, rtol=5e-4)  # printed with four digits
    ratios = np.diag(mast.damping)[:3] / (2.0 * omega[:3] * mast.mass[:3])
    np.testing.assert_allclose(ratios, [0.015437, 0.016444, 0.038909], rtol=4e-5)


def test_the_total_inertia_about_the_shuttle_s_centre() -> None:
    _, _, inertia = scole(SMALL).rigid()
    found = inertia / UNIT.torque
    expected = {(0, 0): 75.0, (0, 1): 0.4717, (0, 2): -7.1748, (1, 1): 441.154, (2, 2): 443.383}
    for (i, j), value in expected.items():
        assert abs(found[i, j] - value) < 5e-5 + 3e-6 * abs(value)


def test_the_full_scale_free_free_frequencies() -> None:
    craft = scole(FULL, modes=10)
    nq, nv = craft.sizes
    x = np.zeros(nq + nv)
    x[6] = 1.0
    mass, _ = mass_and_bias(packed(craft), 0.0, x, nv)
    stiffness = np.zeros((nv, nv))
    stiffness[6:, 6:] = np.diag(craft.appendages[0].stiffness)
    hertz = np.sqrt(eigh(stiffness, mass, eigvals_only=True)[6:11]) / (2.0 * np.pi)
    np.testing.assert_allclose(hertz, [0.2781, 0.3138, 0.8117, 1.1851, 2.0507], rtol=3e-4)
    np.testing.assert_allclose(hertz[:2], [0.278, 0.314], rtol=1e-3)  # published
