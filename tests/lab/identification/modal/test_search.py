"""Oscillators follow the matrix exponential, and a search tells what a fit would."""

import numpy as np
import pytest
from scipy.linalg import expm

from flexslew_lab.identification.modal.missed import gain, missing_mode, price
from flexslew_lab.identification.modal.oscillators import Oscillator
from flexslew_lab.identification.modal.regressors import RegressorSignals
from flexslew_lab.identification.modal.separable import ModalLeastSquares
from flexslew_lab.identification.records.record import Output, Quantity, Record
from flexslew_plant.arrays import Matrix

PERIOD = 0.02
MODES = (Oscillator(1.3, 0.006), Oscillator(4.1, 0.01))


def by_steps(mode: Oscillator, effort: Matrix) -> Matrix:
    """Return (q, q') at the ticks by the exponential of the augmented matrix."""
    w, zeta = mode.frequency, mode.damping_ratio
    augmented = np.array([[0.0, 1.0, 0.0], [-w * w, -2.0 * zeta * w, w * w], [0.0, 0.0, 0.0]])
    step = expm(augmented * PERIOD)
    path = [np.zeros(2)]
    for u in effort:
        path.append((step @ np.append(path[-1], u))[:2])
    return np.array(path)


@pytest.mark.parametrize("mode", [*MODES, Oscillator(2.0, 1.4)])
def test_responses_are_those_of_the_matrix_exponential(mode: Oscillator) -> None:
    effort = np.random.default_rng(3).standard_normal((600, 2))
    q, rate = mode.responses(effort, PERIOD)
    for column in range(2):
        path = by_steps(mode, effort[:, column])
        # rounding of 600 steps
        assert q[:, column] == pytest.approx(path[:, 0], abs=1e-11)
        assert rate[:, column] == pytest.approx(path[:, 1], abs=1e-11)
    each = 7
    sums = mode.responses(effort, PERIOD, each)
    whole = q[: len(q) // each * each].reshape(-1, each, 4).sum(axis=1)
    assert sums[0] == pytest.approx(whole, abs=1e-10)


def record(seed: int) -> Record:
    """Return two modes at a joint and a tip, with noise."""
    rng = np.random.default_rng(seed)
    effort = rng.standard_normal((6000, 2))
    parts = [mode.responses(effort, PERIOD) for mode in MODES]
    joint, rate, tip = (
        sum(pair[which][:, :2] @ rng.standard_normal(2) for pair in parts) for which in (0, 1, 0)
    )
    measured = np.column_stack((joint, rate, tip))
    measured += 0.1 * measured.std(axis=0) * rng.standard_normal(measured.shape)
    outputs = (
        Output("position.a", "rad", Quantity.JOINT_POSITION, "a"),
        Output("rate.a", "rad/s", Quantity.JOINT_RATE, "a"),
        Output("tip", "m", Quantity.DEFLECTION),
    )
    return Record(PERIOD, effort, measured, ("a", "b"), outputs, "here", np.full(2, np.inf))


@pytest.mark.parametrize("seed", range(4))
def test_what_one_more_mode_explains_is_the_difference_of_two_whole_fits(seed: int) -> None:
    signals = RegressorSignals(record(seed), 8.0)
    problem = ModalLeastSquares(signals, signals.record.measured.std(axis=0))
    now = problem.solve(MODES[:1], slopes=False)
    rng = np.random.default_rng(seed)
    for w in rng.uniform(0.5, 8.0, 5):
        one = Oscillator(float(w), 0.025)
        both = problem.solve((*MODES[:1], one), slopes=False)
        assert gain(now, one) == pytest.approx(now.cost - both.cost, rel=1e-6, abs=1e-9 * now.cost)


def test_the_mode_that_a_fit_lacks_is_found_near_its_frequency_and_none_that_is_not_there() -> None:
    signals = RegressorSignals(record(11), 8.0)
    noise = 0.1 * signals.record.measured.std(axis=0)
    problem = ModalLeastSquares(signals, noise)
    missed = missing_mode(signals, problem.solve(MODES[:1]), noise, (0.5, 8.0))
    assert missed is not None
    assert missed.frequency == pytest.approx(
        MODES[1].frequency, rel=0.03
    )  # half the grid, and leakage
    assert missing_mode(signals, problem.solve(MODES), noise, (0.5, 8.0)) is None
    assert price(problem) > 0.0
