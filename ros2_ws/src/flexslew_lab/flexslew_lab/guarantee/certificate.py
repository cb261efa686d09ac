"""A certificate that a sampled loop is stable, or a gain bounded, for all parameters in a box.

Stability is first tried by cells of the box (see cell_cover), which lightly damped loops of a few
parameters need. Else, and for gains, the box is divided until each part has a stable centre and
scalings at every frequency. What holds then is checked again by other means: Phi of the undivided
state space at other frequencies, and the poles of the sampled loop itself at corners and random
points of every part.
"""

from dataclasses import dataclass, replace
from time import thread_time

import numpy as np

from flexslew_lab.guarantee.box import corners_and_inner
from flexslew_lab.guarantee.cells.cell_cover import (
    Cell,
    cover_by_cells,
    failed_check,
    share_of,
    uncovered,
)
from flexslew_lab.guarantee.cells.gain_cells import BoundedCell, bounded_cells, exceeding
from flexslew_lab.guarantee.deadline import OutOfTimeError, require_time
from flexslew_lab.guarantee.fit.dynamics_fit import system_fit
from flexslew_lab.guarantee.model.uncertain_loop import (
    GainLimit,
    UncertainLoop,
    channels_of,
    structure,
)
from flexslew_lab.guarantee.scalings.frequency_cover import Arc, LoopChannels, cover
from flexslew_lab.guarantee.scalings.multipliers import MOST_UNKNOWNS, Scalings
from flexslew_plant.arrays import Matrix, Vector

_HALF = 0.5
_MOST_PARTS = 64  # of the box
_ATTEMPTS = 4  # of the time that is left, for one part
_LIGHT, _RIGID = 0.01, 1e-9  # damping ratio; modulus of a pole that decays at once
_SLOW = 0.2  # of a pole's angle: a pole nearer to the circle is one of the first frequencies
_CELLS_PARAMETERS, _CELLS_SHARE = 3, 0.7  # most parameters, and share of the time, for cells
_PER_ARC, _POINTS, _MOST_CORNERS = 3, 8, 64
_CHECK_SECONDS = 5.0  # in addition, of what is proved by scalings


@dataclass(frozen=True)
class CertifiedPart:
    """The loop over a part of the box, with the arcs that cover its frequencies."""

    loop: UncertainLoop
    arcs: tuple[Arc, ...]


@dataclass(frozen=True)
class Certificate:
    """Outcome of an attempt.

    Args:
        parts: that are proved.
        unstable: values at which the loop is not stable, or None.
        open_at: angle of z without scalings in the last part [rad], or None.
        checked: points at which the independent check has agreed; 0: not checked.
        ended: what was reached where the time or the size has ended the search, else empty.
    """

    parts: tuple[CertifiedPart | Cell | BoundedCell, ...]
    unstable: Vector | None = None
    open_at: float | None = None
    checked: int = 0
    ended: str = ""

    @property
    def holds(self) -> bool:
        """Whether the whole box is proved, and checked."""
        is_open = self.unstable is not None or self.open_at is not None or bool(self.ended)
        return not is_open and self.checked > 0


def certify(
    loop: UncertainLoop, gain: GainLimit | None = None, seconds: float = 30.0
) -> Certificate:
    """Return a certificate of robust stability over the loop's box, and of a gain.

    Args:
        loop: over its box.
        gain: to be bounded, or None.
        seconds: of the processor for all of it; the certificate then names what is open.
    """
    end, by_cells = thread_time() + seconds, ""
    if len(loop.box.centre) <= _CELLS_PARAMETERS and (gain is None or _is_light(loop)):
        try:
            found = _certified_by_cells(loop, gain, _CELLS_SHARE * seconds, end)
        except OutOfTimeError:
            found = Certificate((), ended="the check of the cells")
        if found.holds or found.unstable is not None:
            return found
        by_cells = f"{found.ended}; "
    if thread_time() > end:
        return Certificate((), ended=f"{by_cells}no time for scalings")
    unknowns = structure(loop, gain).unknowns
    if unknowns > MOST_UNKNOWNS:
        size = f"{loop.states} states and {len(loop.box.centre)} parameters"
        words = f"{by_cells}{unknowns} scalings of {size} are too many (at most {MOST_UNKNOWNS})"
        return Certificate((), ended=words)
    return _certified_by_scalings(loop, gain, end)


def _certified_by_scalings(loop: UncertainLoop, gain: GainLimit | None, end: float) -> Certificate:
    waiting: list[tuple[UncertainLoop, list[float]]] = [(loop, [])]
    proved: list[CertifiedPart] = []
    while waiting:
        part, first = waiting.pop()
        if not part.stable(part.box.centre):
            return Certificate(tuple(proved), unstable=part.box.centre)
        channels, scalings = channels_of(part, gain), Scalings(structure(part, gain))
        share = thread_time() + (end - thread_time()) / _ATTEMPTS
        found = cover(channels, scalings, [*first, *_critical(channels.a)], share)
        if found.open_at is None:
            proved.append(CertifiedPart(part, found.arcs))
            continue
        if len(proved) + len(waiting) + 2 > _MOST_PARTS or thread_time() > end:
            words = f"{len(proved)} of {len(proved) + len(waiting) + 1} parts of the box are proved"
            return Certificate(tuple(proved), open_at=found.open_at, ended=words)
        axis = _axis(channels, scalings, found.open_at, part.form.sizes)
        waiting += [(half, [found.open_at]) for half in part.halves(axis)]
    try:
        return checked(tuple(proved), gain, end + _CHECK_SECONDS)
    except OutOfTimeError:
        return Certificate(tuple(proved), ended="the check of the parts")


