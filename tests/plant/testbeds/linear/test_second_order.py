"""Second-order form: a mechanism comes out as it went in, anything else has the same response."""

from typing import Any

import numpy as np
import pytest
from tests.linear_plants import drawn_plant

from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.linear.second_order import SecondOrder, second_order

S = 0.3 + 1.7j  # where responses are compared [rad/s]


def mechanism(mass: Any, damping: Any, stiffness: Any, joints: int) -> tuple[Any, Any, Any]:
    """Return A, B and the rows of the joints in coordinates that no one would choose."""
    n, rng = len(mass), np.random.default_rng(11)
    inverse = np.linalg.inv(mass)
    a = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ stiffness, -inverse @ damping]])
    b = np.vstack((np.zeros((n, joints)), inverse[:, :joints]))
    turned, _ = np.linalg.qr(rng.standard_normal(a.shape))
    return turned @ a @ turned.T, turned @ b, np.eye(joints, 2 * n) @ turned.T


def response(a: Any, b: Any, c: Any) -> Any:
    return c @ np.linalg.solve(S * np.eye(len(a)) - a, b)


def response_of(form: SecondOrder) -> Any:
    m, n = len(form.joints), len(form.stiffness)
    mass = np.block([[form.joints, form.coupling], [form.coupling.T, np.eye(n - m)]])
    return np.linalg.solve(S * S * mass + S * form.damping + form.stiffness, form.effort)[:m]


def without_outputs(a: Any, b: Any, c: Any) -> SecondOrder:
    return second_order(a, b, c, np.zeros((0, len(a))))


def test_a_free_mechanism_with_clamped_modes_is_found_as_it_was() -> None:
    """To the root of rounding, to which its rigid motions are known apart; its response exactly."""
    rng = np.random.default_rng(1)
    coupling = np.abs(rng.standard_normal((2, 3)))
    joints = np.array([[10.0, 1.0], [1.0, 8.0]]) + coupling @ coupling.T
    mass = np.block([[joints, coupling], [coupling.T, np.eye(3)]])
    w = np.array([2.0, 5.0, 9.0])
    stiffness, damping = np.diag([0.0, 0.0, *w**2]), np.diag([0.0, 0.0, *(0.02 * w)])
    form = without_outputs(*mechanism(mass, damping, stiffness, 2))
    assert form.decoupled
    np.testing.assert_allclose(form.joints, joints, rtol=1e-4)
    np.testing.assert_allclose(form.coupling, coupling, rtol=1e-4)
    np.testing.assert_allclose(form.stiffness, stiffness, atol=1e-3)
    np.testing.assert_array_equal(form.effort, np.eye(5, 2))


def test_a_rigid_body_has_its_effort_in_its_joint() -> None:
    form = without_outputs(*mechanism(np.array([[3.0]]), np.array([[0.7]]), np.zeros((1, 1)), 1))
    assert form.joints == pytest.approx(np.array([[3.0]]))
    assert form.damping == pytest.approx(np.array([[0.7]]))
    np.testing.assert_array_equal(form.effort, np.eye(1))


def test_a_mechanism_on_ground_rests_with_its_modes_at_zero() -> None:
    mass, stiffness = (
        np.diag([1.0, 2.0, 3.0]), np.array([[3.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    )  # fmt: skip
    form = without_outputs(*mechanism(mass, 0.01 * stiffness, stiffness, 1))
    assert form.joints == pytest.approx(np.array([[6.0]]))  # all masses move with the joint
    held = np.linalg.eigvals(np.linalg.solve(mass[1:, 1:], stiffness[1:, 1:]))
    np.testing.assert_allclose(form.stiffness, np.diag([2.0, *np.sort(held)]), atol=1e-9)


@pytest.mark.parametrize("states", [4, 6, 12, 20])
@pytest.mark.parametrize("efforts", [1, 2])
def test_any_matrices_keep_their_response(states: int, efforts: int) -> None:
    rng = np.random.default_rng([states, efforts])
    a = rng.standard_normal((states, states)) - 2.0 * np.eye(states)
    b, c = rng.standard_normal((states, efforts)), rng.standard_normal((efforts, states))
    c -= c @ b @ np.linalg.pinv(b)
    c = (np.eye(efforts) + 0.2 * rng.standard_normal(2 * [efforts])) @ np.linalg.inv(c @ a @ b) @ c
    form = without_outputs(a, b, c)
    np.testing.assert_allclose(response_of(form), response(a, b, c), rtol=1e-7)


def test_states_that_are_no_coordinates_and_rates_are_refused() -> None:
    """Two equal lags that an effort enters, and a mechanism: no second row has a rate."""
    plant = drawn_plant(1, 1, (1.0, 2.0))
    a = np.zeros((4, 4))
    a[:2, :2], a[2:, 2:] = plant.a, -3.0 * np.eye(2)
    b, c = np.vstack((plant.b, [[0.0], [0.0]])), np.hstack((plant.c, np.zeros((1, 2))))
    with pytest.raises(BadInput, match=r"has no second-order form: .*minimal realisation"):
        without_outputs(a, b, c)


def test_an_effort_that_pushes_its_joint_back_is_refused() -> None:
    plant = drawn_plant(3, 2, (1.0, 9.0))
    with pytest.raises(BadInput, match=r"input 1 does not accelerate its joint .*C A B = -"):
        without_outputs(plant.a, plant.b * [-1.0, 1.0], plant.c)
