"""A certificate that a sampled loop is stable, or a gain bounded, for all parameters in a box.

Stability is first tried by cells of the box (see cell_cover), which lightly damped loops of a few
parameters need. Else, and for gains, the box is divided until each part has a stable centre and
scalings at every frequency. What holds then is checked again by other means: Phi of the undivided
state space at other frequencies, and the poles of the sampled loop itself at corners and random
points of every part.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from time import thread_time
from typing import NamedTuple

import numpy as np
from scipy.linalg import schur, solve_sylvester

from flexslew_lab.guarantee.box import Box, corners
from flexslew_lab.guarantee.cell_cover import Cell, cover_by_cells, failed_check, uncovered
from flexslew_lab.guarantee.dynamics_fit import DynamicsFit, dynamics_fit
from flexslew_lab.guarantee.fractional import Fractional, fractional_over
from flexslew_lab.guarantee.frequency_cover import Arc, LoopChannels, cover
from flexslew_lab.guarantee.gain_cells import (
    BoundedCell,
    bounded_cells,
    exceeding,
    system_fit,
)
from flexslew_lab.guarantee.scalings import DeltaBlocks, Scalings
from flexslew_plant.arrays import Matrix, Vector

_HALF = 0.5
_ATTEMPTS = 4  # of the time that is left, for one part
_LIGHT = 0.01  # damping ratio
_RIGID = 1e-9  # distance from the unit circle of a pole that the loop does not show
_SLOW = 0.2  # of a pole's angle: a pole nearer to the circle is one of the first frequencies
_CELLS_PARAMETERS, _CELLS_SHARE = 3, 0.8  # most parameters, and share of the time, for cells
_PER_ARC, _POINTS, _MOST_CORNERS = 3, 8, 64


class GainLimit(NamedTuple):
    """A gain to be bounded: of the system from its inputs to its outputs.

    Args:
        bound: largest singular value allowed [-].
        complement: whether it is of one minus the system, as S of -T.
    """

    bound: float
    complement: bool = False


@dataclass(frozen=True)
class UncertainLoop:
    """The closed sampled loop as a linear fractional form over a box.

    Args:
        box: of the parameters.
        form: of S = [[A, B], [C, D]], balanced.
        states: number of states.
        exact: S at values, from the equations.
        stable: whether the loop is, at values.
    """

    box: Box
    form: Fractional
    states: int
    exact: Callable[[Vector], Matrix]
    stable: Callable[[Vector], bool]

    def dynamics(self, values: Vector) -> Matrix:
        """Return A at values of the parameters, shape (states, states)."""
        return self.exact(values)[: self.states, : self.states]

    @cached_property
    def fit(self) -> DynamicsFit:
        """A over the box, without hidden motions."""
        return dynamics_fit(self.dynamics, self.box)

    def halves(self, axis: int) -> "list[UncertainLoop]":
        """Return the loop over both halves of its box, fitted again, across a parameter."""
        out = []
        for side in (-0.5, 0.5):
            centre, radius = self.box.centre.copy(), self.box.radius.copy()
            centre[axis] += side * radius[axis]
            radius[axis] *= 0.5
            out.append(uncertain_loop(Box(centre, radius), self.states, self.exact, self.stable))
        return out


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
    """

    parts: tuple[CertifiedPart | Cell | BoundedCell, ...]
    unstable: Vector | None = None
    open_at: float | None = None
    checked: int = 0

    @property
    def holds(self) -> bool:
        """Whether the whole box is proved, and checked."""
        return self.unstable is None and self.open_at is None and self.checked > 0


def uncertain_loop(
    box: Box, states: int, exact: Callable[[Vector], Matrix], stable: Callable[[Vector], bool]
) -> UncertainLoop:
    """Return the linear fractional form of a loop over a box.

    Args:
        box: of the parameters.
        states: number of states.
        exact: [[A, B], [C, D]] at values, shape (states + outputs, states + inputs).
        stable: whether the loop is, at values.

    Raises:
        BadInput: see fractional_over.
    """
    return UncertainLoop(box, fractional_over(exact, box), states, exact, stable)


def certify(
    loop: UncertainLoop, gain: GainLimit | None = None, parts: int = 64, seconds: float = 30.0
) -> Certificate:
    """Return a certificate of robust stability over the loop's box, and of a gain.

    Args:
        loop: over its box.
        gain: to be bounded, or None.
        parts: largest number of parts of the box.
        seconds: after which no part is divided any more; the certificate then names what is open.
    """
    end = thread_time() + seconds
    if len(loop.box.centre) <= _CELLS_PARAMETERS and (gain is None or _is_light(loop)):
        by_cells = _certified_by_cells(loop, gain, _CELLS_SHARE * seconds)
        if by_cells is not None:
            return by_cells
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
        if len(proved) + len(waiting) + 2 > parts or thread_time() > end:
            return Certificate(tuple(proved), open_at=found.open_at)
        axis = _axis(channels, scalings, found.open_at, part.form.sizes)
        waiting += [(half, [found.open_at]) for half in part.halves(axis)]
    return checked(tuple(proved), gain)


