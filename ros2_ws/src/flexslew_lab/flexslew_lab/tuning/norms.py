"""Measures of a closed loop with their gradients in its matrix M = [[A, B], [C, D]].

The H-infinity norm is SLICOT's AB13DD, a level-set method on a Hamiltonian pencil (Bruinsma and
Steinbuch 1990); its subgradient is that of the largest singular value at the peak. The H2 norm and
its gradient take two Lyapunov equations (Rautert and Sachs, SIAM J. Optim. 7, 1997).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import eig, solve_continuous_lyapunov, solve_discrete_lyapunov

from flexslew_control.analysis.loop import Complex
from flexslew_lab.tuning.closed_loop import ClosedLoop
from flexslew_plant.arrays import Matrix

_TOLERANCE = 1e-9  # of the norm
_LIMIT = 1e-7  # distance of a stable pole from the limit of stability, per tick


class Measure(NamedTuple):
    """A function of a closed loop.

    Args:
        value: of the function; inf: the loop is not stable, or has no such norm.
        gradient: in M, its own shape; zero where the value is inf.
        frequency: where it is determined [rad/s]; nan: no one frequency.
    """

    value: float
    gradient: Matrix
    frequency: float


Norm = Callable[[ClosedLoop], Measure]


def stability(loop: ClosedLoop) -> Measure:
    """Return the largest growth rate of the poles [1/s]; below 0: stable.

    Re s, or ln |z| / T, and what rounding may hide of it: a double integrator that nothing holds
    has poles at 1 +- 1e-8.
    """
    found = _slowest(loop)
    if not loop.states:
        return found
    size = 1.0 / loop.period if loop.period else float(abs(loop.parts[0]).max())
    return found._replace(value=found.value + _LIMIT * size)


def _slowest(loop: ClosedLoop) -> Measure:
    n, gradient = loop.states, np.zeros_like(loop.matrix)
    if not n:
        return Measure(-np.inf, gradient, np.nan)
    values, left, right = _poles(loop)
    s = _rates(values, loop.period)
    worst = int(np.argmax(s.real))
    gradient[:n, :n] = _of_rate(values[worst], left[:, worst], right[:, worst], loop.period).real
    return Measure(float(s[worst].real), gradient, abs(float(s[worst].imag)))


def decay(loop: ClosedLoop) -> Measure:
    """Return the inverse of the slowest decay rate [s]; inf: not stable."""
    slowest = _slowest(loop)
    if stability(loop).value >= 0.0:
        return _unstable(loop, slowest.frequency)
    return Measure(-1.0 / slowest.value, slowest.gradient / slowest.value**2, slowest.frequency)


def damping(loop: ClosedLoop) -> Measure:
    """Return the inverse of the smallest damping ratio of a pole [-]; inf: not stable."""
    n, gradient = loop.states, np.zeros_like(loop.matrix)
    values, left, right = _poles(loop)
    s = _rates(values, loop.period)
    if not n or s.real.max() >= 0.0:
        return _unstable(loop, np.nan) if n else Measure(0.0, gradient, np.nan)
    inverse = abs(s) / -s.real
    k = int(np.argmax(inverse))
    rate = _of_rate(values[k], left[:, k], right[:, k], loop.period)
    size, real = abs(s[k]), s[k].real  # of f = -|s| / Re s
    slope = np.conj(s[k]) / size / -real + size / real**2
    gradient[:n, :n] = (slope * rate).real
    return Measure(float(inverse[k]), gradient, float(size))


def _poles(loop: ClosedLoop) -> tuple[Complex, Complex, Complex]:
    n = loop.states
    found: Any = eig(loop.matrix[:n, :n], left=True, right=True)
    values, left, right = (np.asarray(part, dtype=np.complex128) for part in found)
    return values, left, right


def _rates(poles: Complex, period: float) -> Complex:
    if not period:
        return poles
    rates = np.log(np.where(poles == 0.0, np.finfo(float).tiny, poles)) / period
    return np.asarray(rates, dtype=np.complex128)


def _of_rate(value: complex, left: Complex, right: Complex, period: float) -> Complex:
    """Return ds/dA of a simple pole: conj(y) x^T / (y^H x), over z T of a sampled one."""
    scale = complex(left.conj() @ right)
    if period:
        scale *= value * period
    return np.asarray(np.outer(left.conj(), right) / scale)


def _unstable(loop: ClosedLoop, frequency: float) -> Measure:
    return Measure(np.inf, np.zeros_like(loop.matrix), frequency)


def h_infinity(loop: ClosedLoop) -> Measure:
    """Return the largest singular value over all frequencies."""
    import ctrlsys

    growing = stability(loop)
    if growing.value >= 0.0:
        return _unstable(loop, growing.frequency)
    a, b, c, d = (np.asfortranarray(part) for part in loop.parts)
    n, m, p = len(a), b.shape[1], len(c)
    if not (m and p):
        return Measure(0.0, np.zeros_like(loop.matrix), np.nan)
    kind, start = "D" if loop.period else "C", np.array([0.0, 1.0])
    eye = np.asfortranarray(np.eye(n))
    peak, at, failed = ctrlsys.ab13dd(
        kind, "I", "S", "D", n, m, p, start, a, eye, b, c, d, _TOLERANCE
    )
    if failed or not peak[1] or not np.isfinite(peak).all():
        return _unstable(loop, np.nan)
    angle = at[0] / at[1] if at[1] else np.inf
    return _peak_at(loop, angle, peak[0] / peak[1])


def _peak_at(loop: ClosedLoop, angle: float, value: float) -> Measure:
    """Return the measure from the peak's place: an angle of z [rad], or s / i [rad/s]."""
    a, b, c, d = loop.parts
    n, gradient = loop.states, np.zeros_like(loop.matrix)
    if not np.isfinite(angle):
        u, _, vh = np.linalg.svd(d)
        gradient[n:, n:] = np.outer(u[:, 0], vh[0])
        return Measure(value, gradient, np.inf)
    point = np.exp(1j * angle) if loop.period else 1j * angle
    resolvent = point * np.eye(n) - a
    states = np.linalg.solve(resolvent, b)
    u, size, vh = np.linalg.svd(c @ states + d)
    right = np.concatenate((states @ vh[0].conj(), vh[0].conj()))
    left = np.concatenate((np.linalg.solve(resolvent.conj().T, c.T @ u[:, 0]), u[:, 0]))
    gradient[:] = np.outer(left.conj(), right).real
    frequency = angle / loop.period if loop.period else angle
    return Measure(max(value, float(size[0])), gradient, float(frequency))


def h_two(loop: ClosedLoop) -> Measure:
    """Return the H2 norm: of a sampled loop the root of the sum of its squared pulse responses."""
    growing = stability(loop)
    a, b, c, d = loop.parts
    if growing.value >= 0.0 or (not loop.period and d.any()):
        return _unstable(loop, growing.frequency)
    reached, seen = _gramians(loop)
    of_a = seen @ a @ reached if loop.period else seen @ reached
    square = float(np.sum((c @ reached) * c) + np.sum(d * d))
    value = float(np.sqrt(max(square, 0.0)))
    gradient = np.block([[of_a, seen @ b], [c @ reached, d]]) / max(value, 1e-300)
    return Measure(value, np.asarray(gradient, dtype=np.float64), np.nan)


def _gramians(loop: ClosedLoop) -> tuple[Matrix, Matrix]:
    """Return the Gramians of controllability and of observability."""
    a, b, c, _ = loop.parts
    solve = solve_discrete_lyapunov if loop.period else solve_continuous_lyapunov
    sign = 1.0 if loop.period else -1.0
    pair = solve(a, sign * b @ b.T), solve(a.T, sign * c.T @ c)
    return np.asarray(pair[0], dtype=np.float64), np.asarray(pair[1], dtype=np.float64)
