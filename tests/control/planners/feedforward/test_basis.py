from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from flexslew_control.planners.feedforward.basis import Basis

NAMES = ("hat", "constant", "cubic", "trigonometric")


def test_hats_are_one_at_their_node_and_zero_at_the_others() -> None:
    basis = Basis("hat", 9, 25.0)
    np.testing.assert_allclose(
        basis.values(2.5 * np.arange(1, 10, dtype=float)), np.eye(9), atol=1e-14
    )
    np.testing.assert_allclose(basis.values(np.array([0.0, 25.0])), 0.0, atol=1e-14)


def test_constants_tile_the_duration() -> None:
    basis = Basis("constant", 5, 10.0)
    t = np.array([0.0, 1.999, 2.0, 9.999])
    np.testing.assert_array_equal(basis.values(t), np.eye(5)[[0, 0, 1, 4]])


def test_cubic_splines_are_twice_differentiable_and_end_softly() -> None:
    basis = Basis("cubic", 9, 25.0)
    ends = basis.values(np.array([0.0, 1e-3, 25.0 - 1e-3, 25.0]))
    assert np.abs(ends).max() < 1e-9
    h = 1e-3
    around = basis.nodes[1:-1, None] + h * np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    v = np.stack([basis.values(column) for column in around.T])
    second = np.abs((v[0] - 2 * v[1] + v[2]) - (v[2] - 2 * v[3] + v[4]))
    assert second.max() / h**2 < 0.01


@pytest.mark.parametrize("name", NAMES)
def test_is_zero_outside(name: Any) -> None:
    basis = Basis(name, 7, 20.0)
    np.testing.assert_array_equal(basis.values(np.array([-0.1, 20.1])), 0.0)


@pytest.mark.parametrize("name", NAMES)
def test_means_are_the_integrals(name: Any) -> None:
    basis = Basis(name, 4, 10.0)
    edges = np.array([-1.0, 0.0, 0.3, 2.7, 2.8, 9.9, 10.5])
    means = basis.means(edges)
    for j in range(4):
        for k in range(len(edges) - 1):
            cuts = [t for t in basis.nodes if edges[k] < t < edges[k + 1]]
            area, _ = quad(
                lambda t, j=j: basis.values(np.array([t]))[0, j],
                edges[k],
                edges[k + 1],
                points=cuts or None,
            )
            assert means[k, j] == pytest.approx(area / (edges[k + 1] - edges[k]), abs=1e-9)
