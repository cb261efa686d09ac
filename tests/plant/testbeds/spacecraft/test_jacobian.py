"""The derivatives of the equations against central differences."""

from collections.abc import Callable

import numpy as np
import pytest
from tests.plant.testbeds.spacecraft.crafts import mass_and_bias, random_craft, random_state

from flexslew_plant.testbeds.spacecraft.assembly.packing import packed
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.equations.actuation import actuation, actuation_jacobian
from flexslew_plant.testbeds.spacecraft.equations.jacobian import residual_jacobian
from flexslew_plant.testbeds.spacecraft.equations.kinematics import (
    kinematics,
    kinematics_jacobian,
)

STEP = 1e-6


def differences(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    columns = []
    for k in range(x.size):
        d = np.zeros(x.size)
        d[k] = STEP
        columns.append((f(x + d) - f(x - d)) / (2.0 * STEP))
    return np.array(columns).T


@pytest.mark.parametrize("motion", [at.FREE, at.HELD, at.PIVOT])
@pytest.mark.parametrize("seed", range(6))
def test_the_residual_s_derivatives_are_exact(seed: int, motion: int) -> None:
    craft = random_craft(seed, seed % 5, motion, (0, 1, 2))
    p, x = packed(craft), random_state(craft, seed)
    nq, nv = craft.sizes
    rng = np.random.default_rng(seed)
    a, effort, t = rng.standard_normal(nv), rng.standard_normal(len(craft.drives)), 0.7

    def residual(state: np.ndarray) -> np.ndarray:
        mass, bias = mass_and_bias(p, t, state, nv)
        force = np.zeros(nv)
        actuation(p, t, state, effort, force)
        return mass @ a + bias - force

    dq, dv = np.empty((nv, nq)), np.empty((nv, nv))
    residual_jacobian(p, t, x, a, dq, dv)
    actuation_jacobian(p, t, x, effort, dq)
    expected = differences(residual, x)
    size = max(1.0, abs(expected).max())
    np.testing.assert_allclose(np.hstack((dq, dv)), expected, atol=1e-7 * size)


def test_the_kinematics_derivatives_are_exact() -> None:
    craft = random_craft(3, 2)
    p, x = packed(craft), random_state(craft, 3)
    nq, nv = craft.sizes

    def rates(state: np.ndarray) -> np.ndarray:
        rate = np.empty(nq)
        kinematics(p, 0.0, state, rate)
        return rate

    dq, dv = np.empty((nq, nq)), np.empty((nq, nv))
    kinematics_jacobian(p, 0.0, x, dq, dv)
    np.testing.assert_allclose(np.hstack((dq, dv)), differences(rates, x), atol=1e-8)
