"""A plant with performance channels, closed by a controller matrix, and derivatives through it.

A controller of order k is the matrix K = [[D, C], [B, A]] from (y, x) to (u, x+) around the plant
extended by its k states (Burke, Henrion, Lewis and Overton, HIFOO, IFAC ROCOND 2006, section 2).
So every controller is a constant gain, and every gradient is pulled back to K in one place.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from flexslew_control.analysis.loop import Complex
from flexslew_control.analysis.lti import Lti, transfer
from flexslew_control.analysis.minimal import minimal_part
from flexslew_lab.analysis.separation import LinearPart, separated_parts
from flexslew_plant.arrays import Matrix, Vector

_LIMIT = 1e-6  # distance from the limit of stability, of one tick's or of the fastest pole
_HIDDEN = 1e-11  # residue of a stable pole that nothing moves or sees, of the largest
_ROUNDING = 1e-8  # response of hidden states on the limit, of the largest
_SAME = 1e-9  # distance of a pole from itself, computed twice


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
        outputs, inputs = self.d.shape
        names = tuple(map(str, range(inputs))), tuple(map(str, range(outputs)))
        states = tuple(map(str, range(len(circle.a))))
        part = minimal_part(Lti(circle.a, circle.b, circle.c, 0.0 * self.d, *names, states,
                                self.period))  # fmt: skip
        seen = inner.visible()
        return replace(
            self, a=block_diag(seen.a, part.a), b=np.vstack((seen.b, part.b)),
            c=np.hstack((seen.c, part.c)),
        )  # fmt: skip

    def visible(self) -> "PerformancePlant":
        """Return a stable plant without the poles whose residues are zero."""
        if not len(self.a):
            return self
        values, right = np.linalg.eig(self.a)
        moved = np.linalg.norm(np.linalg.solve(right, self.b.astype(complex)), axis=1)
        residues = moved * np.linalg.norm(self.c @ right, axis=0)
        hidden = residues <= _HIDDEN * residues.max()
        return _separated(self, values[hidden])[0] if hidden.any() else self

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


def _on_limit(poles: Complex, period: float) -> Complex:
    """Return the poles that are on the limit of stability, or beyond it."""
    if period:
        return poles[abs(poles) > 1.0 - _LIMIT]
    return poles[poles.real > -_LIMIT * max(float(abs(poles).max(initial=0.0)), 1.0)]


def _markov(plant: PerformancePlant) -> float:
    """Return the largest response to a pulse over as many steps as there are states."""
    a = plant.a if plant.period else plant.a / max(float(abs(plant.a).max(initial=0.0)), 1e-300)
    size, state = 0.0, plant.b
    for _ in range(len(a) + 1):
        size = max(size, float(abs(plant.c @ state).max(initial=0.0)))
        state = a @ state
    return size


def _separated(
    plant: PerformancePlant, poles: Complex
) -> tuple[PerformancePlant, PerformancePlant]:
    """Return the parts of a plant without and with the poles, whose sum is the plant."""

    def is_other(pole: complex) -> bool:
        return bool(abs(poles - pole).min(initial=np.inf) > _SAME)

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
