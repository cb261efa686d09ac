"""The derivatives of the equations against central differences."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from tests.plant.testbeds.spacecraft.crafts import (
    mass_and_bias,
    random_craft,
    random_gyro,
    random_state,
)

from flexslew_lab.reproduce.scole_flights import example_trial
from flexslew_plant.testbeds.spacecraft.assembly.packing import packed
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.equations.jacobian import residual_jacobian

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
    gyros = tuple(random_gyro(np.random.default_rng(k)) for k in range(seed % 3))
    craft = replace(craft, gyros=gyros)
    p, x = packed(craft), random_state(craft, seed)
    nq, nv = craft.sizes
    rng = np.random.default_rng(seed)
    a, t = rng.standard_normal(nv), 0.7

    def residual(state: np.ndarray) -> np.ndarray:
        mass, bias = mass_and_bias(p, t, state, nv)
        return mass @ a + bias

    dq, dv = np.empty((nv, nq)), np.empty((nv, nv))
    residual_jacobian(p, t, x, a, dq, dv)
    expected = differences(residual, x)
    size = max(1.0, abs(expected).max())
    np.testing.assert_allclose(np.hstack((dq, dv)), expected, atol=1e-7 * size)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_jacobian_of_a_free_platform_is_that_of_its_tangent_space(seed: int) -> None:
    testbed = example_trial("own_spacecraft").testbed
    model = testbed.model()
    rng = np.random.default_rng(seed)
    x = 0.2 * rng.standard_normal(model.positions + model.coordinates)
    x[3:7] = rng.standard_normal(4)
    x[3:7] /= np.linalg.norm(x[3:7])
    effort, dt = rng.standard_normal(model.efforts), 5e-4
    n, split = model.coordinates, model.positions
    dx, du = model.jacobian(x, effort)

    def moved(change: np.ndarray, more: np.ndarray) -> np.ndarray:
        rate = model.position_rates(x[:split])
        there = np.concatenate((x[:split] + rate @ change[:n], x[split:] + change[n:]))
        there[3:7] /= np.linalg.norm(there[3:7])
        return model.advance(there, effort + more, dt)

    size, nothing = 1e-4, np.zeros(model.efforts)
    after = model.advance(x, effort, dt)
    back = np.linalg.pinv(model.position_rates(after[:split]))

    def column(change: np.ndarray, more: np.ndarray) -> np.ndarray:
        ahead = (moved(change, more) - moved(-change, -more)) / (2.0 * size)
        return np.concatenate((back @ ahead[:split], ahead[split:]))

    found = np.column_stack([column(size * e, nothing) for e in np.eye(2 * n)])
    middle = 0.5 * (dx + model.jacobian(after, effort)[0])
    expected = expm(dt * middle)  # of the flight over one step, to third order in it
    scale = abs(expected).max()
    np.testing.assert_allclose(found, expected, atol=1e-6 * scale)
    pushed = np.column_stack([column(np.zeros(2 * n), size * e) for e in np.eye(model.efforts)])
    np.testing.assert_allclose(pushed[n:], dt * du[n:], atol=2e-2 * dt * abs(du).max())
