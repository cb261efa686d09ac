"""Stability margins of the PD loop and the gains that make them largest.

Gorinevsky and Vukovich (1998), Figures 3 and 4.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.model import Model

PITCH_RANGE = (0.0, 1.245)  # of the guaranteed margin: where it is largest at the gains (17) [rad]
_POINTS = 42  # operating points over the range; the margin's minimum is at its ends or a kink
_MOST = 4000.0  # largest gain [N m/rad, N m s/rad]


class BestGains(NamedTuple):
    """The gains with the largest margin."""

    margin: float  # [1/s]
    kp: float  # [N m/rad]
    kd: float  # [N m s/rad]


def stability_margin(model: Model, kp: float, kd: float, pitch: float) -> float:
    """Return s = -max_j Re(lambda_j) [1/s] of the loop (14), linearised at rest.

    Args:
        model: the testbed.
        kp, kd: the gains (16), the same for both joints [N m/rad, N m s/rad].
        pitch: psi_0 [rad].
    """
    return float(
        _margins(_operating_points(model, np.array([pitch])), np.array([kp]), np.array([kd]))[0]
    )


def guaranteed_margin(model: Model, kp: float, kd: float) -> float:
    """Return delta = min over psi_0 in PITCH_RANGE of s(kp, kd; psi_0), see above [1/s]."""
    at = _operating_points(model, np.linspace(*PITCH_RANGE, _POINTS))
    return float(_margins(at, np.array([kp]), np.array([kd])).min())


def margin_table(model: Model, kp: Vector, kd: Vector, pitch_values: Vector) -> Matrix:
    """Return min over the pitches of s, shape (len(kp), len(kd)) [1/s]: Figures 3 and 4.

    Args:
        model: the testbed.
        kp, kd: gains, shape (k,) [N m/rad] and (l,) [N m s/rad].
        pitch_values: one operating point for Figure 3, the range for Figure 4 [rad].
    """
    grid_p, grid_d = (g.ravel() for g in np.meshgrid(kp, kd, indexing="ij"))
    smallest = np.full(grid_p.shape, np.inf)
    for pitch in pitch_values:
        smallest = np.minimum(
            smallest, _margins(_operating_points(model, np.array([pitch])), grid_p, grid_d)
        )
    return smallest.reshape(len(kp), len(kd))


def best_gains(model: Model, pitch_values: tuple[float, float] | float = PITCH_RANGE) -> BestGains:
    """Return the gains with the largest margin, by a grid and then Nelder and Mead's simplex.

    The margin has kinks at its maximum, where eigenvalues cross, so no derivative is used.

    Args:
        model: the testbed.
        pitch_values: range of psi_0 for the guaranteed margin, or one operating point [rad].
    """
    fixed = not isinstance(pitch_values, tuple)
    spread = (
        np.linspace(*pitch_values, _POINTS)
        if isinstance(pitch_values, tuple)
        else np.array([pitch_values])
    )
    gains = np.geomspace(_MOST / 80.0, _MOST, 24)
    coarse = margin_table(model, gains, gains, spread if fixed else spread[::8])

    at = _operating_points(model, spread)

    def loss(log_gains: Vector) -> float:
        kp, kd = np.exp(log_gains)
        return -float(_margins(at, np.array([kp]), np.array([kd])).min())

    best = None
    for flat in np.argsort(coarse, axis=None)[-4:]:
        i, j = np.unravel_index(flat, coarse.shape)
        start = np.log([gains[i], gains[j]])
        for size in (0.2, 0.02, 0.002):  # restarts: a simplex may collapse on a ridge
            simplex = start + size * np.array([[0.0, 0.0], [1.0, 0.3], [-0.3, 1.0]])
            found = minimize(
                loss,
                start,
                method="Nelder-Mead",
                options={"initial_simplex": simplex, "xatol": 1e-8, "fatol": 1e-12},
            )
            start = found.x
        if best is None or found.fun < best.fun:
            best = found
    assert best is not None
    kp, kd = np.exp(best.x)
    return BestGains(-float(best.fun), float(kp), float(kd))


class _OperatingPoints(NamedTuple):
    """M^-1 K, M^-1 D and M^-1 B B^T of (14) at each pitch, shapes (pitches, n, n)."""

    stiffness: Matrix
    damping: Matrix
    actuation: Matrix


def _operating_points(model: Model, pitch_values: Vector) -> _OperatingPoints:
    parts = []
    for pitch in pitch_values:
        q = np.zeros(model.coordinates)
        q[1] = pitch
        rest = model.linearise(q)
        inverse = np.linalg.inv(rest.mass)
        input_term = inverse * (np.arange(model.coordinates) < model.joints)
        parts.append((inverse @ rest.stiffness, inverse @ rest.damping, input_term))
    return _OperatingPoints(*(np.array(part) for part in zip(*parts, strict=True)))


def _margins(at: _OperatingPoints, kp: Vector, kd: Vector) -> Vector:
    """Return s for each of the gains and operating points (one of the two may have one entry)."""
    n = at.stiffness.shape[-1]
    a = np.zeros((max(len(kp), len(at.stiffness)), 2 * n, 2 * n))
    a[:, :n, n:] = np.eye(n)
    a[:, n:, :n] = -at.stiffness - kp[:, None, None] * at.actuation
    a[:, n:, n:] = -at.damping - kd[:, None, None] * at.actuation
    return np.asarray(-np.linalg.eigvals(a).real.max(axis=1))