def _is_light(loop: UncertainLoop) -> bool:
    """Return whether the damping is light at the centre: scalings then need too many arcs."""
    z = loop.fit.poles(np.zeros((1, len(loop.box.centre))))[0]
    s = np.log(z[abs(z) > _RIGID])
    return bool((-s.real < _LIGHT * abs(s)).any())


def _certified_by_cells(
    loop: UncertainLoop, gain: GainLimit | None, seconds: float, end: float
) -> Certificate:
    """Return a checked certificate by cells, an unstable loop, or how far the cells reach.

    Raises:
        OutOfTimeError: if the check is not done at the end.
    """
    if gain is not None:
        fit = system_fit(loop.exact, loop.box, loop.fit.shown)
        bounded = bounded_cells(fit, gain, seconds)
        if bounded is None or uncovered([cell.box for cell in bounded], loop.box) is not None:
            return Certificate((), ended="no cells have this bound")
        if exceeding(loop, gain, bounded, end) is not None:
            return Certificate((), ended="a check exceeds the bound")
        return _with_stable_points(loop, bounded, end)
    found = cover_by_cells(loop.dynamics, loop.stable, loop.fit, seconds)
    if found.unstable is not None:
        return Certificate(found.cells, unstable=found.unstable)
    if not found.complete:
        share = 100.0 * share_of([cell.box for cell in found.cells], loop.box)
        return Certificate((), ended=f"{len(found.cells)} cells reach {share:.2g} % of the box")
    if failed_check(loop.dynamics, found.cells, loop.box, end) is not None:
        return Certificate((), ended="a check refutes a cell")
    return _with_stable_points(loop, found.cells, end)


def _with_stable_points(
    loop: UncertainLoop, cells: tuple[Cell, ...] | tuple[BoundedCell, ...], end: float
) -> Certificate:
    """Return the certificate of cells after a check of the sampled loop at points of each.

    Raises:
        OutOfTimeError: if it is not done at the end.
    """
    rng, count = np.random.default_rng(3), 0
    for cell in cells:
        require_time(end)
        for delta in _check_points(len(loop.box.centre), len(cells), rng):
            if not loop.stable(cell.box.at(delta)):
                return Certificate(cells, unstable=cell.box.at(delta))
            count += 1
    return Certificate(cells, checked=count)


def _check_points(m: int, parts: int, rng: np.random.Generator) -> Matrix:
    """Return corners and random points of a part, normalised, fewer where there are many parts."""
    most = _MOST_CORNERS // parts + 2
    return corners_and_inner(m, most, min(_POINTS, most), rng) * (1.0 - 1e-6)


def checked(
    parts: tuple[CertifiedPart, ...], gain: GainLimit | None, end: float = np.inf
) -> Certificate:
    """Return the certificate of parts after the independent check; one that fails names where.

    Per part: Phi of all states at angles within each arc, that arcs leave no angle out, and the
    poles of the sampled loop at corners and random points.

    Raises:
        OutOfTimeError: if it is not done at the end, as time.thread_time counts [s].
    """
    certificate, rng, count = Certificate(parts), np.random.default_rng(3), 0
    for part in parts:
        require_time(end)
        loop, m = part.loop, len(part.loop.box.centre)
        whole = channels_of(loop, gain, reduced=False)
        reached = 0.0
        for arc in sorted(part.arcs, key=lambda a: a.low):
            if arc.low >= reached:
                return replace(certificate, open_at=reached)
            low, high = max(arc.low, 1e-6), min(arc.high, np.pi)
            for angle in low + (high - low) * rng.uniform(0.02, 0.98, _PER_ARC):
                if np.linalg.eigvalsh(arc.multiplier.phi(whole.at(angle)))[-1] >= 0.0:
                    return replace(certificate, open_at=float(angle))
                count += 1
            reached = max(reached, arc.high)
        if reached <= np.pi:
            return replace(certificate, open_at=reached)
        for delta in _check_points(m, len(parts), rng):
            values = loop.box.at(delta)
            if not loop.stable(values):
                return replace(certificate, unstable=values)
            count += 1
    return replace(certificate, checked=count)


def _critical(a: Matrix) -> list[float]:
    """Return the angles of the lightly damped poles, the nearest to the circle first [rad]."""
    z = np.linalg.eigvals(a)
    angle, distance = abs(np.angle(z)), 1.0 - abs(z)
    near = distance < _SLOW * angle
    return [float(w) for _, w in sorted(zip(distance[near], angle[near], strict=True))][::2]


def _axis(channels: LoopChannels, scalings: Scalings, angle: float, sizes: tuple[int, ...]) -> int:
    """Return the parameter to divide: the one whose half leaves mu least at the open angle.

    Measured by Osborne's bound of the balanced matrix, which needs no inequality.
    """
    m, first, best = channels.at(angle), 0, (np.inf, 0)
    for number, size in enumerate(sizes):
        gain = np.ones(m.shape[1])
        gain[first : first + size] = _HALF
        first += size
        left, right = scalings.balance(m * gain)
        bound = float(np.linalg.norm(left[:, None] * (m * gain) / right, 2))
        if size:
            best = min(best, (bound, number))
    return best[1]
