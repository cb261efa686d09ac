"""Design of the output feedback controller for any linear system (Sung and Joo, sections 2, 3)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, block_diag, null_space

from flexslew_control.estimators.kalman import continuous_gain
from flexslew_control.linear.design_checks import require_controllable, require_observable
from flexslew_control.linear.riccati import continuous_riccati
from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import BadInput

_CONDITION = 100.0  # of B, from which its units do harm


@dataclass(frozen=True)
class LinearSystem:
    """z' = A z + B u + L w, y = C z + v (1), (2).

    Args:
        a: A, shape (k, k).
        b: B, shape (k, m).
        c: C, shape (l, k).
        noise_input: L, shape (k, w).
        noise_density: Q of w (3), shape (w, w).
        sensor_density: R of v (4), variance times sampling period, shape (l, l).
        names: of the states, for messages, k of them.
    """

    a: Matrix
    b: Matrix
    c: Matrix
    noise_input: Matrix
    noise_density: Matrix
    sensor_density: Matrix
    names: tuple[str, ...]


@dataclass(frozen=True)
class SlidingDesign:
    """Gains and the matrices they came from.

    Where B is ill-conditioned in the units of the bench, as on a large craft, M, its weights, P2
    and K_s are those of z in units in which Q_s has a diagonal of one. The surface is the same.

    Args:
        observer_gain: K_f (6), shape (k, l).
        covariance: P (7), shape (k, k).
        transform: M = [N; B^T] (22), shape (k, k).
        weight_11, weight_12, weight_22: Q11, N12, R22, blocks of W = M^-T Q_s M^-1 (32).
        riccati: P2 (35), shape (k - m, k - m).
        sliding_gain: K_s (34), shape (m, k - m).
        surface: G (28), shape (m, k); G B = B^T B in these units.
        reaching_rate: nu [1/s].
        sliding_poles: eigenvalues of A11 - A12 K_s, shape (k - m,).
    """

    observer_gain: Matrix
    covariance: Matrix
    transform: Matrix
    weight_11: Matrix
    weight_12: Matrix
    weight_22: Matrix
    riccati: Matrix
    sliding_gain: Matrix
    surface: Matrix
    reaching_rate: float
    sliding_poles: NDArray[np.complex128]


def design(system: LinearSystem, weight: Matrix, reaching_rate: float) -> SlidingDesign:
    """Return the Kalman gain and the sliding hypersurfaces that minimise (30).

    K_s = R22^-1 (A12^T P2 + N12^T), G = [K_s, I] M, with P2 from (35).

    Args:
        system: the linear system.
        weight: Q_s, shape (k, k), positive semidefinite.
        reaching_rate: nu > 0 [1/s].

    Raises:
        BadInput: a mode is not controllable or not observable, R22 is not positive definite,
            or a Riccati equation has no stabilising solution.
    """
    a, b = system.a, system.b
    require_controllable(a, b, system.names)
    require_observable(a, system.c, system.names)
    noise = system.noise_input @ system.noise_density @ system.noise_input.T
    observer_gain, covariance = continuous_gain(a, system.c, noise, system.sensor_density)
    units = np.ones(len(a))
    if np.linalg.cond(b) > _CONDITION:
        diagonal = np.diag(weight)
        units = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        a, b = a * units / units[:, None], b / units[:, None]
        b, weight = b / np.linalg.norm(b, axis=0), units[:, None] * weight * units
    basis = null_space(b.T).T  # N
    transform = np.vstack((basis, b.T))
    inverse = np.hstack((basis.T, b @ np.linalg.inv(b.T @ b)))
    k = len(basis)
    transformed, w = transform @ a @ inverse, inverse.T @ weight @ inverse
    a11, a12 = transformed[:k, :k], transformed[:k, k:]
    q11, n12, r22 = w[:k, :k], w[:k, k:], w[k:, k:]
    lowest = float(np.linalg.eigvalsh(r22).min())
    if lowest <= 1e-12 * float(abs(np.linalg.eigvalsh(r22)).max()):
        raise BadInput(
            f"R22 of the weights is not positive definite (eigenvalue {lowest:.3g}): "
            "give every state that the efforts drive (the joint rates) a positive weight"
        )
    try:
        p2 = continuous_riccati(a11, a12, q11, r22, s=n12)
    except LinAlgError as error:
        raise BadInput(f"no optimal sliding surface: {error}; weigh every mode in Q_s") from None
    gain = np.linalg.solve(r22, a12.T @ p2 + n12.T)
    return SlidingDesign(
        observer_gain,
        covariance,
        transform,
        q11,
        n12,
        r22,
        p2,
        gain,
        np.hstack((gain, np.eye(b.shape[1]))) @ transform / units,
        reaching_rate,
        np.linalg.eigvals(a11 - a12 @ gain),
    )


def reaching_matrix(system: LinearSystem, found: SlidingDesign) -> Matrix:
    """Return A - Omega A - Gamma, the closed loop under state feedback (19), shape (k, k).

    Omega = B (G B)^-1 G, Gamma = nu Omega. Its eigenvalues are -nu, m times, and those of
    A11 - A12 K_s (Lemma 3.1).
    """
    omega = _omega(system, found)
    return system.a - omega @ system.a - found.reaching_rate * omega


def closed_loop_matrix(system: LinearSystem, found: SlidingDesign) -> Matrix:
    """Return the matrix of (20) on (z, z - z_hat), shape (2 k, 2 k)."""
    omega = _omega(system, found)
    observer = system.a - found.observer_gain @ system.c
    whole: Matrix = block_diag(reaching_matrix(system, found), observer)
    k = len(system.a)
    whole[:k, k:] = omega @ observer + found.reaching_rate * omega
    return whole


def _omega(system: LinearSystem, found: SlidingDesign) -> Matrix:
    return system.b @ np.linalg.solve(found.surface @ system.b, found.surface)
