"""A plant with performance channels, closed by a controller matrix, and derivatives through it.

A controller of order k is the matrix K = [[D, C], [B, A]] from (y, x) to (u, x+) around the plant
extended by its k states (Burke, Henrion, Lewis and Overton, HIFOO, IFAC ROCOND 2006, section 2).
So every controller is a constant gain, and every gradient is pulled back to K in one place.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from flexslew_control.analysis.loop import Complex
from flexslew_control.analysis.lti import transfer
from flexslew_lab.analysis.separation import LinearPart, separated_parts
from flexslew_plant.arrays import Matrix, Vector

_LIMIT = 1e-6  # distance from the limit of stability, of one tick's or of the fastest pole
_HIDDEN = 1e-11  # residue of a stable pole that nothing moves or sees, of the largest
_ROUNDING = 1e-8  # response of hidden states on the limit, of the largest
_SAME = 1e-9  # distance of a pole from itself, computed twice; rounding of directions
_ABSENT = 1e-9  # rounding of a product that is zero, of its factors


@dataclass(frozen=True)
class PerformancePlant:
    """From (w, u) to (z, y): disturbances and control to performance and measurement.

    Args:
        a, b, c, d: of x+ (or dx/dt) = A x + B (w, u), (z, y) = C x + D (w, u).
        controls: number of inputs u, the last ones.
        measurements: number of outputs y, the last ones.
        period: one tick [s]; 0: continuous.
    """

    a: Matrix
    b: Matrix
    c: Matrix
    d: Matrix
    controls: int
    measurements: int
    period: float = 0.0

    def extended(self, order: int) -> "PerformancePlant":
        """Return it with the states of a controller: u and y are followed by x+ and x."""
        return replace(
            self,
            a=block_diag(self.a, np.zeros((order, order))),
            b=block_diag(self.b, np.eye(order)),
            c=block_diag(self.c, np.eye(order)),
            d=block_diag(self.d, np.zeros((order, order))),
            controls=self.controls + order,
            measurements=self.measurements + order,
        )

    def around(self, k: Matrix, left: Matrix, right: Matrix) -> "PerformancePlant":
        """Return the plant that a gain G sees where the controller is K + left G right.

        Args:
            k: K, shape (controls, measurements).
            left: shape (controls, g).
            right: shape (g, measurements).
        """
        p, q, n = len(self.d) - self.measurements, self.d.shape[1] - self.controls, len(self.a)
        loop, direct = self.closed(k), self.d[p:, q:]
        inner = np.linalg.inv(np.eye(self.measurements) - direct @ k)
        by, seen = loop.left @ left, right @ loop.right
        a, b, c, d = loop.parts
        return PerformancePlant(
            a,
            np.hstack((b, by[:n])),
            np.vstack((c, seen[:, :n])),
            np.block([[d, by[n:]], [seen[:, n:], right @ inner @ direct @ left]]),
            left.shape[1],
            len(right),
            self.period,
        )

    def reduced(self) -> "PerformancePlant":
        """Return it without states that no input moves or no output sees.

        States on the limit of stability are separated first: there a hidden state makes every norm
        infinite. The others are left out by their residues.
        """
        poles = np.linalg.eigvals(self.a).astype(np.complex128)
        inner, circle = _separated(self, _on_limit(poles, self.period))
        size = _markov(inner)
        if not len(circle.a) or _markov(circle) <= _ROUNDING * max(size, _markov(self)):
            return inner.visible()
        part = _minimal(circle)
        seen = inner.visible()
        return replace(
            self, a=block_diag(seen.a, part.a), b=np.vstack((seen.b, part.b)),
            c=np.hstack((seen.c, part.c)),
        )  # fmt: skip

    def trimmed(self) -> "PerformancePlant":
        """Return it without states from which no way leads to an output, as unread memories."""
        seen = self.c.any(axis=0)
        while (more := seen | self.a[seen].any(axis=0)).sum() > seen.sum():
            seen = more
        return replace(self, a=self.a[np.ix_(seen, seen)], b=self.b[seen], c=self.c[:, seen])

    def visible(self) -> "PerformancePlant":
        """Return a stable plant without the poles whose residues are zero."""
        if not len(self.a):
            return self
        values, right = np.linalg.eig(self.a)
        moved = np.linalg.norm(np.linalg.solve(right, self.b.astype(complex)), axis=1)
        residues = moved * np.linalg.norm(self.c @ right, axis=0)
        hidden = residues <= _HIDDEN * residues.max()
        for k in np.flatnonzero(hidden):  # a part with poles that others share cannot be separated
            hidden[k] = not (abs(values - values[k])[~hidden] <= _SAME).any()

        def is_hidden(pole: complex) -> bool:
            return bool(abs(values[hidden] - pole).min() <= _SAME)

        return _separated(self, is_hidden)[0] if hidden.any() else self

    def closed(self, k: Matrix) -> "ClosedLoop":
        """Return the loop with u = K y."""
        p, q = len(self.d) - self.measurements, self.d.shape[1] - self.controls
        after = np.vstack((self.b[:, q:], self.d[:p, q:]))
        before = np.hstack((self.c[p:], self.d[p:, :q]))
        inner = np.linalg.inv(np.eye(self.measurements) - self.d[p:, q:] @ k)
        right = inner @ before
        left = after @ (np.eye(self.controls) + k @ inner @ self.d[p:, q:])
        whole = np.block([[self.a, self.b[:, :q]], [self.c[:p], self.d[:p, :q]]])
        whole = whole + after @ k @ right
        return ClosedLoop(whole, len(self.a), self.period, left, right)


def _on_limit(poles: Complex, period: float) -> Callable[[complex], bool]:
    """Return whether a pole is on the limit of stability or beyond it, given all poles.

    Rounding moves a multiple pole, so it is recognised by its place and not by its value.
    """
    if period:
        return lambda pole: abs(pole) > 1.0 - _LIMIT
    limit = -_LIMIT * max(float(abs(poles).max(initial=0.0)), 1.0)
    return lambda pole: pole.real > limit


def _markov(plant: PerformancePlant) -> float:
    """Return the largest response to a pulse over as many steps as there are states."""
    a = plant.a if plant.period else plant.a / max(float(abs(plant.a).max(initial=0.0)), 1e-300)
    size, state = 0.0, plant.b
    for _ in range(len(a) + 1):
        size = max(size, float(abs(plant.c @ state).max(initial=0.0)))
        state = a @ state
    return size


def _minimal(plant: PerformancePlant) -> PerformancePlant:
    """Return the part of a plant with few states that its inputs move and its outputs see."""
    n = (plant.a - np.eye(len(plant.a))) / plant.period if plant.period else plant.a
    moved = _reached(n, plant.b)
    seen = _reached((moved.T @ n @ moved).T, (plant.c @ moved).T)
    way = moved @ seen
    return replace(plant, a=way.T @ plant.a @ way, b=way.T @ plant.b, c=plant.c @ way)


def _reached(a: Matrix, b: Matrix) -> Matrix:
    """Return an orthonormal basis of what b, a b, a^2 b, ... span, each of norm one."""
    columns = [b / np.linalg.norm(b)]
    for _ in range(len(a) - 1):
        more = a @ columns[-1]
        size = np.linalg.norm(more)
        if size <= _ABSENT * np.linalg.norm(a):
            break
        columns.append(more / size)
    basis, sizes, _ = np.linalg.svd(np.hstack(columns), full_matrices=False)
    return np.asarray(basis[:, sizes > _SAME * sizes[0]])


def _separated(
    plant: PerformancePlant, selects: Callable[[complex], bool]
) -> tuple[PerformancePlant, PerformancePlant]:
    """Return the parts of a plant without and with the selected poles, whose sum is the plant."""

    def is_other(pole: complex) -> bool:
        return not selects(pole)

    parts = separated_parts(LinearPart(plant.a, plant.b, plant.c), is_other)
    return replace(plant, **parts[0]._asdict()), replace(plant, **parts[1]._asdict())


@dataclass(frozen=True)
class ClosedLoop:
    """The matrix M = [[A, B], [C, D]] from w to z, and how it changes: dM = left dK right.

    Args:
        matrix: M.
        states: number of states.
        period: one tick [s]; 0: continuous.
        left: shape (states + outputs, controls).
        right: shape (measurements, states + inputs).
    """

    matrix: Matrix
    states: int
    period: float
    left: Matrix
    right: Matrix

    @property
    def parts(self) -> tuple[Matrix, Matrix, Matrix, Matrix]:
        """A, B, C and D."""
        n, m = self.states, self.matrix
        return m[:n, :n], m[:n, n:], m[n:, :n], m[n:, n:]

    def at(self, frequency: Vector) -> Complex:
        """Return its response at frequencies [rad/s], shape (k, z, w)."""
        s = 1j * np.asarray(frequency)
        point = np.exp(s * self.period) if self.period else s
        return transfer(self.parts, point.astype(np.complex128))

    def gradient(self, of_matrix: Matrix) -> Matrix:
        """Return the gradient in K of a function with a gradient in M."""
        return self.left.T @ of_matrix @ self.right.T
