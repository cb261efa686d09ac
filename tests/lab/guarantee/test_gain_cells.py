"""Bounds of a gain, cell by cell: they enclose the truth, also of lightly damped loops."""

import numpy as np
import pytest
from scipy.linalg import block_diag, expm

from flexslew_lab.guarantee.box import Box
from flexslew_lab.guarantee.cells.gain_cell import gain_cell
from flexslew_lab.guarantee.cells.gain_cells import bounded_cells, exceeding
from flexslew_lab.guarantee.fit.dynamics_fit import dynamics_fit, system_fit
from flexslew_lab.guarantee.model.uncertain_loop import GainLimit, UncertainLoop
from flexslew_lab.guarantee.scalings.frequency_cover import LoopChannels

BOX = Box(np.array([1.0, 1.0]), np.array([0.1, 0.1]))  # stiffness and inertia
STATES = 4


def system(p: np.ndarray) -> np.ndarray:
    """Return a slow damped mode, and a fast one with a damping ratio of 1e-3, ticks of 50 ms."""
    k, j = p
    slow = np.array([[0.0, 1.0], [-k, -0.6]])
    fast = np.array([[0.0, 1.0], [-9.0 * k / j, -0.006]])
    force = np.array([[0.0], [1.0], [0.0], [0.002]])
    held = np.block([[block_diag(slow, fast), force], [np.zeros((1, 5))]])
    whole = np.asarray(expm(0.05 * held))[:STATES]
    read = np.array([[1.0, 0.0, 1.0, 0.0, 0.0]])
    return np.vstack((whole, read))


def largest(p: np.ndarray) -> float:
    """Return the peak over a dense grid of frequencies."""
    s = system(p)
    angles = np.concatenate((np.geomspace(1e-4, np.pi, 300), 0.15 + np.linspace(-0.02, 0.02, 2001)))
    channels = LoopChannels(s[:4, :4], s[:4, 4:], s[4:, :4], s[4:, 4:])
    return float(abs(channels.at(angles)).max())


@pytest.mark.parametrize("complement", [False, True])
def test_bounds_of_arcs_enclose_the_gain(complement: bool) -> None:
    fit, rng = system_fit(system, BOX, np.eye(STATES)), np.random.default_rng(3)
    centre, radius = np.array([0.2, -0.3]), np.array([0.02, 0.03])
    cell = gain_cell(fit, complement, centre, radius)
    low = rng.uniform(0.0, 0.4, 60)
    high = low + rng.choice([1e-4, 1e-3, 1e-2], 60)
    bounds = cell.bounds(low, high, np.ones(2))
    assert np.isfinite(bounds).any()
    at_centre = cell.bounds(low, low, np.zeros(2))
    s = system(BOX.at(centre))
    truth = LoopChannels(s[:4, :4], s[:4, 4:], s[4:, :4], s[4:, 4:] + complement).at(low)
    np.testing.assert_allclose(at_centre, abs(truth)[:, 0, 0], rtol=1e-3, atol=1e-3)
    for x in rng.uniform(-1.0, 1.0, (30, 2)):
        s = system(BOX.at(centre + radius * x))
        channels = LoopChannels(s[:4, :4], s[:4, 4:], s[4:, :4], s[4:, 4:])
        for share in (0.0, 0.5, 1.0):
            response = channels.at(low + share * (high - low))[:, 0, 0]
            assert (abs(complement + response) <= bounds).all()


def test_a_peak_is_bounded_within_a_fifth_and_not_below_the_truth() -> None:
    grid = np.linspace(-1.0, 1.0, 9)
    truth = max(largest(BOX.at(np.array([x, y]))) for x in grid for y in grid)
    fit = system_fit(system, BOX, dynamics_fit(lambda p: system(p)[:4, :4], BOX).shown)
    cells = bounded_cells(fit, GainLimit(1.2 * truth), 600.0)
    assert cells is not None
    loop = UncertainLoop(BOX, STATES, system, lambda p: True)
    assert exceeding(loop, GainLimit(1.2 * truth), cells) is None
    assert exceeding(loop, GainLimit(0.5 * truth), cells) is not None
    assert bounded_cells(fit, GainLimit(0.98 * truth), 3.0) is None


@pytest.mark.parametrize("damping", [0.0, -0.01])
def test_a_loop_that_is_not_stable_has_no_bound(damping: float) -> None:
    def unstable(p: np.ndarray) -> np.ndarray:
        s = system(p)
        s[2:4, 2:4] *= 1.0 - damping + 2e-4 * p[0]
        return s

    fit = system_fit(unstable, BOX, np.eye(STATES))
    assert bounded_cells(fit, GainLimit(1e6), 2.0) is None
