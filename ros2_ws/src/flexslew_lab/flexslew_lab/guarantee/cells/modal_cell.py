"""Bound of the loop's eigenvalues over a cell of parameters, in modal coordinates.

With delta = c + r x, |x_i| <= 1, and V the eigenvectors at the centre c, the loop there is
V^-1 A V = L + B(x) + C(x): L is block diagonal, B linear in x, C of higher order. Let B_d be the
diagonal blocks of B, and X(x) solve L X - X L = B_d - B. Then T = V (I + X) leaves

    T^-1 A T = L + B_d + (I + X)^-1 (B X - X B_d + C (I + X)).

The last term is of second order in the cell's size. The matrix M of the largest norms of the blocks
has a spectral radius that no loop of the cell exceeds. Light damping makes cells small, but not
many: within one a frequency may move by a share of the root of the damping ratio.
"""

from dataclasses import dataclass
from itertools import combinations_with_replacement, permutations

import numpy as np
from scipy.linalg import cholesky, schur, solve_discrete_lyapunov, solve_sylvester

from flexslew_control.analysis.loop import Complex
from flexslew_lab.guarantee.box import corners
from flexslew_lab.guarantee.fit.polynomial import MatrixTerms
from flexslew_plant.arrays import Indices, Matrix, Vector

_NEAR = 0.7  # of the distance from the unit circle: nearer eigenvalues share a block
_SLACK = 0.5  # of a block's distance from the circle that its coordinates leave
_ROUNDING = 1e-15  # of a product's terms, for each state


@dataclass(frozen=True)
class ModalCell:
    """The loop about the centre of a cell: coordinates, blocks, and what differs in the cell.

    Args:
        basis: V, shape (n, n).
        blocks: its columns in each block.
        middle: V^-1 A V at the centre, shape (n, n).
        slopes: B_i, shape (m, n, n).
        turns: X_i, shape (m, n, n).
        seconds: Q_ij of B X - X B_d and half of the second derivatives, i <= j.
        bends: half of the second derivatives, i <= j.
        rest: entries of what is of third order, and of the error of the fit, by corners |x| = 1.
    """

    basis: Complex
    blocks: tuple[Indices, ...]
    middle: Complex
    slopes: Complex
    turns: Complex
    seconds: dict[tuple[int, int], Complex]
    bends: dict[tuple[int, int], Complex]
    rest: tuple[dict[tuple[int, ...], Matrix], Matrix]

    def bound(self, size: Vector) -> float:
        """Return the spectral radius that no loop exceeds in a part of the cell, |x| <= size."""
        return radius_of(self.comparison(size))

    def comparison(self, size: Vector) -> Matrix:
        """Return M, the largest norms of blocks for `|x_i| <= size_i`, shape (blocks, blocks)."""
        second, later = self._entries(size)
        out, within = self.block_norms(second + later), 1.0 - self.rooms(size)[0]
        for k, own in enumerate(self.blocks):
            if len(own) == 1:
                out[k, k] = self._modulus(int(own[0]), size) + later[own[0], own[0]]
            else:
                out[k, k] += within[k]
        return out

    def coupling(self, size: Vector) -> Matrix:
        """Return the norms of the blocks of E, T^-1 A T = L + B_d + E, shape (blocks, blocks)."""
        second, later = self._entries(size)
        return self.block_norms(second + later)

    def rooms(self, size: Vector) -> tuple[Vector, Vector]:
        """Return one minus the largest norm of each block of L + B_d, and that of B_d."""
        outer, found = corners(len(size)) * size, []
        for own in self.blocks:
            slopes = np.tensordot(outer, self.slopes[:, own][:, :, own], 1)
            whole = self.middle[np.ix_(own, own)] + slopes
            found.append([np.linalg.norm(part, 2, axis=(1, 2)).max() for part in (whole, slopes)])
        norms = np.array(found)
        return 1.0 - norms[:, 0], norms[:, 1]

    def block_norms(self, entries: Matrix) -> Matrix:
        """Return the norms of the blocks of a matrix, shape (blocks, blocks)."""
        return np.array([[np.linalg.norm(entries[np.ix_(a, b)]) for b in self.blocks]
                         for a in self.blocks])  # fmt: skip

    def _entries(self, size: Vector) -> tuple[Matrix, Matrix]:
        """Return bounds of the entries of E: of second order, and of what is left."""
        x = np.tensordot(size, abs(self.turns), 1)
        eye, zero = np.eye(len(x)), np.zeros(x.shape)
        if x.sum(axis=1).max(initial=0.0) >= 1.0 and max(abs(np.linalg.eigvals(x))) >= 1.0:
            return zero, np.full(x.shape, np.inf)
        second, bend = (
            sum((size[i] * size[j] * abs(q) for (i, j), q in terms.items()), zero)
            for terms in (self.seconds, self.bends)
        )
        third = sum((np.prod(size[list(p)]) * t for p, t in self.rest[0].items()), self.rest[1])
        third = third @ (eye + x) + bend @ x
        return second, third + x @ np.linalg.solve(eye - x, second + third)

    def _modulus(self, k: int, size: Vector) -> float:
        """Return the largest modulus of an eigenvalue to second order: |l + d| with d = d(x).

        A shift along the circle counts by its square: sqrt(a^2 + t^2), where a is the radial part
        and t the tangential one.
        """
        value = self.middle[k, k]
        radius = abs(value)
        toward = np.conj(value) / max(radius, 1e-300)
        linear = toward * self.slopes[:, k, k]
        radial, across = float(abs(linear.real) @ size), float(abs(linear.imag) @ size)
        bent = 0.0
        for (i, j), q in self.seconds.items():
            term = toward * q[k, k] * size[i] * size[j]
            bent += max(term.real, 0.0) if i == j else abs(term.real)
            across += abs(term.imag)
        return float(np.hypot(radius + radial + bent, across))

    def coordinates(self, x: Vector) -> Complex:
        """Return T at x."""
        return np.asarray(self.basis @ (np.eye(len(self.basis)) + np.tensordot(x, self.turns, 1)))


