"""Bound of a gain over a box, cell by cell and arc by arc of the frequencies, see gain_cell.

An arc is divided until its bound is below the limit; a cell in which dividing does not help, is.
"""

from collections.abc import Sequence
from time import thread_time
from typing import NamedTuple

import numpy as np

from flexslew_lab.guarantee.box import Box, halves
from flexslew_lab.guarantee.cells.cell_cover import is_hopeless
from flexslew_lab.guarantee.cells.gain_cell import LOWEST, GainCell, gain_cell
from flexslew_lab.guarantee.deadline import require_time
from flexslew_lab.guarantee.fit.dynamics_fit import SystemFit
from flexslew_lab.guarantee.model.uncertain_loop import GainLimit, UncertainLoop
from flexslew_plant.arrays import Vector

_LEAST = 1e-5  # of the box: no smaller cell is tried


class BoundedCell(NamedTuple):
    """A cell whose gain is bounded."""

    box: Box
    cell: GainCell


def bounded_cells(
    fit: SystemFit, gain: GainLimit, seconds: float
) -> tuple[BoundedCell, ...] | None:
    """Return cells that cover a box, in which all loops are stable and keep the limit of a gain.

    Args:
        fit: of the system over the box.
        gain: with its limit.
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
            cell = gain_cell(fit, gain.complement, centre, radius)
            if cell.modal.bound(np.ones(m)) < 1.0:
                failed = cell.holds(gain.bound, start + seconds)
                if failed is None:
                    here = Box(fit.box.at(centre), fit.box.radius * radius)
                    done.append(BoundedCell(here, cell))
                    continue
                axis = _axis(cell, radius, failed)
            else:
                axis = _axis(cell, radius, None)
        except np.linalg.LinAlgError:
            pass  # the eigenvectors at the centre are dependent: those of its halves need not be
        waiting += halves(centre, radius, axis)
    return tuple(done)


def exceeding(
    loop: UncertainLoop, gain: GainLimit, cells: Sequence[BoundedCell], end: float = np.inf
) -> Vector | None:
    """Return values at which the system itself exceeds a limit, or None: an independent check.

    At the centre and random points of each cell, at the angles of its poles and random ones.

    Raises:
        OutOfTimeError: if it is not done at the end, as time.thread_time counts [s].
    """
    rng = np.random.default_rng(8)
    for cell in cells:
        require_time(end)
        for x in np.vstack((0.0 * cell.box.centre, rng.uniform(-1.0, 1.0, cell.box.centre.shape))):
            system = loop.response(cell.box.at(x), gain)
            angles = abs(np.angle(np.linalg.eigvals(system.a)))
            angles = np.append(angles[angles > LOWEST], rng.uniform(0.0, np.pi, 8))
            if np.linalg.norm(system.at(angles), 2, axis=(1, 2)).max() > gain.bound:
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
