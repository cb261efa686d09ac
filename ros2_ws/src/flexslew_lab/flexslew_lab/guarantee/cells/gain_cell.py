"""Bound of a gain over a cell of parameters and arcs of the frequencies.

In the coordinates T of a cell (see modal_cell), A is L + B_d(x) + E(x). With R = (z - L - B_d)^-1,
b = T^-1 B and c = C T,

    G = D + c R b + c R E R (I - E R)^-1 b,

and R, b and c differ from those at the centre of the cell and of the arc by what is bounded here.
"""

from dataclasses import dataclass
from time import thread_time

import numpy as np

from flexslew_control.analysis.loop import Complex
from flexslew_lab.guarantee.cells.modal_cell import ModalCell, modal_cell
from flexslew_lab.guarantee.fit.dynamics_fit import SystemFit
from flexslew_lab.guarantee.fit.polynomial import MatrixTerms
from flexslew_plant.arrays import Matrix, Vector

_ROUNDS = 24  # of halving an arc
LOWEST = 1e-4  # end of the first arc [rad]
_EDGES = np.concatenate(([0.0], np.geomspace(LOWEST, np.pi, 40)))  # of the first arcs [rad]


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
        at_centre = np.zeros((len(z), len(blocks)))
        gain = np.tile(self.d.astype(complex), (len(z), 1, 1))
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
