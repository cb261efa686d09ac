"""Scalings D and G at one frequency, against closed forms of mu."""

import ctrlsys
import numpy as np
import pytest

from flexslew_control.analysis.loop import Complex
from flexslew_lab.guarantee.scalings.delta_blocks import DeltaBlocks
from flexslew_lab.guarantee.scalings.multipliers import Scalings


def with_real_eigenvalue(size: int, value: float) -> Complex:
    """Return a matrix with one real eigenvalue; the others have imaginary parts of 2 and more."""
    rng = np.random.default_rng(5)
    basis = rng.normal(size=(size, size)) + 1j * rng.normal(size=(size, size))
    values = np.append(value, 1.0 + 1j * np.arange(2, size + 1))
    return np.asarray(basis @ np.diag(values) @ np.linalg.inv(basis))


@pytest.mark.parametrize("size", [1, 2, 4])
def test_one_repeated_real_number_is_bounded_exactly(size: int) -> None:
    scalings = Scalings(DeltaBlocks((size,)))
    m = with_real_eigenvalue(size, 2.0)  # I - delta M is singular at delta = 1 / 2 alone
    assert scalings.multiplier(np.asarray(0.495 * m)) is not None
    assert scalings.multiplier(np.asarray(0.505 * m)) is None


def test_a_full_block_is_bounded_by_the_largest_singular_value() -> None:
    rng = np.random.default_rng(6)
    m = rng.normal(size=(2, 3)) + 1j * rng.normal(size=(2, 3))
    m = np.asarray(m / np.linalg.norm(m, 2))
    scalings = Scalings(DeltaBlocks((), ((3, 2),)))
    assert scalings.multiplier(np.asarray(0.99 * m)) is not None
    assert scalings.multiplier(np.asarray(1.01 * m)) is None


def test_a_multiplier_is_positive_for_every_delta_of_the_box() -> None:
    rng = np.random.default_rng(7)
    blocks = DeltaBlocks((2, 1), ((1, 2),))
    m = 0.3 * (rng.normal(size=(5, 4)) + 1j * rng.normal(size=(5, 4)))
    found = Scalings(blocks).multiplier(np.asarray(0.9 * m / np.linalg.norm(m, 2)))
    assert found is not None
    for _ in range(50):
        delta = np.zeros((4, 5), complex)
        first, second = rng.uniform(-1.0, 1.0, 2)
        delta[:3, :3] = np.diag([first, first, second])
        row = rng.normal(size=2) + 1j * rng.normal(size=2)
        delta[3, 3:] = row / np.linalg.norm(row)
        v = rng.normal(size=5) + 1j * rng.normal(size=5)
        w = delta @ v
        cross = v.conj() @ found.across @ w
        value = v.conj() @ found.by_v @ v + 2.0 * cross.real - w.conj() @ found.by_w @ w
        assert value.real > -1e-9 * np.linalg.norm(v) ** 2 * np.linalg.norm(found.by_v)


def test_slicot_takes_no_repeated_real_parameter() -> None:
    pair = np.eye(2, dtype=complex, order="F")
    found = ctrlsys.ab13md(pair, np.array([2], np.int32), np.array([1], np.int32))
    assert found[-1] == 3  # its exit code for a real block with a size above one
