"""Stability over a box, cell by cell: what lightly damped loops of a few parameters need.

Each cell has a bound of the spectral radius below one, see modal_cell. A cell without one is
divided across the parameter whose half leaves the least bound.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import thread_time
from typing import NamedTuple

import numpy as np

from flexslew_lab.guarantee.box import Box, corners, halves
from flexslew_lab.guarantee.cells.modal_cell import ModalCell, modal_cell, radius_of
from flexslew_lab.guarantee.deadline import require_time
from flexslew_lab.guarantee.fit.dynamics_fit import DynamicsFit, dynamics_fit
from flexslew_plant.arrays import Matrix, Vector

_FLOOR = 1e-14  # of a norm that is checked
_REFIT, _COARSE = 0.6, 0.7  # of a region's size; of the room that a fit has to leave
_LEAST = 1e-6  # of the box: no smaller cell is tried
_JUDGED = 0.1  # of the time: then a search goes on if it has done a tenth of that share
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


def cover_by_cells(
    dynamics: Callable[[Vector], Matrix],
    stable: Callable[[Vector], bool],
    whole: DynamicsFit,
    seconds: float,
) -> CellCover:
    """Return cells that cover a box, or the loop or the time that ended the search.

    Args:
        dynamics: A at values of the parameters, shape (n, n).
        stable: whether the loop is, at values.
        whole: the fit of A over the box.
        seconds: that the search may take; it ends early where it would take longer.

    Raises:
        BadInput: if the size of A differs within the box.
    """
    box, m, start = whole.box, len(whole.box.centre), thread_time()
    waiting = [(whole, np.zeros(m), np.ones(m))]
    proved: list[Cell] = []
    while waiting:
        region, centre, radius = waiting.pop()
        here = Box(region.box.at(centre), region.box.radius * radius)
        if (
            is_hopeless([c.box for c in proved], box, start, seconds)
            or (here.radius < _LEAST * box.radius).any()
        ):
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
            waiting.append((dynamics_fit(dynamics, here), np.zeros(m), np.ones(m)))
        else:
            waiting += _halves(region, centre, radius, _axis(cell, radius))
    return CellCover(tuple(proved))


def failed_check(
    dynamics: Callable[[Vector], Matrix], cells: Sequence[Cell], box: Box, end: float = np.inf
) -> Vector | None:
    """Return values at which cells do not hold, or None: an independent check.

    The cells have the volume of the box, and random points and corners of it are in one. In each
    cell A itself, not its fit, has blocks within the norms, and these a positive vector d with
    M d < d, which bounds the spectral radius (Collatz and Wielandt).

    Raises:
        OutOfTimeError: if it is not done at the end, as time.thread_time counts [s].
    """
    missing = uncovered([cell.box for cell in cells], box)
    if missing is not None:
        return missing
    rng, m = np.random.default_rng(5), len(box.centre)
    for cell in cells:
        require_time(end)
        size = len(cell.norms)
        weight = np.linalg.solve((1.0 + _FLOOR) * np.eye(size) - cell.norms, np.ones(size))
        if not ((weight > 0.0) & (cell.norms @ weight < weight)).all():
            return cell.box.centre
        for x in np.vstack((np.zeros((1, m)), rng.uniform(-1.0, 1.0, (_POINTS, m)))):
            values = cell.box.at(x)
            if (_norms_at(cell, dynamics(values), x) > cell.norms + _FLOOR).any():
                return values
    return None


def uncovered(cells: Sequence[Box], box: Box) -> Vector | None:
    """Return values of a box that no cell contains, None if their volume is that of the box."""
    rng, m = np.random.default_rng(6), len(box.centre)
    low, high = (np.array([c.centre + side * c.radius for c in cells])
                 for side in (-1.0 - 1e-9, 1.0 + 1e-9))  # fmt: skip
    for delta in np.vstack((rng.uniform(-1.0, 1.0, (64, m)), 0.999 * corners(m)[:64])):
        values = box.at(delta)
        if not ((low <= values) & (values <= high)).all(axis=1).any():
            return values
    return None if abs(share_of(cells, box) - 1.0) < 1e-6 else box.centre


def share_of(cells: Sequence[Box], box: Box) -> float:
    """Return the volume of cells, of that of the box."""
    return sum(float(np.prod(cell.radius / box.radius)) for cell in cells)


def is_hopeless(cells: Sequence[Box], box: Box, start: float, seconds: float) -> bool:
    """Return whether the rest of the box would take longer than the time that is left.

    Args:
        cells: that are done.
        box: all of it.
        start: of the search, as time.thread_time counts [s].
        seconds: that it may take.
    """
    spent = thread_time() - start
    return spent > seconds or (
        spent > _JUDGED * seconds and share_of(cells, box) < _JUDGED * spent / seconds
    )


def _norms_at(cell: Cell, a: Matrix, x: Vector) -> Matrix:
    """Return the norms of the blocks of A in a cell's coordinates at x."""
    t, blocks = cell.modal.coordinates(x), cell.modal.blocks
    seen = np.linalg.solve(t, cell.shown @ a @ cell.shown.T @ t)
    return np.array([[np.linalg.norm(seen[np.ix_(p, q)], 2) for q in blocks] for p in blocks])


def _halves(
    region: DynamicsFit, centre: Vector, radius: Vector, axis: int
) -> list[tuple[DynamicsFit, Vector, Vector]]:
    return [(region, *half) for half in halves(centre, radius, axis)]


def _is_coarse(cell: ModalCell) -> bool:
    """Return whether the error of the fit takes a large part of the distance from the circle."""
    room = 1.0 - radius_of(cell.middle)
    return 1.0 - cell.bound(np.zeros(len(cell.turns))) < _COARSE * room


def _axis(cell: ModalCell, radius: Vector) -> int:
    """Return the parameter whose half leaves the least bound; where none does, the widest."""
    m = len(radius)
    bounds = [cell.bound(np.where(np.arange(m) == i, 0.5, 1.0)) for i in range(m)]
    return int(np.argmin(bounds)) if np.isfinite(min(bounds)) else int(np.argmax(radius))
