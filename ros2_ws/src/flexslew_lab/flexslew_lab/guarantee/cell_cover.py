"""Stability over a box, cell by cell: what lightly damped loops of a few parameters need.

Each cell has a bound of the spectral radius below one, see modal_cell. A cell without one is
divided across the parameter whose half leaves the least bound.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import monotonic
from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space, schur

from flexslew_lab.guarantee.box import Box, corners
from flexslew_lab.guarantee.modal_cell import ModalCell, Terms, modal_cell, radius_of, terms_of
from flexslew_lab.guarantee.polynomial import checks, polynomial_over
from flexslew_plant.arrays import Matrix, Vector

_FIT = 1e-11  # error at which the fit of a region ends, of the largest entry [-]
_SAFETY = 2.0  # of the fit's error, which is known at points alone
_CIRCLE, _ONE = 1e-9, 1e-5  # from the circle, from z = 1: poles of motions that a loop may not show
_HIDDEN = 1e-9  # of the largest entry: what is less does not act on such a motion
_FLOOR = 1e-14  # of a norm that is checked
_REFIT, _COARSE = 0.6, 0.7  # of a region's size; of the room that a fit has to leave
_LEAST = 1e-6  # of the box: no smaller cell is tried
_JUDGED = 0.2  # of the time: then a search goes on if it has done a fifth of that share
_POINTS = 2  # random points of a cell that are checked, after its centre


class Cell(NamedTuple):
    """A cell with its bound.

    Args:
        box: of the parameters.
        shown: orthonormal rows that leave hidden rigid motions out, shape (k, n).
        modal: the loop there.
        norms: largest norms of its blocks, M.
    """

    box: Box
    shown: Matrix
    modal: ModalCell
    norms: Matrix


@dataclass(frozen=True)
class CellCover:
    """Cells that are proved, and what ended the search: an unstable loop, or the time."""

    cells: tuple[Cell, ...]
    unstable: Vector | None = None
    is_open: bool = False

    @property
    def complete(self) -> bool:
        """Whether the whole box is proved."""
        return self.unstable is None and not self.is_open


class _Region(NamedTuple):
    """A part of the box with its own fit of A, without hidden motions."""

    box: Box
    shown: Matrix
    terms: Terms
    error: float


def cover_by_cells(
    dynamics: Callable[[Vector], Matrix], stable: Callable[[Vector], bool], box: Box, seconds: float
) -> CellCover:
    """Return cells that cover a box, or the loop or the time that ended the search.

    Args:
        dynamics: A at values of the parameters, shape (n, n).
        stable: whether the loop is, at values.
        box: of the parameters.
        seconds: that the search may take; it ends early where it would take longer.

    Raises:
        ValueError: if the size of A differs within the box.
    """
    m, start = len(box.centre), monotonic()
    whole = _region(dynamics, box)
    waiting, proved = [(whole, np.zeros(m), np.ones(m))], []
    while waiting:
        region, centre, radius = waiting.pop()
        here = Box(region.box.at(centre), region.box.radius * radius)
        if _hopeless(proved, box, start, seconds) or (here.radius < _LEAST * box.radius).any():
            return CellCover(tuple(proved), is_open=True)
        if not stable(here.centre):
            return CellCover(tuple(proved), unstable=here.centre)
        try:
            cell = modal_cell(region.terms, centre, radius, region.error)
        except np.linalg.LinAlgError:
            waiting += _halves(region, centre, radius, int(np.argmax(radius)))
            continue
        norms = cell.comparison(np.ones(m))
        if radius_of(norms) < 1.0:
            proved.append(Cell(here, region.shown, cell, norms))
        elif (radius < _REFIT).any() and _is_coarse(cell):
            waiting.append((_region(dynamics, here), np.zeros(m), np.ones(m)))
        else:
            waiting += _halves(region, centre, radius, _axis(cell, radius))
    return CellCover(tuple(proved))


def failed_check(
    dynamics: Callable[[Vector], Matrix], cells: Sequence[Cell], box: Box
) -> Vector | None:
    """Return values at which cells do not hold, or None: an independent check.

    The cells have the volume of the box, and random points and corners of it are in one. In each
    cell A itself, not its fit, has blocks within the norms, and these a positive vector d with
    M d < d, which bounds the spectral radius (Collatz and Wielandt).
    """
    rng, m = np.random.default_rng(5), len(box.centre)
    volume = _share(cells, box)
    low, high = (np.array([c.box.centre + side * c.box.radius for c in cells])
                 for side in (-1.0 - 1e-9, 1.0 + 1e-9))  # fmt: skip
    for delta in np.vstack((rng.uniform(-1.0, 1.0, (64, m)), 0.999 * corners(m)[:64])):
        values = box.at(delta)
        if abs(volume - 1.0) > 1e-6 or not ((low <= values) & (values <= high)).all(1).any():
            return values
    for cell in cells:
        size = len(cell.norms)
        weight = np.linalg.solve((1.0 + _FLOOR) * np.eye(size) - cell.norms, np.ones(size))
        if not ((weight > 0.0) & (cell.norms @ weight < weight)).all():
            return cell.box.centre
        for x in np.vstack((np.zeros((1, m)), rng.uniform(-1.0, 1.0, (_POINTS, m)))):
            values = cell.box.at(x)
            if (_norms_at(cell, dynamics(values), x) > cell.norms + _FLOOR).any():
                return values
    return None


def _share(cells: Sequence[Cell], box: Box) -> float:
    """Return the volume of cells, of that of the box."""
    return sum(float(np.prod(cell.box.radius / box.radius)) for cell in cells)


def _hopeless(cells: Sequence[Cell], box: Box, start: float, seconds: float) -> bool:
    """Return whether the rest of the box would take longer than the time that is left."""
    spent = monotonic() - start
    return spent > seconds or (
        spent > _JUDGED * seconds and _share(cells, box) < _JUDGED * spent / seconds
    )


def _norms_at(cell: Cell, a: Matrix, x: Vector) -> Matrix:
    """Return the norms of the blocks of A in a cell's coordinates at x."""
    t, blocks = cell.modal.coordinates(x), cell.modal.blocks
    seen = np.linalg.solve(t, cell.shown @ a @ cell.shown.T @ t)
    return np.array([[np.linalg.norm(seen[np.ix_(p, q)], 2) for q in blocks] for p in blocks])


