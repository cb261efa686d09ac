"""What the feedback makes of the sensors' noise biases nothing, however loud the noise is."""

import numpy as np
import pytest
from tests.lab.identification.shaken import bench, shaken, truth

from flexslew_lab.identification.modal.modal_fit import modal_fit, refined
from flexslew_lab.identification.modal.oscillators import Oscillator
from flexslew_lab.identification.modal.regressors import RegressorSignals, reduce_rows
from flexslew_lab.identification.modal.separable import ModalLeastSquares
from flexslew_lab.identification.records.record import Record
from flexslew_plant.arrays import Vector

BENCH = bench(kind="floating_oscillator", damping_ratio=0.02)
PLAN = {
    "band": [0.3, 6.0], "largest_excursion": [0.2], "duration": 60.0, "resolution": 0.4,
    "taper": 1.0,
}  # fmt: skip
SEEDS = 40
W, ZETA, RIGID = truth(BENCH)


def record(seed: int) -> Record:
    """Return a minute with sensors as loud as their signals, under a stiff PD."""
    rng, gains = np.random.default_rng(seed), (np.array([4.0]), np.array([8.0]))
    return shaken(BENCH, PLAN, gains, rng, ratio=1.0, period=0.02).record


def deviations(seed: int, highest: float | None) -> Vector:
    """Return the errors of frequency, damping and inertia in standard deviations."""
    signals = RegressorSignals(record(seed), highest)
    start = (Oscillator(float(W[0]), float(ZETA[0])),)
    fit = modal_fit(refined(signals, start, 0.5 * signals.record.measured.std(axis=0))[0])
    found = np.array([*fit.modes[0].__dict__.values(), fit.inverse_inertia[0, 0]])
    spread = [*np.diag(fit.covariance), fit.inverse_inertia_covariance[0, 0]]
    return np.asarray((found - np.array([W[0], ZETA[0], 1.0 / RIGID[0, 0]])) / np.sqrt(spread))


@pytest.mark.slow
def test_all_ticks_are_not_biased_where_the_low_end_of_the_band_is() -> None:
    """A mean of SEEDS errors deviates by SEEDS^-1/2; 3.3 of it is chance once in a thousand.

    White noise that is cut at a frequency is no longer independent of the efforts before it, of
    which a stiff feedback makes efforts: the inertia shows it.
    """
    whole, cut = (
        np.mean([deviations(seed, highest) for seed in range(SEEDS)], axis=0) * SEEDS**0.5
        for highest in (None, 6.0)
    )
    assert np.abs(whole).max() < 3.3
    assert abs(cut[2]) > 5.0


def test_terms_keep_every_inner_product_when_they_are_turned() -> None:
    signals = RegressorSignals(record(3), None)
    modes = Oscillator(1.3, 0.01), Oscillator(4.0, 0.02)
    for whole in signals.columns(modes, slopes=True):
        small = reduce_rows(whole)
        sides = [
            np.hstack([t.constant, t.line, t.rigid, *t.modes, *t.slopes, t.measured])
            for t in (whole, small)
        ]
        lengths = np.linalg.norm(sides[0], axis=0)
        for side in sides:
            side /= lengths
        assert len(small.measured) == sides[0].shape[1] < len(whole.measured) / 50
        # rounding of as many rows
        assert sides[1].T @ sides[1] == pytest.approx(sides[0].T @ sides[0], abs=1e-11)


def test_the_cost_of_turned_terms_is_that_of_the_residual_in_time() -> None:
    told = record(4)
    problem = ModalLeastSquares(RegressorSignals(told, None), told.measured.std(axis=0))
    modes = (Oscillator(float(W[0]), 0.03), Oscillator(4.0, 0.02))
    solution = problem.solve(modes)
    left = problem.residual_in_time(modes, solution.parts) / problem.noise
    assert solution.cost == pytest.approx(0.5 * (left**2).sum(), rel=1e-9)