def modal_cell(terms: MatrixTerms, centre: Vector, radius: Vector, error: float) -> ModalCell:
    """Return the loop about the centre of a cell.

    Args:
        terms: of A(delta).
        centre: of the cell, shape (m,).
        radius: half of its sides, shape (m,).
        error: of each entry of A.

    Raises:
        numpy.linalg.LinAlgError: if the eigenvectors are not independent.
    """
    m, n = len(centre), terms.matrices.shape[1]
    a = np.asarray(np.tensordot(terms.derivative(centre, ()), terms.matrices, 1), complex)
    basis, blocks = _blocks(a)
    inverse = np.linalg.inv(basis)
    modal = inverse @ terms.matrices @ basis
    size = abs(inverse) @ abs(a) @ abs(basis) * (_ROUNDING * n)
    middle = np.tensordot(terms.derivative(centre, ()), modal, 1)
    outside = np.ones((n, n), dtype=bool)
    for own in blocks:
        outside[np.ix_(own, own)] = False
    slopes = np.array([np.tensordot(radius[i] * terms.derivative(centre, (i,)), modal, 1)
                       for i in range(m)])  # fmt: skip
    turns = np.array([_turn(middle, -slope, blocks) for slope in slopes])
    bends, seconds = {}, {}
    for i, j in combinations_with_replacement(range(m), 2):
        weight = radius[i] * radius[j] * (0.5 if i == j else 1.0)
        bends[i, j] = np.tensordot(weight * terms.derivative(centre, (i, j)), modal, 1)
        seconds[i, j] = bends[i, j] + sum(
            slopes[p] @ turns[q] - turns[q] @ np.where(outside, 0.0, slopes[p])
            for p, q in set(permutations((i, j)))
        )
    thirds: dict[tuple[int, ...], Matrix] = {}
    for axes in combinations_with_replacement(range(m), 3):
        weight = np.prod(radius[list(axes)]) * len(set(permutations(axes))) / 6.0
        factors = terms.derivative(abs(centre) + radius, axes)
        thirds[axes] = np.tensordot(weight * factors, abs(modal), 1)
    constant = size + np.where(outside, abs(middle), 0.0)
    constant = constant + error * np.outer(abs(inverse).sum(axis=1), abs(basis).sum(axis=0))
    return ModalCell(basis, blocks, middle, slopes, turns, seconds, bends, (thirds, constant))


