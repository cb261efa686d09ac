"""The fastest turns by all drives: several starts for a rigid craft, one from there for modes.

Successive programs find the efforts' arcs, and Newton's method on the conditions of Karush, Kuhn
and Tucker makes those of a rigid craft exact. A flexible craft starts from the rigid one's efforts,
and ends with its modes at rest.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexslew_control.planners.progress import Progress, Update
from flexslew_control.planners.time_optimal.all_drives import structure_of
from flexslew_control.planners.time_optimal.optimal_switching import minimum_durations
from flexslew_control.planners.time_optimal.three_axes.reorientation import Arcs, Reorientation
from flexslew_control.planners.time_optimal.three_axes.sequential_programs import (
    LocalOptimum,
    local_minimum_time,
    refine_durations,
)
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import PlanFailed

PIECES, _FLEXIBLE_PIECES = 60, 120
_STARTS, _SEED = 6, 1
STEPS = 40  # of the programs
_START_OFFSET = 0.7  # how far starts are from the eigenaxis, of the amplitude
_LEVELS = 6  # of their efforts
_MOST_ARCS = 14  # of a slew with arcs made exact
_TOLERANCE = 1e-6  # share of the end conditions that may be missed
# the same with modes, which ticks then bring to rest
_REST_TOLERANCE, _FIXED_REST_TOLERANCE = 1e3 * _TOLERANCE, 1e-4
_FIRST_RATIO, _STEP_RATIO, _MAX_RATIO = 1.02, 2.5, 1.5  # durations that are tried, of the rigid's
_LEAST = 1e-3  # relative width at which the least duration is known
_FIXED_STEPS = 12  # of programs for a duration
_CHECKED = 240  # pieces on which Pontryagin's condition is looked at


class MinimumTimeSlew(NamedTuple):
    """The fastest slew that was found."""

    efforts: Matrix  # of its pieces, (pieces, joints) [N m]
    durations: Vector  # of the pieces [s]
    exact: bool  # whether these are arcs that Newton's method has settled
    violation: float  # wrong-signed part of the switching functions; NaN: not looked at
    found: int  # starts that led to a slew


def minimum_time_rigid(slew: Reorientation, progress: Progress) -> MinimumTimeSlew:
    """Return the fastest slew of a craft without modes, from several starts.

    Raises:
        PlanFailed: none leads to one.
    """
    found = from_starts(slew, progress)
    exact = _exact(slew, found[0])
    if exact is None:
        return equal_pieces_slew(slew, found[0], len(found))
    efforts = exact[0] * slew.amplitude
    wrong = _violation(slew, efforts, exact[1])
    return MinimumTimeSlew(efforts, exact[1], True, wrong, len(found))


class Start(NamedTuple):
    """Efforts to start from."""

    shares: Matrix  # of the amplitude, over equal pieces, (PIECES, joints)
    duration: float  # [s]


def from_starts(
    slew: Reorientation, progress: Progress, more: Sequence[Start] = ()
) -> list[LocalOptimum]:
    """Return the slews that starts off the eigenaxis lead to, the fastest first.

    Args:
        slew: the slew.
        progress: called after every start.
        more: starts that come first.

    Raises:
        PlanFailed: if none leads to one.
    """
    rng, found, starts = np.random.default_rng(_SEED), list[LocalOptimum](), [*more]
    # where drives far stronger than others make it tumble, as far aside as each has a share
    sizes = (np.ones_like(slew.shares), np.abs(slew.shares))
    attempts = 0
    for size in sizes:
        starts += [_random_start(slew, rng, size) for _ in range(_STARTS)]
        for start in starts[attempts:]:
            local = local_minimum_time(slew, *start, STEPS)
            if local.missed < _TOLERANCE:
                found.append(local)
            attempts += 1
            least = min((one.duration for one in found), default=np.inf)
            progress(Update(attempts, least, np.nan, np.nan, np.nan, True))
        if found:
            return sorted(found, key=lambda one: one.duration)
    raise PlanFailed(f"none of {attempts} starts led to a slew; use another goal or limits")


def _random_start(slew: Reorientation, rng: np.random.Generator, size: Vector) -> Start:
    """Return random efforts near those of the eigenaxis, each by at most a share of its size."""
    half = np.where(np.arange(PIECES) < PIECES // 2, 1.0, -1.0)
    levels = rng.uniform(-1.0, 1.0, (_LEVELS, slew.amplitude.size))
    offset = _START_OFFSET * size * np.repeat(levels, PIECES // _LEVELS, axis=0)
    return Start(np.clip(np.outer(half, slew.shares) + offset, -1.0, 1.0), slew.duration)


def _exact(slew: Reorientation, local: LocalOptimum) -> tuple[Matrix, Vector] | None:
    """Return signs and durations of the exact arcs of a local optimum; None: they do not settle.

    Two switches that are close may come in the other order than on the pieces.
    """
    signs, guess = refine_durations(slew, *structure_of(local.duration, local.shares))
    if not 2 < len(signs) <= _MOST_ARCS:
        return None
    durations = minimum_durations(Arcs(slew, signs), guess)
    if durations is not None:
        return signs, durations
    k = 1 + int(np.argmin(guess[1:-1]))
    other = signs.copy()
    other[k] = signs[k - 1] + signs[k + 1] - signs[k]
    if (abs(other[k]) == 1.0).all():
        other, other_guess = refine_durations(slew, other, guess)
        durations = minimum_durations(Arcs(slew, other), other_guess)
        if durations is not None:
            return other, durations
    return None


def minimum_time_with_modes(slew: Reorientation, rigid: MinimumTimeSlew) -> MinimumTimeSlew:
    """Return the fastest slew of a craft with modes, near that of the rigid one.

    Raises:
        PlanFailed: the modes are not brought to rest.
    """
    duration = float(rigid.durations.sum())
    knots = np.concatenate(([0.0], np.cumsum(rigid.durations)))
    ends = np.linspace(0.0, duration, _FLEXIBLE_PIECES + 1)
    shares = means(rigid.efforts, knots, ends) / slew.amplitude
    local = local_minimum_time(slew, shares, duration, STEPS)
    if local.missed > _REST_TOLERANCE:
        extended = _extend_duration(slew, shares, duration)
        if extended is None:
            raise PlanFailed(
                f"no fast slew that ends with the modes at rest was found near the rigid craft's "
                f"({duration:.4f} s), nor one of up to {_MAX_RATIO:g} times that; take drives: "
                "moving, about the eigenaxis"
            )
        local = extended
    return equal_pieces_slew(slew, local, rigid.found)


def _extend_duration(slew: Reorientation, shares: Matrix, duration: float) -> LocalOptimum | None:
    """Return a slew of the least duration for which one is found; None: of none.

    Where the duration may change, the phases of fast modes bind it to steps of some 0.1 ms, and the
    programs end before it is long enough. With a duration that is held, modes are all but linear
    in the efforts: the least one is bracketed, then halved.
    """
    low, high, best = 1.0, _FIRST_RATIO, None
    while best is None:
        if high > _MAX_RATIO:
            return None
        found = local_minimum_time(
            slew, shares / high**2, high * duration, _FIXED_STEPS, fixed_duration=True
        )
        if found.missed < _FIXED_REST_TOLERANCE:
            best = found
        else:
            low, high = high, 1.0 + _STEP_RATIO * (high - 1.0)
    while high - low > _LEAST * high:
        middle = 0.5 * (low + high)
        found = local_minimum_time(
            slew, best.shares, middle * duration, _FIXED_STEPS, fixed_duration=True
        )
        if found.missed < _FIXED_REST_TOLERANCE:
            high, best = middle, found
        else:
            low = middle
    refined = local_minimum_time(slew, best.shares, best.duration, STEPS)
    return refined if refined.missed < best.missed else best


def rigid_near(rigid_slew: Reorientation, flexible: MinimumTimeSlew) -> float:
    """Return what the rigid craft takes near a flexible one's slew [s]; infinite: none.

    The flexible craft's programs go on from the rigid one's slew, and may leave its optimum.
    """
    duration = float(flexible.durations.sum())
    local = local_minimum_time(rigid_slew, flexible.efforts / rigid_slew.amplitude, duration, STEPS)
    return local.duration if local.missed < _TOLERANCE else np.inf


def equal_pieces_slew(slew: Reorientation, local: LocalOptimum, found: int) -> MinimumTimeSlew:
    """Return a local optimum on equal pieces as it is."""
    pieces = len(local.shares)
    durations = np.full(pieces, local.duration / pieces)
    return MinimumTimeSlew(local.shares * slew.amplitude, durations, False, np.nan, found)


def _violation(slew: Reorientation, efforts: Matrix, durations: Vector) -> float:
    """Return the largest wrong-signed part of the switching functions, of their largest value.

    With (dr/dd)^T mu = 1 for all arcs, a change of the effort of a piece by du changes the
    duration by -mu^T (dr/du) du: Pontryagin's condition requires mu^T dr/du with the sign of the
    effort.
    """
    each = np.maximum(1, np.round(_CHECKED * durations / durations.sum()).astype(int))
    fine = slew.ended(np.repeat(efforts, each, axis=0), np.repeat(durations / each, each))
    edges = np.concatenate(([0], np.cumsum(each)))
    by_arc = np.add.reduceat(fine.by_duration, edges[:-1], axis=1) / each
    mu = np.linalg.lstsq(by_arc.T, np.ones(len(durations)), rcond=None)[0]
    sigma = np.einsum("r,rkj->kj", mu, fine.by_effort)
    sigma /= np.repeat(durations / each, each)[:, None] * abs(sigma).max(axis=0)
    sigma /= abs(sigma).max(axis=0)
    signed = sigma * np.sign(np.repeat(efforts, each, axis=0))
    return float(max(0.0, -signed.min()))


def means(efforts: Matrix, knots: Vector, ends: Vector) -> Matrix:
    """Return the mean efforts between some times of efforts held between knots."""
    impulse = np.vstack(
        (np.zeros(efforts.shape[1]), np.cumsum(efforts * np.diff(knots)[:, None], 0))
    )
    integral = np.column_stack([np.interp(ends, knots, column) for column in impulse.T])
    return np.asarray(np.diff(integral, axis=0) / np.diff(ends)[:, None])
