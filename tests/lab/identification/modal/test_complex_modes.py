"""Damping that couples the modes moves no estimate: exact responses are given back exactly."""

import numpy as np
import pytest
from scipy.linalg import expm

from flexslew_lab.identification.modal.modal_fit import modal_fit, modal_response, refined
from flexslew_lab.identification.modal.oscillators import Oscillator
from flexslew_lab.identification.modal.parameter_groups import groups_of
from flexslew_lab.identification.modal.regressors import RegressorSignals
from flexslew_lab.identification.records.record import Output, Quantity, Record
from flexslew_plant.arrays import Matrix

PERIOD = 0.05


def coupled(rng: np.random.Generator) -> tuple[Matrix, Matrix]:
    """Return A and B of a free joint with three modes.

    Their damping is that of the modes with the joint held, so it couples those of the free one.
    """
    push = 0.4 * rng.standard_normal(3)
    mass = np.block([[np.array([[2.0]]), push[None]], [push[:, None], np.eye(3)]])
    held = np.array([0.8, 1.3, 2.9]) * rng.uniform(0.9, 1.1, 3)
    stiffness, damping = np.diag([0.0, *held**2]), np.diag([0.0, *(2.0 * 0.05 * held)])
    a = np.zeros((8, 8))
    a[:4, 4:] = np.eye(4)
    a[4:] = -np.linalg.solve(mass, np.hstack((stiffness, damping)))
    b = np.zeros((8, 1))
    b[4:] = np.linalg.solve(mass, np.array([[1.0], [0.0], [0.0], [0.0]]))
    return a, b


def flown(a: Matrix, b: Matrix, effort: Matrix) -> Matrix:
    """Return joint, its rate and the sum of the modes at the ticks."""
    step = expm(np.block([[a, b], [np.zeros((1, 9))]]) * PERIOD)
    x, rows = np.zeros(8), [np.zeros(3)]
    for u in effort:
        x = step[:8, :8] @ x + step[:8, 8] * u[0]
        rows.append(np.array([x[0], x[4], x[1:4].sum()]))
    return np.array(rows)


@pytest.mark.parametrize("seed", range(4))
def test_poles_and_responses_of_coupled_modes_are_found_to_rounding(seed: int) -> None:
    """Real residues alone, as on the low end of a band, miss them."""
    rng = np.random.default_rng(seed)
    a, b = coupled(rng)
    effort = rng.standard_normal((4000, 1))
    outputs = (
        Output("position.a", "rad", Quantity.JOINT_POSITION, "a"),
        Output("rate.a", "rad/s", Quantity.JOINT_RATE, "a"),
        Output("tip.b", "m", Quantity.DEFLECTION),
    )
    measured = flown(a, b, effort)
    record = Record(PERIOD, effort, measured, ("a",), outputs, "here", np.full(1, np.inf))
    poles = np.linalg.eigvals(a)
    poles = poles[poles.imag > 1e-6]
    poles = poles[np.argsort(np.abs(poles))]
    starts = tuple(Oscillator(float(abs(s) * 1.001), float(-s.real / abs(s))) for s in poles)
    solution, _ = refined(RegressorSignals(record, None), starts, 1e-4 * measured.std(axis=0))
    fit = modal_fit(solution)
    assert [m.frequency for m in fit.modes] == pytest.approx(np.abs(poles), rel=1e-6)
    zeta = -poles.real / np.abs(poles)
    assert [m.damping_ratio for m in fit.modes] == pytest.approx(zeta, rel=1e-5)
    assert np.abs(fit.lags.sum(axis=0)).max() < 1e-12 * np.abs(fit.lags).max()
    w = np.linspace(0.3, 4.0, 50)
    c = np.zeros((2, 8))
    c[0, 0], c[1, 1:4] = 1.0, 1.0
    exact = np.array([c @ np.linalg.solve(1j * one * np.eye(8) - a, b) for one in w])
    found = modal_response(fit, groups_of(record), w)
    assert np.abs(found - exact).max() < 1e-5 * np.abs(exact).max()
    real, _ = refined(RegressorSignals(record, 6.0), starts, 1e-4 * measured.std(axis=0))
    missed = [m.frequency for m in real.modes] / np.abs(poles) - 1.0
    assert np.abs(missed).max() > 1e-5
