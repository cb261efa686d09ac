"""The descent finds minima where a function is not smooth, and says how near it is to one."""

import numpy as np
import pytest

from flexslew_lab.tuning.descent import minimise, shortest_in_hull
from flexslew_plant.arrays import Vector


def rosenbrock(x: Vector) -> tuple[float, Vector]:
    """Return 8 |x_1^2 - x_2| + (1 - x_1)^2 (Lewis and Overton 2013), smallest at (1, 1)."""
    inner = x[0] ** 2 - x[1]
    slope = 8.0 * np.sign(inner) * np.array([2.0 * x[0], -1.0])
    return float(8.0 * abs(inner) + (1.0 - x[0]) ** 2), slope + np.array([2.0 * (x[0] - 1.0), 0.0])


def test_a_valley_with_an_edge_is_followed_to_its_end() -> None:
    found = minimise(rosenbrock, np.array([-1.0, 2.0]), 5000, rng=np.random.default_rng(1))
    assert found.x == pytest.approx([1.0, 1.0], abs=1e-3)
    assert found.value < 1e-4


def test_the_largest_of_linear_functions_is_smallest_where_gradients_cancel() -> None:
    rows = np.random.default_rng(4).standard_normal((6, 3))
    rows[-1] = -rows[:-1].sum(axis=0)  # zero is in the hull: a bounded problem

    def largest(x: Vector) -> tuple[float, Vector]:
        values = rows @ x + np.arange(6.0)
        return float(values.max()), rows[int(values.argmax())]

    from scipy.optimize import linprog

    bounds = [(None, None)] * 4
    exact = linprog(
        [0, 0, 0, 1], A_ub=np.hstack((rows, -np.ones((6, 1)))), b_ub=-np.arange(6.0), bounds=bounds
    )
    found = minimise(largest, np.ones(3), 4000, rng=np.random.default_rng(1))
    assert found.value == pytest.approx(exact.fun, abs=1e-3)


def test_the_domain_of_a_function_is_not_left() -> None:
    def barrier(x: Vector) -> tuple[float, Vector]:
        if x[0] <= 0.0:
            return np.inf, np.zeros(1)
        return float(x[0] - np.log(x[0])), 1.0 - 1.0 / x

    assert minimise(barrier, np.array([5.0])).x == pytest.approx([1.0], abs=1e-4)


def test_a_target_and_a_number_of_evaluations_end_it() -> None:
    start = np.array([-1.0, 2.0])
    assert minimise(rosenbrock, start, target=5.0).value < 5.0
    assert minimise(rosenbrock, start, evaluations=10).evaluations <= 11


@pytest.mark.parametrize(
    ("gradients", "shortest"),
    [([[1.0, 0.0], [0.0, 1.0]], [0.5, 0.5]), ([[1.0, 0.0], [-1.0, 0.0]], [0.0, 0.0]),
     ([[2.0, 1.0]], [2.0, 1.0])],
)  # fmt: skip
def test_the_shortest_vector_of_a_hull(gradients: list[list[float]], shortest: list[float]) -> None:
    assert shortest_in_hull(np.array(gradients)) == pytest.approx(shortest, abs=1e-5)
