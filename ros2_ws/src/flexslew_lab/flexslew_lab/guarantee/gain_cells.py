"""Bound of a gain over a box, cell by cell and arc by arc of the frequencies, see gain_cell.

An arc is divided until its bound is below the limit; a cell in which dividing does not help, is.
"""

from collections.abc import Callable, Sequence
from time import thread_time
from typing import NamedTuple

import numpy as np

from flexslew_lab.guarantee.box import Box
from flexslew_lab.guarantee.cell_cover import is_hopeless
from flexslew_lab.guarantee.deadline import require_time
from flexslew_lab.guarantee.frequency_cover import LoopChannels
from flexslew_lab.guarantee.gain_cell import LOWEST, GainCell, gain_cell
from flexslew_lab.guarantee.system_fit import SystemFit
from flexslew_plant.arrays import Matrix, Vector

_LEAST = 1e-5  # of the box: no smaller cell is tried


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
    end: float = np.inf,
) -> Vector | None:
    """Return values at which the system itself exceeds a limit, or None: an independent check.

    At the centre and random points of each cell, at the angles of its poles and random ones.

    Raises:
        OutOfTimeError: if it is not done at the end, as time.thread_time counts [s].
    """
    rng, n = np.random.default_rng(8), states
    for cell in cells:
        require_time(end)
        for x in np.vstack((0.0 * cell.box.centre, rng.uniform(-1.0, 1.0, cell.box.centre.shape))):
            s = exact(cell.box.at(x))
            angles = abs(np.angle(np.linalg.eigvals(s[:n, :n])))
            angles = np.append(angles[angles > LOWEST], rng.uniform(0.0, np.pi, 8))
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