def _halves(
    region: _Region, centre: Vector, radius: Vector, axis: int
) -> list[tuple[_Region, Vector, Vector]]:
    one = np.eye(len(centre))[axis] * radius
    return [(region, centre + side * one, radius - 0.5 * one) for side in (-0.5, 0.5)]


def _is_coarse(cell: ModalCell) -> bool:
    """Return whether the error of the fit takes a large part of the distance from the circle."""
    room = 1.0 - radius_of(cell.middle)
    return 1.0 - cell.bound(np.zeros(len(cell.turns))) < _COARSE * room


def _axis(cell: ModalCell, radius: Vector) -> int:
    """Return the parameter whose half leaves the least bound; where none does, the widest."""
    m = len(radius)
    bounds = [cell.bound(np.where(np.arange(m) == i, 0.5, 1.0)) for i in range(m)]
    return int(np.argmin(bounds)) if np.isfinite(min(bounds)) else int(np.argmax(radius))


def _region(dynamics: Callable[[Vector], Matrix], box: Box) -> _Region:
    """Return A over a box as a polynomial, without hidden rigid motions."""
    samples = checks(dynamics, box)
    fitted = polynomial_over(dynamics, box, samples, _FIT)
    error = _SAFETY * max(
        float(abs(fitted.at(d) - s).max())
        for d, s in zip(samples.delta, samples.values, strict=True)
    )
    terms = terms_of(fitted)
    shown = np.eye(terms.matrices.shape[1])
    for side in (False, True):
        shown = _without_hidden(shown, terms, side) @ shown
    return _Region(box, shown, Terms(terms.exponents, shown @ terms.matrices @ shown.T),
                   error * len(shown) ** 0.5)  # fmt: skip


def _without_hidden(shown: Matrix, terms: Terms, transposed: bool) -> Matrix:
    """Return rows that leave out motions on the circle which no parameter touches.

    Right: nothing reads them (A_a N = 0 for all a but the constant, and A_0 N in N). Transposed:
    nothing moves them.
    """
    parts = shown @ terms.matrices @ shown.T
    if transposed:
        parts = np.swapaxes(parts, 1, 2)
    constant = terms.exponents.sum(axis=1) == 0.0
    own, n = parts[constant][0], parts.shape[1]

    def on_circle(real: float, imaginary: float) -> bool:
        z = complex(real, imaginary)
        return abs(z) > 1.0 - _CIRCLE or abs(z - 1.0) < _ONE

    triangular, basis, kept = schur(own, sort=on_circle)
    if not kept:
        return np.eye(n)
    inside, motions = triangular[:kept, :kept], basis[:, :kept]
    acts = [part @ motions for part in parts[~constant]]
    power, seen = np.eye(kept), []
    for _ in range(kept):
        seen += [act @ power for act in acts]
        power = inside @ power
    stacked = np.vstack(seen)
    _, sizes, rows = np.linalg.svd(stacked, full_matrices=True)
    rank = int(np.count_nonzero(sizes > _HIDDEN * max(float(abs(parts).max()), 1.0)))
    hidden = motions @ rows[rank:].T
    return np.asarray(null_space(hidden.T).T) if hidden.shape[1] else np.eye(n)