def _is_light(loop: UncertainLoop) -> bool:
    """Return whether the damping is light at the centre: scalings then need too many arcs."""
    z = loop.fit.poles(np.zeros((1, len(loop.box.centre))))[0]
    s = np.log(z[abs(z) > _RIGID])
    return bool((-s.real < _LIGHT * abs(s)).any())


def _certified_by_cells(
    loop: UncertainLoop, gain: GainLimit | None, seconds: float
) -> Certificate | None:
    """Return a checked certificate by cells, an unstable loop, or None: neither."""
    if gain is not None:
        fit, n = system_fit(loop.exact, loop.box, loop.fit.shown), loop.states
        cells = bounded_cells(fit, gain.complement, gain.bound, seconds)
        if cells is None or uncovered([cell.box for cell in cells], loop.box) is not None:
            return None
        if exceeding(loop.exact, n, gain.complement, gain.bound, cells) is not None:
            return None
        return _with_stable_points(loop, cells)
    found = cover_by_cells(loop.dynamics, loop.stable, loop.fit, seconds)
    if found.unstable is not None:
        return Certificate(found.cells, unstable=found.unstable)
    if not found.complete or failed_check(loop.dynamics, found.cells, loop.box) is not None:
        return None
    return _with_stable_points(loop, found.cells)


def _with_stable_points(
    loop: UncertainLoop, cells: tuple[Cell, ...] | tuple[BoundedCell, ...]
) -> Certificate:
    """Return the certificate of cells after a check of the sampled loop at points of each."""
    rng, count = np.random.default_rng(3), 0
    for cell in cells:
        for delta in _check_points(len(loop.box.centre), len(cells), rng):
            if not loop.stable(cell.box.at(delta)):
                return Certificate(cells, unstable=cell.box.at(delta))
            count += 1
    return Certificate(cells, checked=count)


def _check_points(m: int, parts: int, rng: np.random.Generator) -> Matrix:
    """Return corners and random points of a part, normalised, fewer where there are many parts."""
    outer = corners(m)
    most = _MOST_CORNERS // parts + 2
    if len(outer) > most:
        outer = outer[rng.choice(len(outer), most, replace=False)]
    inner = rng.uniform(-1.0, 1.0, (min(_POINTS, most), m))
    return np.vstack((outer, inner)) * (1.0 - 1e-6)


def checked(parts: tuple[CertifiedPart, ...], gain: GainLimit | None) -> Certificate:
    """Return the certificate of parts after the independent check; one that fails names where.

    Per part: Phi of all states at angles within each arc, that arcs leave no angle out, and the
    poles of the sampled loop at corners and random points.
    """
    certificate, rng, count = Certificate(parts), np.random.default_rng(3), 0
    for part in parts:
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


def channels_of(
    loop: UncertainLoop, gain: GainLimit | None = None, reduced: bool = True
) -> LoopChannels:
    """Return the loop from w to v over its box, the gain's channels last.

    Args:
        loop: over its box.
        gain: whose channels are a further full block, or None.
        reduced: whether rigid motions that no channel shows are left out.
    """
    form, n = loop.form, loop.states
    s = form.constant
    b, c, d = form.left[:n], form.right[:, :n], form.inner
    if gain is not None:
        direct = s[n:, n:]
        if gain.complement:
            direct = np.eye(len(direct)) + direct
        b = np.hstack((b, s[:n, n:]))
        c = np.vstack((c, s[n:, :n] / gain.bound))
        d = np.block([[d, form.right[:, n:]],
                      [form.left[n:] / gain.bound, direct / gain.bound]])  # fmt: skip
    if not reduced:
        return LoopChannels(s[:n, :n], b, c, d)
    return _reduced(LoopChannels(s[:n, :n], b, c, d))


def _reduced(whole: LoopChannels) -> LoopChannels:
    """Return the channels without poles on the circle, rigid motions that the loop does not show.

    A real Schur form puts them last, and Sylvester's equation separates them.
    """
    a, basis, kept = schur(whole.a, sort=_decays)
    if kept == len(a):
        return whole
    coupling = solve_sylvester(a[:kept, :kept], -a[kept:, kept:], -a[:kept, kept:])
    b, c = basis.T @ whole.b, whole.c @ basis
    return LoopChannels(a[:kept, :kept], b[:kept] - coupling @ b[kept:], c[:, :kept], whole.d)


def _decays(real: float, imaginary: float = 0.0) -> bool:
    return abs(complex(real, imaginary)) < 1.0 - _RIGID


def structure(loop: UncertainLoop, gain: GainLimit | None = None) -> DeltaBlocks:
    """Return the blocks of the loop, and of a gain."""
    form = loop.form
    full = (form.error,) if any(form.error) else ()
    if gain is not None:
        rows, columns = form.constant.shape
        full = (*full, (columns - loop.states, rows - loop.states))
    return DeltaBlocks(form.sizes, full)


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
