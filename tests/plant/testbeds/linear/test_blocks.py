"""Blocks: their product is the matrix, chains of zeros stay together, scales stay within limits."""

from typing import Any

import numpy as np
import pytest
from scipy.linalg import block_diag

from flexslew_plant.testbeds.linear.blocks import balanced, blocks


def joined(parts: Any) -> Any:
    """Return R diag(S, ...) L."""
    pairs = [
        np.array([[s, w], [-w, s]])
        for s, w in zip(parts.damping, parts.frequency, strict=True)
    ]  # fmt: skip
    return parts.right @ block_diag(parts.first, *pairs) @ parts.left


@pytest.mark.parametrize("seed", range(4))
def test_the_blocks_of_any_matrix_make_it_again(seed: int) -> None:
    a = np.random.default_rng(seed).standard_normal((9, 9))
    parts = blocks(a)
    np.testing.assert_allclose(joined(parts), a, atol=1e-11)
    assert (parts.frequency > 0.0).all()
    assert len(parts.first) + 2 * len(parts.frequency) == len(a)


def test_rigid_motions_and_real_poles_are_one_block() -> None:
    rng = np.random.default_rng(5)
    free, mode = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0, 1.0], [-9.0, -0.1]])
    a = block_diag(free, free, mode, np.array([[-2.0]]))
    turned, _ = np.linalg.qr(rng.standard_normal(a.shape))
    parts = blocks(turned @ a @ turned.T)
    assert parts.first.shape == (5, 5)
    assert parts.frequency == pytest.approx([np.sqrt(9.0 - 0.05**2)])
    np.testing.assert_allclose(joined(parts), turned @ a @ turned.T, atol=1e-12)


def test_modes_without_eigenvectors_of_their_own_stay_in_one_block() -> None:
    pair = np.array([[0.0, 1.0], [-4.0, 0.0]])
    a = np.block([[pair, np.eye(2)], [np.zeros((2, 2)), pair]])
    parts = blocks(a)
    assert parts.first.shape == (4, 4)
    np.testing.assert_allclose(joined(parts), a, atol=1e-14)


def test_traces_of_rounding_in_a_zero_do_not_stretch_the_scale() -> None:
    a = np.array([[0.0, 1.0], [1e-30, 0.0]])
    scaled, scale = balanced(a)
    assert scale.max() / scale.min() <= 2.0**16
    np.testing.assert_array_equal(scaled * scale[:, None] / scale, a)
