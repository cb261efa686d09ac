"""Gains of a regulator with an integral for a plant that changes a little with time.

Kwak (1989), (3-25) to (3-56): the Riccati matrix is P0 + P1, P0 of the plant before the manoeuvre,
P1 of first order in what changes. w = (eta, eta', p) with p = F + D the whole modal force.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from scipy.linalg import LinAlgError, eigh, expm, solve_continuous_lyapunov

from flexslew_control.linear.riccati import continuous_riccati
from flexslew_control.linear.small_motion import Frozen
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput

EndCondition: TypeAlias = Literal["adiabatic", "zero"]
HALVINGS = 10  # of a step in the integral (3-43)
_RIGID = 1e-9  # of the largest eigenvalue: less is a rigid motion's, zero


class Change(NamedTuple):
    """What differs from the plant before the manoeuvre, in its modes (2-63), (2-64)."""

    mass: Matrix  # M1, (n, n)
    damping: Matrix  # G1, (n, n)
    stiffness: Matrix  # K1, (n, n)


class ModalGains(NamedTuple):
    """F = -G1 integral(eta) - G2 eta - G3 eta', each of shape (n, n) (3-49), (3-50)."""

    integral: Matrix
    proportional: Matrix
    rate: Matrix


@dataclass(frozen=True)
class Regulator:
    """The problem of zero order (3-40) and its solution.

    Args:
        modes: U_0 of the plant before the manoeuvre, shape (n, n).
        squares: diagonal of Lambda, shape (n,) [1/s^2].
        state_weight: Q on (eta, eta', p), shape (3 n, 3 n).
        effort_weight: R on p', shape (n, n).
    """

    modes: Matrix
    squares: Vector
    state_weight: Matrix
    effort_weight: Matrix

    @cached_property
    def state_matrix(self) -> Matrix:
        """A_0 of w' = A w + B p', shape (3 n, 3 n)."""
        n = len(self.squares)
        zero, one = np.zeros((n, n)), np.eye(n)
        return np.block([[zero, one, zero], [-np.diag(self.squares), zero, one], [zero] * 3])

    @cached_property
    def input_matrix(self) -> Matrix:
        """B, shape (3 n, n)."""
        n = len(self.squares)
        return np.vstack((np.zeros((2 * n, n)), np.eye(n)))

    @cached_property
    def inverse_weight(self) -> Matrix:
        """R^-1."""
        return np.asarray(np.linalg.inv(self.effort_weight), dtype=np.float64)

    @cached_property
    def riccati(self) -> Matrix:
        """P_0, shape (3 n, 3 n)."""
        try:
            return continuous_riccati(
                self.state_matrix, self.input_matrix, self.state_weight, self.effort_weight
            )
        except LinAlgError as error:
            raise BadInput(f"no regulator of zero order: {error}; give other weights") from None

    @cached_property
    def closed_loop(self) -> Matrix:
        """A_0c (3-38), shape (3 n, 3 n)."""
        b = self.input_matrix
        return self.state_matrix - b @ self.inverse_weight @ b.T @ self.riccati

    def change(self, frozen: Frozen) -> Change:
        """Return what of a plant differs from the one before the manoeuvre."""
        u = self.modes
        return Change(
            u.T @ frozen.mass @ u - np.eye(len(u)),
            u.T @ frozen.damping @ u,
            u.T @ frozen.stiffness @ u - np.diag(self.squares),
        )

    def perturbation(self, change: Change) -> Matrix:
        """Return A_1, with the middle row [M1 Lambda - K1, -G1, -M1], shape (3 n, 3 n)."""
        n = len(self.squares)
        a = np.zeros((3 * n, 3 * n))
        a[n : 2 * n, :n] = change.mass * self.squares - change.stiffness
        a[n : 2 * n, n : 2 * n], a[n : 2 * n, 2 * n :] = -change.damping, -change.mass
        return a

    def forcing(self, change: Change) -> Matrix:
        """Return Gamma = P0 A_1 + A_1^T P0, shape (3 n, 3 n)."""
        half = self.riccati @ self.perturbation(change)
        return half + half.T

    def adiabatic(self, change: Change) -> Matrix:
        """Return P1 of a constant change: P1 A_0c + A_0c^T P1 + Gamma = 0 (3-56)."""
        p = solve_continuous_lyapunov(self.closed_loop.T, -self.forcing(change))
        return np.asarray(0.5 * (p + p.T))

    def gains(self, change: Change | None = None, first: Matrix | None = None) -> ModalGains:
        """Return the gains (3-50) of zero order, and of first order where both are given.

        Args:
            change: at this time.
            first: P1 at this time, shape (3 n, 3 n).
        """
        n, p0 = len(self.squares), self.riccati
        p = p0 if first is None else p0 + first
        inverse, corner = self.inverse_weight, p0[2 * n :, 2 * n :]
        integral = p[:n, 2 * n :].T + p[2 * n :, 2 * n :] * self.squares
        proportional, rate = p[n : 2 * n, 2 * n :].T, p[2 * n :, 2 * n :]
        if change is not None:
            integral = integral + corner @ change.stiffness
            proportional = proportional + corner @ change.damping
            rate = rate + corner @ change.mass
        return ModalGains(inverse @ integral, inverse @ proportional, inverse @ rate)


