"""Cells of a box: bounds of eigenvalues enclose the truth, and light damping is certified."""

import numpy as np
import pytest
from scipy.linalg import block_diag, expm

from flexslew_lab.analysis.analysis import loop_analysis
from flexslew_lab.guarantee.box import Box, corners
from flexslew_lab.guarantee.cells.cell_cover import cover_by_cells, failed_check
from flexslew_lab.guarantee.cells.modal_cell import modal_cell
from flexslew_lab.guarantee.certificate import certify
from flexslew_lab.guarantee.fit.dynamics_fit import dynamics_fit
from flexslew_lab.guarantee.model.parameters import box_of
from flexslew_lab.guarantee.model.varied_loop import default_vary, varied_loop
from flexslew_lab.guarantee.search import breakdown
from flexslew_lab.notebook import trial

BOX = Box(np.array([1.0, 1.0]), np.array([0.1, 0.1]))  # stiffness and inertia
DAMPING = 1e-4  # ratio of the slower mode


def two_modes(p: np.ndarray, excited: float = 0.0) -> np.ndarray:
    """Return a tick of 50 ms of two modes that a small stiffness couples.

    Args:
        p: stiffness and inertia.
        excited: negative damping near a stiffness of 1.07, over 0.2 % of it, as a share.
    """
    k, j = p
    c = 2.0 * DAMPING * (1.0 - excited * np.exp(-(((k - 1.07) / 0.002) ** 2)))
    first = np.array([[0.0, 1.0], [-k, -c]])
    a = block_diag(first, np.array([[0.0, 1.0], [-9.0 * k / j, -3.0 * c]]))
    a[1, 2] = a[3, 0] = 0.1 * k
    return np.asarray(expm(0.05 * a))


def is_stable(p: np.ndarray, excited: float = 0.0) -> bool:
    return bool(abs(np.linalg.eigvals(two_modes(p, excited))).max() < 1.0)


@pytest.mark.parametrize("size", [1.0, 0.2, 0.02])
def test_no_loop_of_a_cell_exceeds_its_bound(size: float) -> None:
    fit, rng = dynamics_fit(two_modes, BOX), np.random.default_rng(2)
    centre, radius = np.array([0.3, -0.4]), size * np.array([0.6, 0.5])
    cell = modal_cell(fit.terms, centre, radius, fit.error)
    points = np.vstack((corners(2), rng.uniform(-1.0, 1.0, (200, 2))))
    largest = max(
        abs(np.linalg.eigvals(two_modes(BOX.at(centre + radius * x)))).max() for x in points
    )
    assert cell.bound(np.ones(2)) >= largest


def test_the_bound_is_exact_to_second_order() -> None:
    fit = dynamics_fit(two_modes, BOX)
    middle = abs(np.linalg.eigvals(two_modes(BOX.centre))).max()
    slope = modal_cell(fit.terms, np.zeros(2), np.full(2, 1e-4), fit.error)
    excess = [
        modal_cell(fit.terms, np.zeros(2), np.full(2, size), 0.0).bound(np.ones(2)) - middle
        for size in (0.04, 0.02)
    ]
    assert slope.bound(np.ones(2)) < 1.0
    assert 3.0 < excess[0] / excess[1] < 4.5  # damping hardly depends on stiffness


def test_two_parameters_of_a_damping_of_one_in_ten_thousand_are_certified() -> None:
    found = cover_by_cells(two_modes, is_stable, dynamics_fit(two_modes, BOX), 600.0)
    assert found.complete
    assert len(found.cells) < 200
    assert failed_check(two_modes, found.cells, BOX) is None
    grid = np.linspace(-1.0, 1.0, 41)
    assert all(is_stable(BOX.at(np.array([x, y]))) for x in grid for y in grid)


def test_an_independent_check_refutes_wrong_cells() -> None:
    cells = cover_by_cells(two_modes, is_stable, dynamics_fit(two_modes, BOX), 600.0).cells
    assert failed_check(two_modes, cells[1:], BOX) is not None  # a part of the box is missing
    doubled = [cells[0]._replace(norms=1.1 * cells[0].norms), *cells[1:]]
    assert failed_check(two_modes, doubled, BOX) is not None  # no vector d
    assert failed_check(lambda p: 1.01 * two_modes(p), cells, BOX) is not None  # another loop


def test_a_narrow_unstable_strip_is_never_certified() -> None:
    def dynamics(p: np.ndarray) -> np.ndarray:
        return two_modes(p, excited=30.0)

    def stable(p: np.ndarray) -> bool:
        return is_stable(p, excited=30.0)

    assert not stable(np.array([1.07, 1.0]))
    found = cover_by_cells(dynamics, stable, dynamics_fit(dynamics, BOX), 5.0)
    assert not found.complete or failed_check(dynamics, found.cells, BOX) is not None


def test_motions_that_no_parameter_touches_are_left_out() -> None:
    def with_angle(p: np.ndarray) -> np.ndarray:
        a = block_diag(np.eye(2), two_modes(p))
        a[0, 1], a[1, 2] = 0.05, 0.3  # a wheel's angle and rate, which nothing reads
        return a

    fit = dynamics_fit(with_angle, BOX)
    assert fit.shown.shape == (4, 6)
    poles = fit.poles(np.array([[0.5, -0.5]]))[0]
    truth = np.linalg.eigvals(two_modes(BOX.at(np.array([0.5, -0.5]))))
    np.testing.assert_allclose(np.sort_complex(poles), np.sort_complex(truth), atol=1e-9)


@pytest.mark.parametrize("name", ["m1", "three_axes"])
def test_lightly_damped_trials_are_certified(name: str) -> None:
    requested = trial(name)
    analysis = loop_analysis(requested, "here")
    varied = varied_loop(requested, analysis, default_vary(requested))
    box = box_of(varied.parameters)
    certificate = certify(varied.over(box), seconds=600.0)
    assert certificate.holds
    assert certificate.checked > len(certificate.parts)
    assert breakdown(varied.over(box)) is None
    points = np.random.default_rng(9).uniform(-1.0, 1.0, (60, len(box.centre)))
    assert all(varied.stable(box.at(delta)) for delta in points)
