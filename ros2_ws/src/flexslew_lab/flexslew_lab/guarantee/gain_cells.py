"""Bound of a gain over a box, cell by cell and arc by arc of the frequencies.

In the coordinates T of a cell (see modal_cell), A is L + B_d(x) + E(x). With R = (z - L - B_d)^-1,
b = T^-1 B and c = C T,

    G = D + c R b + c R E R (I - E R)^-1 b,

and R, b and c differ from those at the centre of the cell and of the arc by what is bounded here.
An arc is divided until its bound is below the limit; a cell in which dividing does not help, is.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import thread_time
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from flexslew_control.analysis.loop import Complex
from flexslew_lab.guarantee.box import Box
from flexslew_lab.guarantee.cell_cover import is_hopeless
from flexslew_lab.guarantee.frequency_cover import LoopChannels
from flexslew_lab.guarantee.modal_cell import (
    MatrixTerms,
    ModalCell,
    modal_cell,
    terms_of,
)
from flexslew_lab.guarantee.polynomial import checks, polynomial_over
from flexslew_plant.arrays import Matrix, Vector

_FIT, _SAFETY = 1e-11, 2.0  # of S, as of A in dynamics_fit
_LEAST = 1e-5  # of the box: no smaller cell is tried
_ROUNDS = 24  # of halving an arc
_EDGES = np.concatenate(([0.0], np.geomspace(1e-4, np.pi, 40)))  # of the first arcs [rad]


class SystemFit(NamedTuple):
    """[[A, B], [C, D]] over a box, without hidden motions; outputs of the response last.

    Args:
        box: of the parameters.
        terms: in normalised coordinates.
        states: that are left.
        error: of each entry.
    """

    box: Box
    terms: MatrixTerms
    states: int
    error: float


@dataclass(frozen=True)
class GainCell:
    """A cell with what bounds its gain.

    Args:
        modal: dynamics of the cell.
        b, c, d: at the centre, in modal coordinates.
        more: bounds of the entries' differences from these, in the same order: for each
            parameter, then of the fit, shape (m + 1, rows, columns).
    """

    modal: ModalCell
    b: Complex
    c: Complex
    d: Matrix
    more: tuple[Matrix, Matrix, Matrix]

    def bounds(self, low: Vector, high: Vector, size: Vector) -> Vector:
        """Return bounds of the gain within arcs, for `|x_i| <= size_i`, shape (k,).

        Args:
            low: angles where arcs begin, shape (k,) [rad].
            high: where they end.
            size: shape (m,).
        """
        modal, blocks = self.modal, self.modal.blocks
        z, half = np.exp(0.5j * (low + high)), 0.5 * (high - low)
        turn = np.tensordot(size, abs(modal.turns), 1)
        eye = np.eye(len(turn))
        spread = np.linalg.solve(eye - turn, turn)
        more_b, more_c, more_d = (np.tensordot(np.append(size, 1.0), p, 1) for p in self.more)
        more_b = more_b + spread @ (abs(self.b) + more_b)
        more_c = more_c + (abs(self.c) + more_c) @ turn
        b, by = (np.array([np.linalg.norm(part[own]) for own in blocks])
                 for part in (self.b, more_b))  # fmt: skip
        c, by_c = (np.array([np.linalg.norm(part[:, own]) for own in blocks])
                   for part in (self.c, more_c))  # fmt: skip
        coupling = modal.coupling(size)
        nearest, moved = modal.rooms(size)
        at_centre, gain = (
            np.zeros((len(z), len(blocks))),
            np.zeros((len(z), *self.d.shape), complex),
        )
        for k, own in enumerate(blocks):
            inner = modal.middle[np.ix_(own, own)]
            inverse = np.linalg.inv(z[:, None, None] * np.eye(len(own)) - inner)
            at_centre[:, k] = np.linalg.norm(inverse, 2, axis=(1, 2))
            gain += self.c[:, own] @ inverse @ self.b[own]
        away = half[:, None] + moved
        room = np.maximum(nearest, 1.0 / at_centre - away)
        differs = np.minimum(away * at_centre / room, at_centre + 1.0 / room)
        all_b, all_c, central = b + by, c + by_c, np.linalg.norm(gain, 2, axis=(1, 2))
        linear = (all_c * differs) @ all_b + at_centre @ (all_c * by) + at_centre @ (by_c * b)
        loop = room[:, :, None] * np.eye(len(blocks)) - coupling
        coupled = np.linalg.solve(loop, np.broadcast_to(all_b[:, None], (len(z), len(b), 1)))
        bent = ((all_c / room)[:, None, :] @ coupling @ coupled)[:, 0, 0]
        bad = (coupled < 0.0).any(axis=(1, 2)) | (room <= 0.0).any(axis=1)
        return np.where(bad, np.inf, central + np.linalg.norm(more_d) + linear + bent)

    def holds(self, limit: float, end: float) -> Vector | None:
        """Return angles where the gain cannot be bounded by a limit, None if there are none.

        Args:
            limit: of the largest singular value.
            end: of the search, as time.thread_time counts [s].
        """
        low, high, size = _EDGES[:-1], _EDGES[1:], np.ones(len(self.modal.turns))
        for _ in range(_ROUNDS):
            bound = self.bounds(low, high, size)
            failed = ~(bound < limit)
            if not failed.any():
                return None
            low, high = low[failed], high[failed]
            middle = 0.5 * (low + high)
            at_points = self.bounds(middle, middle, size)
            if not (at_points < limit).all() or thread_time() > end:
                return np.asarray(middle)
            low, high = np.concatenate((low, middle)), np.concatenate((middle, high))
        return np.asarray(middle)


class BoundedCell(NamedTuple):
    """A cell whose gain is bounded."""

    box: Box
    cell: GainCell


def bounded_cells(
    fit: SystemFit, complement: bool, limit: float, seconds: float
) -> tuple[BoundedCell, ...] | None:
    """Return cells that cover a box, in which all loops are stable and have a gain below a limit.

    Args:
        fit: of the system over the box.
        complement: whether the gain is that of one minus the system.
        limit: of its largest singular value.
        seconds: that the search may take.

    Returns:
        None if no cells were found in this time.
    """
    m, start = len(fit.box.centre), thread_time()
    waiting = [(np.zeros(m), np.ones(m))]
    done: list[BoundedCell] = []
    while waiting:
        centre, radius = waiting.pop()
        if is_hopeless([c.box for c in done], fit.box, start, seconds) or radius.min() < _LEAST:
            return None
        axis = int(np.argmax(radius))
        try:
            cell = gain_cell(fit, complement, centre, radius)
            if cell.modal.bound(np.ones(m)) < 1.0:
                failed = cell.holds(limit, start + seconds)
                if failed is None:
                    here = Box(fit.box.at(centre), fit.box.radius * radius)
                    done.append(BoundedCell(here, cell))
                    continue
                axis = _axis(cell, radius, failed)
            else:
                axis = _axis(cell, radius, None)
        except np.linalg.LinAlgError:
            pass  # the eigenvectors at the centre are dependent: those of its halves need not be
        one = np.eye(m)[axis] * radius
        waiting += [(centre + side * one, radius - 0.5 * one) for side in (-0.5, 0.5)]
    return tuple(done)


def exceeding(
    exact: Callable[[Vector], Matrix],
    states: int,
    complement: bool,
    limit: float,
    cells: Sequence[BoundedCell],
) -> Vector | None:
    """Return values at which the system itself exceeds a limit, or None: an independent check.

    At the centre and random points of each cell, at the angles of its poles and random ones.
    """  # fmt: skip
    rng, n = np.random.default_rng(8), states
    for cell in cells:
        for x in np.vstack((0.0 * cell.box.centre, rng.uniform(-1.0, 1.0, cell.box.centre.shape))):
            s = exact(cell.box.at(x))
            angles = abs(np.angle(np.linalg.eigvals(s[:n, :n])))
            angles = np.append(angles[angles > _EDGES[1]], rng.uniform(0.0, np.pi, 8))
            system = LoopChannels(s[:n, :n], s[:n, n:], s[n:, :n],
                                  s[n:, n:] + complement * np.eye(len(s) - n))  # fmt: skip
            if np.linalg.norm(system.at(angles), 2, axis=(1, 2)).max() > limit:
                return cell.box.at(x)
    return None


def _axis(cell: GainCell, radius: Vector, failed: Vector | None) -> int:
    """Return the parameter whose half leaves the least bound; where none does, the widest."""
    parts = 1.0 - 0.5 * np.eye(len(radius))
    if failed is None:
        found = [cell.modal.bound(size) for size in parts]
    else:
        found = [float(cell.bounds(failed, failed, size).max()) for size in parts]
    return int(np.argmin(found)) if np.isfinite(min(found)) else int(np.argmax(radius))


def system_fit(exact: Callable[[Vector], Matrix], box: Box, shown: Matrix) -> SystemFit:
    """Return a system over a box as a polynomial.

    Args:
        exact: [[A, B], [C, D]] at values.
        box: of these.
        shown: rows that leave hidden motions out, see DynamicsFit.
    """
    samples = checks(exact, box)
    fitted = polynomial_over(exact, box, samples, _FIT)
    error = _SAFETY * max(
        float(abs(fitted.at(d) - s).max())
        for d, s in zip(samples.delta, samples.values, strict=True)
    )
    terms, (kept, n) = terms_of(fitted), shown.shape
    rows, columns = (block_diag(shown, np.eye(size - n)) for size in terms.matrices.shape[1:])
    matrices = rows @ terms.matrices @ columns.T
    return SystemFit(box, MatrixTerms(terms.exponents, matrices), kept, error * n)


def gain_cell(fit: SystemFit, complement: bool, centre: Vector, radius: Vector) -> GainCell:
    """Return what bounds the gain of a cell.

    Args:
        fit: of the system.
        complement: whether it is of one minus the system.
        centre: of the cell, normalised, shape (m,).
        radius: half of its sides.

    Raises:
        numpy.linalg.LinAlgError: see modal_cell.
    """
    n, (exponents, s) = fit.states, fit.terms
    modal = modal_cell(MatrixTerms(exponents, s[:, :n, :n]), centre, radius, fit.error)
    inverse, here = np.linalg.inv(modal.basis), fit.terms.derivative(centre, ())
    parts = inverse @ s[:, :n, n:], s[:, n:, :n] @ modal.basis, s[:, n:, n:]
    b, c, d = (np.tensordot(here, part, 1) for part in parts)
    ones = (abs(inverse).sum(axis=1)[:, None] * np.ones(b.shape),
            np.ones(c.shape) * abs(modal.basis).sum(axis=0), np.ones(d.shape))  # fmt: skip
    far = abs(centre) + radius
    factors = np.array([radius[i] * fit.terms.derivative(far, (i,)) for i in range(len(radius))])
    b_more, c_more, d_more = (
        np.concatenate((np.tensordot(factors, abs(part), 1), fit.error * one[None]))
        for part, one in zip(parts, ones, strict=True)
    )
    d = (d + complement * np.eye(len(d))).real
    return GainCell(modal, b, c, d, (b_more, c_more, d_more))
