"""A plant with performance channels, closed by a controller matrix, and derivatives through it.

A controller of order k is the matrix K = [[D, C], [B, A]] from (y, x) to (u, x+) around the plant
extended by its k states (Burke, Henrion, Lewis and Overton, HIFOO, IFAC ROCOND 2006, section 2).
So every controller is a constant gain, and every gradient is pulled back to K in one place.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from flexslew_control.analysis.lti import Lti
from flexslew_control.analysis.minimal import minimal_part
from flexslew_plant.arrays import Matrix


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

    def minimal(self) -> "PerformancePlant":
        """Return it without states that no input moves or no output sees."""
        outputs, inputs = self.d.shape
        names = tuple(map(str, range(inputs))), tuple(map(str, range(outputs)))
        states = tuple(map(str, range(len(self.a))))
        part = minimal_part(Lti(self.a, self.b, self.c, self.d, *names, states, self.period))
        return replace(self, a=part.a, b=part.b, c=part.c)

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

    def gradient(self, of_matrix: Matrix) -> Matrix:
        """Return the gradient in K of a function with a gradient in M."""
        return self.left.T @ of_matrix @ self.right.T
