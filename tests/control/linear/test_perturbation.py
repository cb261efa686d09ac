"""Gains by perturbation of the Riccati equation, on the planar antenna and on the oscillator."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_are

from flexslew_control.linear.perturbation import (
    Change,
    Regulator,
    backward,
    decrease,
    regulator,
    require_positive_definite,
)
from flexslew_control.linear.small_motion import Frozen
from flexslew_lab.reproduce.antenna_flights import time_varying
from flexslew_plant.errors import BadInput

DT = 0.03  # [s]


@lru_cache
def antenna() -> tuple[Regulator, tuple[Change, ...]]:
    """Return example 4 and what changes over steps of 30 ms, then what stays."""
    case = time_varying(4)
    return case.regulator, tuple(
        case.regulator.change(frozen) for frozen in (*case.middle[15::30], case.after)
    )


def test_zero_order_is_the_regulator_with_an_integral() -> None:
    r, _ = antenna()
    b = r.input_matrix
    p = solve_continuous_are(r.state_matrix, b, r.state_weight, r.effort_weight)
    np.testing.assert_allclose(r.riccati, p, rtol=1e-9)
    # F' = -R^-1 B^T P0 w with p = eta'' + Lambda eta gives the gains (3-50)
    k = r.inverse_weight @ b.T @ r.riccati
    gains = r.gains()
    n = len(r.squares)
    np.testing.assert_allclose(gains.integral, k[:, :n] + k[:, 2 * n :] * r.squares, rtol=1e-9)
    np.testing.assert_allclose(gains.proportional, k[:, n : 2 * n], rtol=1e-9)
    np.testing.assert_allclose(gains.rate, k[:, 2 * n :], rtol=1e-9)


def test_backward_solves_the_lyapunov_equation() -> None:
    r, changes = antenna()
    gamma, a = r.forcing(changes[10]), r.closed_loop
    step = 1e-4
    found = backward(r, [changes[10], changes[-1]], step)
    slope = (found[1] - found[0]) / step
    middle = 0.5 * (found[0] + found[1])
    expected = -(middle @ a + a.T @ middle + gamma)
    # the fastest pole decides how far half a step leads: 1e-3
    np.testing.assert_allclose(slope, expected, atol=1e-3 * abs(expected).max())


def test_a_standing_change_keeps_the_adiabatic_solution() -> None:
    r, changes = antenna()
    same = [changes[-1]] * 20
    for p in backward(r, same, DT):
        np.testing.assert_allclose(p, r.adiabatic(changes[-1]), atol=1e-5)


def test_the_recursion_as_printed_forward_diverges() -> None:
    r, changes = antenna()
    inverse = expm(-r.closed_loop * DT)
    p = backward(r, changes, DT, "zero")[0]
    largest = abs(p).max()
    for change in changes[:-1]:  # (3-45): P1(k + 1) from P1(k)
        p = inverse.T @ (p - r.forcing(change) * DT) @ inverse
    assert abs(p).max() > 1e15 * largest


def test_no_correction_at_the_end_lets_a_cost_grow_that_the_default_does_not() -> None:
    r, changes = antenna()
    still = np.zeros_like(r.riccati)
    # just after the turn the plant has changed for good and P1 stands still
    largest = {
        end: np.linalg.eigvalsh(decrease(r, changes[-1], p, still)).max()
        for end, p in (("zero", still), ("adiabatic", r.adiabatic(changes[-1])))
    }
    assert largest["zero"] > 20.0
    assert largest["adiabatic"] < 2e-3  # of second order


def test_an_end_that_is_not_positive_definite_is_refused() -> None:
    with pytest.raises(BadInput, match=r"adiabatic: P0 \+ P1 .* not positive definite: lowest"):
        require_positive_definite(np.diag([1.0, -0.5]), "end_condition: adiabatic")
    frozen = Frozen(np.eye(1), np.zeros((1, 1)), 100.0 * np.eye(1), np.eye(1), np.zeros(1))
    r = regulator(frozen, np.eye(3), 0.01 * np.eye(1))
    weaker = r.change(replace(frozen, stiffness=-400.0 * np.eye(1)))
    with pytest.raises(BadInput, match="end_condition: zero"):
        backward(r, [weaker, weaker], DT)


def test_the_gains_of_an_oscillator_follow_the_exact_ones() -> None:
    frozen = Frozen(np.eye(1), np.zeros((1, 1)), 100.0 * np.eye(1), np.eye(1), np.zeros(1))
    r = regulator(frozen, np.eye(3), 0.01 * np.eye(1))
    errors = []
    for swing in (1.0, 0.5):  # of first order: half the change, a quarter of the error
        other = replace(frozen, stiffness=(100.0 + swing) * np.eye(1))
        exact = regulator(other, np.eye(3), 0.01 * np.eye(1)).riccati
        errors.append(abs(r.riccati + r.adiabatic(r.change(other)) - exact).max())
    assert errors[1] / errors[0] == pytest.approx(0.25, rel=0.02)
