"""The exact solution: SciPy's exponential of the whole matrix at any tick, sizes of benchmarks."""

from typing import Any

import numpy as np
import pytest
from scipy.linalg import block_diag, expm
from tests.linear_plants import CD_PLAYER, SPACE_STATION, drawn_plant, modal_plant

from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.linear.motion import scale_stiffness


def model_of(keys: Any) -> Any:
    return read_testbed(keys, "here").model()


def flown(model: Any, plant: Any, period: float, ticks: int = 200) -> float:
    """Return the largest error of the joints over a flight with random efforts, of the largest."""
    rng, (f, g) = np.random.default_rng(4), plant.held(period)
    x, z = np.zeros(2 * model.coordinates), np.zeros(len(plant.a))
    error, size = 0.0, 0.0
    for _ in range(ticks):
        effort = rng.standard_normal(model.efforts)
        x, z = model.advance(x, effort, period), f @ z + g @ effort
        read = plant.c @ z
        error = max(error, float(abs(model.joint_state(x)[0] - read).max()))
        size = max(size, float(abs(read).max()))
    return error / size


@pytest.mark.parametrize("period", [1e-4, 0.01, 3.0])
def test_a_tick_is_the_exponential_of_the_whole_matrix(period: float) -> None:
    model = model_of({"kind": "linear"})
    linear = model.linearise(model.rest({}))
    a, b = linear.state_matrix, linear.state_input_matrix
    whole = expm(np.block([[a, b], [np.zeros((1, 5))]]) * period)
    x, effort = np.array([0.1, 0.2, 0.3, 0.4]), np.array([2.0])
    np.testing.assert_allclose(
        model.advance(x, effort, period), whole[:4, :4] @ x + whole[:4, 4] * 2.0, rtol=1e-10
    )
    f, g = model.held_maps(period)
    np.testing.assert_allclose(f, whole[:4, :4], atol=1e-10)
    np.testing.assert_allclose(g, whole[:4, 4:], atol=1e-10)
    np.testing.assert_allclose(model.advance(model.advance(x, effort, period), effort, -period), x)


@pytest.mark.parametrize(
    ("size", "rigid", "period"),
    [(SPACE_STATION, 0, 0.01), (SPACE_STATION, 3, 0.01), (CD_PLAYER, 0, 0.001)],
)
def test_the_sizes_of_public_benchmarks_move_as_their_modes_do(
    size: Any, rigid: int, period: float
) -> None:
    plant = drawn_plant(size[0], size[1], size[2], rigid=rigid)
    model = model_of(plant.keys(size[1]))
    assert model.coordinates == size[0]
    assert flown(model, plant, period) < 1e-9


def test_efforts_that_push_beside_the_joints_move_them_as_given() -> None:
    rng, (modes, joints, band) = np.random.default_rng(2), CD_PLAYER
    plant = drawn_plant(modes, joints, band)
    beside = plant._replace(b=plant.b + 0.1 * rng.standard_normal(plant.b.shape) * (plant.b != 0.0))
    model = model_of(beside.keys(joints))
    assert not model.has_efforts_in_joints
    assert flown(model, beside, 0.001) < 1e-9


def test_poles_that_no_pair_has_are_integrated_as_well() -> None:
    """A spring with two dampers: real poles of 1 and 900 1/s beside a mode, and a chain."""
    pairs = ([-900.0, -901.0], [-4.0, -0.1], [0.0, 0.0])
    a = block_diag(*(np.array([[0.0, 1.0], pair]) for pair in pairs))
    b, c = np.array([[0.0, 0.5, 0.0, 1.0, 0.0, 0.1]]).T, np.array([[0.5, 0.0, 1.0, 0.0, 0.1, 0.0]])
    keys = {"kind": "linear", "system": {"a": a.tolist(), "b": b.tolist(), "c": c.tolist()}}
    model, whole = model_of(keys), expm(np.block([[a, b], [np.zeros((1, 7))]]) * 0.02)
    x, z = np.zeros(6), np.zeros(6)
    for k in range(100):
        effort = np.array([np.cos(0.3 * k)])
        x, z = model.advance(x, effort, 0.02), whole[:6, :6] @ z + whole[:6, 6] * effort
    assert model.joint_state(x)[0] == pytest.approx(c @ z, rel=1e-10)
    assert model.joint_state(x)[1] == pytest.approx(c @ a @ z, rel=1e-10)


def test_a_scaled_stiffness_scales_time() -> None:
    """With K times f, D times the root of f: q(t) of efforts u is that of u / f at t sqrt(f)."""
    plant = modal_plant([2.0, 5.0], [[0.1], [0.2]], 0.02)
    model, stiff = (model_of(plant.keys(1, stiffness=factor)) for factor in (1.0, 4.0))
    x, effort = np.zeros(4), np.ones(1)
    before = model.advance(x, effort, 1.4)
    after = stiff.advance(x, 4.0 * effort, 0.7)
    np.testing.assert_allclose(after, before * [1.0, 1.0, 2.0, 2.0], rtol=1e-10)
    np.testing.assert_allclose(scale_stiffness(model.packed, 4.0), stiff.packed, atol=1e-12)