def radius_of(matrix: Matrix | Complex) -> float:
    """Return the spectral radius of a matrix, inf where it is not finite."""
    if not np.isfinite(matrix).all():
        return np.inf
    return float(abs(np.linalg.eigvals(matrix)).max(initial=0.0))


def _turn(middle: Complex, wanted: Complex, blocks: tuple[Indices, ...]) -> Complex:
    """Return X with L X - X L = wanted outside of the diagonal blocks of L, zero within."""
    single = np.array([own[0] for own in blocks if len(own) == 1], dtype=np.int64)
    groups = [(single, True)] * bool(len(single))
    groups += [(own, False) for own in blocks if len(own) > 1]
    out = np.zeros_like(middle)
    for rows, diagonal in groups:
        for columns, other in groups:
            here = np.ix_(rows, columns)
            if rows is columns and not diagonal:
                continue
            if diagonal and other:
                values = np.diagonal(middle)[rows]
                gap = values[:, None] - values + np.eye(len(rows))
                out[here] = wanted[here] / gap * (1.0 - np.eye(len(rows)))
                continue
            left, right = (np.diag(np.diagonal(middle)[g]) if d else middle[np.ix_(g, g)]
                           for g, d in ((rows, diagonal), (columns, other)))  # fmt: skip
            out[here] = solve_sylvester(left, -right, wanted[here])
    return out


def _blocks(a: Complex) -> tuple[Complex, tuple[Indices, ...]]:
    """Return coordinates in which a matrix is block diagonal, and the columns of each block.

    Eigenvalues share a block where they are nearer to each other than to the unit circle. A block
    of several has the coordinates of its Lyapunov function, in which its norm is below one.
    """
    values, vectors = np.linalg.eig(a)
    room = 1.0 - abs(values)
    near = abs(values[:, None] - values) <= _NEAR * np.minimum(room[:, None], room)
    label = np.arange(len(values))
    for _ in values:
        label = np.array([label[row].min() for row in near | np.eye(len(values), dtype=bool)])
    parts, blocks, first = [], [], 0
    for one in np.unique(label):
        own = np.flatnonzero(label == one)
        parts.append(vectors[:, own] if len(own) == 1 else _together(a, values[own], values))
        blocks.append(np.arange(first, first + len(own), dtype=np.int64))
        first += len(own)
    return np.asarray(np.hstack(parts), dtype=np.complex128), tuple(blocks)


def _together(a: Complex, own: Complex, values: Complex) -> Complex:
    """Return a basis of the invariant subspace of some eigenvalues, in Lyapunov coordinates."""
    others = np.setdiff1d(values, own)

    def belongs(real: float, imaginary: float = 0.0) -> bool:  # scipy gives one complex number
        value = real + 1j * imaginary
        return bool(abs(own - value).min() < abs(others - value).min(initial=np.inf))

    triangular, basis, kept = schur(a, sort=belongs)
    if kept != len(own):
        raise np.linalg.LinAlgError("eigenvalues of a block are not separate")
    block = triangular[:kept, :kept]
    most = abs(own).max()
    scaled = block / (most + _SLACK * (1.0 - most))
    root = cholesky(solve_discrete_lyapunov(scaled.conj().T, np.eye(kept)))
    return np.asarray(basis[:, :kept] @ np.linalg.inv(root), dtype=np.complex128)