def regulator(before: Frozen, state_weight: Matrix, effort_weight: Matrix) -> Regulator:
    """Return the problem of zero order, in the modes of the plant before the manoeuvre (2-60).

    Args:
        before: the equations before the manoeuvre.
        state_weight: Q on (eta, eta', p), shape (3 n, 3 n).
        effort_weight: R on p', shape (n, n).
    """
    symmetric = 0.5 * (before.stiffness + before.stiffness.T)
    squares, modes = eigh(symmetric, before.mass)
    squares = np.where(abs(squares) < _RIGID * abs(squares).max(), 0.0, squares)
    return Regulator(modes, squares, state_weight, effort_weight)


def backward(
    r: Regulator, changes: Sequence[Change], dt: float, end: EndCondition = "adiabatic"
) -> list[Matrix]:
    """Return P1 at the edges of steps over each of which the plant's change is constant.

    -dP1/dt = P1 A_0c + A_0c^T P1 + Gamma from the end: over one step
    P1(k) = E^T P1(k + 1) E + integral of exp(A_0c^T s) Gamma_k exp(A_0c s) (3-43) with
    E = exp(A_0c dt).

    Args:
        r: the problem of zero order.
        changes: one for each step, then the one that stays after the last.
        dt: one step [s].
        end: what P1 is there: 0, or the solution of (3-56).

    Raises:
        BadInput: P0 + P1 is not positive definite at the end.
    """
    short = expm(r.closed_loop * (dt / 2**HALVINGS))
    powers = [short]
    for _ in range(HALVINGS):
        powers.append(powers[-1] @ powers[-1])
    p = np.zeros_like(r.riccati) if end == "zero" else r.adiabatic(changes[-1])
    require_positive_definite(r.riccati + p, f"end_condition: {end}")
    found = [p]
    for change in reversed(changes[:-1]):
        gamma = r.forcing(change)
        part = 0.5 * dt / 2**HALVINGS * (gamma + short.T @ gamma @ short)
        for power in powers[:-1]:  # twice the interval each time
            part = part + power.T @ part @ power
        p = powers[-1].T @ p @ powers[-1] + part
        found.append(p)
    return found[::-1]


def require_positive_definite(p: Matrix, key: str) -> None:
    """Check that a Riccati matrix is positive definite, as its cost must be.

    Raises:
        BadInput: names the key and the lowest eigenvalue.
    """
    lowest = float(np.linalg.eigvalsh(0.5 * (p + p.T)).min())
    if not lowest > 0.0:
        raise BadInput(
            f"{key}: P0 + P1 at the end of the manoeuvre is not positive definite: lowest "
            f"eigenvalue {lowest:.4g}; the plant changes too much for first order: take "
            "gains: perturbation with end_condition: zero"
        )


def decrease(r: Regulator, change: Change, first: Matrix, slope: Matrix) -> Matrix:
    """Return F of V' = w^T F w for V = w^T P w (3-60), shape (3 n, 3 n): stable where negative.

    Args:
        r: the problem of zero order.
        change: at this time.
        first: P1.
        slope: dP1/dt.
    """
    p = r.riccati + first
    b = r.input_matrix
    a = r.state_matrix + r.perturbation(change) - b @ r.inverse_weight @ b.T @ p
    return slope + a.T @ p + p @ a
