"""Matrices of parameters as linear fractional forms."""

import numpy as np
import pytest
from scipy.linalg import expm

from flexslew_lab.guarantee.box import Box
from flexslew_lab.guarantee.fit.fractional import fractional_over
from flexslew_plant.errors import BadInput

BOX = Box(np.array([2.0, 1.0]), np.array([0.4, 0.3]))


def sampled(values: np.ndarray) -> np.ndarray:
    """Return a tick of a mass on a spring, a function of stiffness and mass."""
    k, m = values
    return np.asarray(expm(0.2 * np.array([[0.0, 1.0], [-k / m, -0.05 / m]])))


def test_a_form_is_the_matrix_within_its_error() -> None:
    form, rng = fractional_over(sampled, BOX), np.random.default_rng(8)
    assert form.largest_error < 1e-6
    for delta in rng.uniform(-1.0, 1.0, (50, 2)):
        error = abs(form.at(delta) - sampled(BOX.at(delta))).max()
        assert error <= 2.0 * max(form.largest_error, 1e-12)


def test_what_is_affine_of_rank_one_takes_one_channel() -> None:
    left, right = np.array([[1.0], [2.0], [0.5]]), np.array([[1.0, -1.0, 3.0]])
    box = Box(np.array([1.0]), np.array([0.5]))
    form = fractional_over(lambda p: np.eye(3) + p[0] * left @ right, box)
    assert form.sizes == (1,)
    assert form.error == (0, 0) or form.largest_error < 1e-12


def test_a_matrix_that_changes_its_size_is_refused() -> None:
    box = Box(np.array([0.0]), np.array([1.0]))
    with pytest.raises(BadInput, match="number of states"):
        fractional_over(lambda p: np.eye(2 if p[0] > 0.0 else 3), box)
