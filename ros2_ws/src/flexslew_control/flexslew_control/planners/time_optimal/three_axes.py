"""The fastest reorientation in three axes, by all drives at once: faster than the eigenaxis.

About the eigenaxis only the drives that push along it work, and those across it hold. Where all
push at their limits, a sphere that turns by 180 deg takes 3.2431 instead of 3.5449 (Bilimoria and
Wie 1993). From several starts successive programs find the efforts' arcs, and Newton's method on
the conditions of Karush, Kuhn and Tucker makes those of a rigid craft exact. A flexible craft
starts from the rigid one's efforts, and ends with its modes at rest. Where that slew looks into a
cone of `keep_out` or is faster than the rate limit, the programs go round it, on pieces.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.plan import Plan
from flexslew_control.planners.eigenaxis import continuous
from flexslew_control.planners.progress import Progress, Update
from flexslew_control.planners.slew import Slew, tick_times
from flexslew_control.planners.time_optimal.all_drives import structure_of
from flexslew_control.planners.time_optimal.optimal_switching import (
    nearest_durations,
    shortest_durations,
)
from flexslew_control.planners.time_optimal.path_limits import PathLimits
from flexslew_control.planners.time_optimal.reorientation import Arcs, Reorientation
from flexslew_control.planners.time_optimal.sequential_programs import (
    LocalArcs,
    fastest_near,
    settled_arcs,
)
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.testbeds.spacecraft.sky import HasSky

_PIECES, _FLEXIBLE_PIECES = 60, 120
_STARTS, _SEED = 6, 1
_STEPS, _FLEXIBLE_STEPS = 40, 40  # of the programs
_ASIDE = 0.7  # how far starts are from the eigenaxis, of the amplitude
_LEVELS = 6  # of their efforts
_SAME = 1e-4  # relative difference of durations of one slew
_SETTLED_AT_MOST, _MOST_ARCS = 2, 14  # slews whose arcs are made exact, and of how many
_MET = 1e-6  # share of the end conditions that may be missed
_CHECKED = 240  # pieces on which Pontryagin's condition is looked at
_ALLOWED = 1e-4  # wrong-signed part of a switching function
_ROUNDS = 6  # of the efforts on ticks
_CLOSE = 1e-10  # of the end conditions
_SPARE = (0, 1, 2, 5)  # ticks after the end that may be needed to come to rest on ticks
_WIDER, _WIDENINGS = 1e-3, 4  # spare of the path's limits [rad, -], and how often it may grow


class Fastest(NamedTuple):
    """The fastest slew that was found."""

    efforts: Matrix  # of its pieces, (pieces, joints) [N m]
    durations: Vector  # of the pieces [s]
    exact: bool  # whether these are arcs that Newton's method has settled
    violation: float  # wrong-signed part of the switching functions; NaN: not looked at
    found: int  # starts that led to a slew


def plan_three_axes(
    settings: Any, asked: Slew, amplitude: Vector, rigid: Any, progress: Progress
) -> Plan:
    """Return the fastest slew from one attitude to another.

    Args:
        settings: the `plan` section.
        asked: the slew, of a model whose joints tell an attitude.
        amplitude: of the efforts, shape (joints,) [N m].
        rigid: the testbed without modes.
        progress: called after every start, with the least duration so far for its objective.

    Raises:
        BadInput: nothing turns, or a joint does not turn the craft.
        PlanFailed: no start leads to a slew, it takes longer than allowed, or none keeps out of the
            cones.
    """
    slew = Reorientation(asked.model, asked.start, asked.goal, amplitude)
    for name, axis in zip(asked.model.joint_names, slew.attitude.axes, strict=True):
        if not axis.any():
            words = f"{name} does not turn the platform; take moving, about the eigenaxis"
            raise BadInput(words, "plan", "drives", "all")
    if not np.linalg.norm(slew.turn) > 0.0:
        raise BadInput("plan: goal: the craft is there already; give another goal")
    sky = rigid.sky() if isinstance(rigid, HasSky) else None
    limits = PathLimits(() if sky is None else sky.cones, settings.rate_limit)
    if limits.names:
        _require_free_ends(limits, slew)
    stiff = slew if not asked.model.modes else Reorientation(rigid.model(), *_ends(slew))
    best = fastest_rigid(stiff, progress)
    rigid_duration = float(best.durations.sum())
    if asked.model.modes:
        best = fastest_flexible(slew, best)
        rigid_duration = min(rigid_duration, _rigid_near(stiff, best))
    states, effort = _on_ticks(slew, best, settings.start, asked.period)
    limited = limits.names and (limits.excess(slew.model, states) > 0.0).any()
    if limited:
        on_ticks = partial(_on_ticks, slew, start=settings.start, period=asked.period)
        best, states, effort = _within(limits, slew, stiff, on_ticks, progress)
    duration = float(best.durations.sum())
    if settings.longest is not None and duration > settings.longest:
        raise PlanFailed(
            f"the slew takes {duration:.4f} s, {settings.longest:g} s allowed; a rigid craft takes "
            f"{rigid_duration:.4f} s; use a higher effort_limit"
        )
    position, velocity = _read(slew, states)
    summary: dict[str, Any] = {
        "duration": duration,
        "switch_times": np.cumsum(best.durations)[:-1].tolist() if best.exact else [],
        "switches": best.durations.size - 1 if best.exact else None,
        "amplitude": amplitude.tolist(),
        "peak_effort": abs(effort).max(axis=0).tolist(),
        "terminal_error": slew.missed(states[-1]).tolist(),
        "rigid_duration": rigid_duration,
        "later_than_rigid": duration - rigid_duration,
        "path_limits": [*limits.names] if limited else [],
        "eigenaxis_duration": stiff.duration,
        "optimal": bool(best.violation <= _ALLOWED),
        "switching_function_violation": best.violation,
        "optimality": _statement(best),
        "predicted_residual_tip_deflection": _ringing(slew, states[-1]),
    }
    return Plan(
        method=settings.method,
        joint_names=asked.model.joint_names,
        start=settings.start,
        period=asked.period,
        position=position,
        velocity=velocity,
        effort=effort,
        state=np.zeros((len(position), 0)),
        duration=duration,
        summary=summary,
    )


def fastest_rigid(slew: Reorientation, progress: Progress) -> Fastest:
    """Return the fastest slew of a craft without modes, from several starts.

    Raises:
        PlanFailed: none leads to one.
    """
    found = _from_starts(slew, progress)
    near = [one for one in found if one.duration < (1.0 + _SAME) * found[0].duration]
    for local in near[:_SETTLED_AT_MOST]:
        exact = _exact(slew, local)
        if exact is not None:
            efforts = exact[0] * slew.amplitude
            wrong = _violation(slew, efforts, exact[1])
            return Fastest(efforts, exact[1], True, wrong, len(found))
    return _transcribed(slew, found[0], len(found))


def _from_starts(slew: Reorientation, progress: Progress) -> list[LocalArcs]:
    """Return the slews that starts beside the eigenaxis lead to, the fastest first.

    Raises:
        PlanFailed: none leads to one.
    """
    rng, found = np.random.default_rng(_SEED), list[LocalArcs]()
    half = np.where(np.arange(_PIECES) < _PIECES // 2, 1.0, -1.0)
    for k in range(_STARTS):
        levels = rng.uniform(-1.0, 1.0, (_LEVELS, slew.amplitude.size))
        aside = _ASIDE * np.repeat(levels, _PIECES // _LEVELS, axis=0)
        shares = np.clip(np.outer(half, slew.shares) + aside, -1.0, 1.0)
        local = fastest_near(slew, shares, slew.duration, _STEPS)
        if local.missed < _MET:
            found.append(local)
        least = min((one.duration for one in found), default=np.inf)
        progress(Update(k + 1, least, np.nan, np.nan, np.nan, True))
    if not found:
        raise PlanFailed(f"none of {_STARTS} starts led to a slew; use another goal or limits")
    return sorted(found, key=lambda one: one.duration)


def _require_free_ends(limits: PathLimits, slew: Reorientation) -> None:
    ends = limits.excess(slew.model, np.array([slew.start, slew.rest]))
    for name, (first, last) in zip(limits.names, ends.T, strict=True):
        if max(first, last) > 0.0:
            where = "start" if first > 0.0 else "goal"
            raise PlanFailed(f"the {where} looks into {name}, by {max(first, last):.3g} rad")


def _within(
    limits: PathLimits,
    slew: Reorientation,
    stiff: Reorientation,
    on_ticks: Callable[[Fastest], tuple[Matrix, Matrix]],
    progress: Progress,
) -> tuple[Fastest, Matrix, Matrix]:
    """Return the fastest slew that keeps to the limits at all ticks, and its states and efforts.

    The programs look at the ends of the pieces; what lies beyond between them is spared there.

    Raises:
        PlanFailed: no slew does.
    """
    spare, local = _WIDER, None
    for _ in range(_WIDENINGS):
        held = replace(limits, spare=spare)
        body = replace(stiff, limits=held)
        if local is None:
            found = _from_starts(body, progress)
            local = LocalArcs(found[0].duration, np.repeat(found[0].shares, 2, axis=0), np.inf)
        local = fastest_near(body, local.shares, local.duration, _STEPS)
        best = _transcribed(body, local, len(found))
        if slew.model.modes:
            best = fastest_flexible(replace(slew, limits=held), best)
        states, effort = on_ticks(best)
        beyond = float(limits.excess(slew.model, states).max())
        if beyond <= 0.0:
            return best, states, effort
        spare += 2.0 * beyond
    names = ", ".join(limits.names)
    raise PlanFailed(f"no slew keeps to {names}: {beyond:.2g} beyond is left; change the goal")


def _exact(slew: Reorientation, local: LocalArcs) -> tuple[Matrix, Vector] | None:
    """Return signs and durations of the exact arcs of a local optimum; None: they do not settle.

    Two switches that are close may come in the other order than on the pieces.
    """
    signs, guess = settled_arcs(slew, *structure_of(local.duration, local.shares))
    if not 2 < len(signs) <= _MOST_ARCS:
        return None
    durations = shortest_durations(Arcs(slew, signs), guess)
    if durations is not None:
        return signs, durations
    k = 1 + int(np.argmin(guess[1:-1]))
    other = signs.copy()
    other[k] = signs[k - 1] + signs[k + 1] - signs[k]
    if (abs(other[k]) == 1.0).all():
        other, again = settled_arcs(slew, other, guess)
        durations = shortest_durations(Arcs(slew, other), again)
        if durations is not None:
            return other, durations
    durations = nearest_durations(Arcs(slew, signs), guess)
    return None if durations is None else (signs, durations)


def fastest_flexible(slew: Reorientation, rigid: Fastest) -> Fastest:
    """Return the fastest slew of a craft with modes, near that of the rigid one.

    Raises:
        PlanFailed: the modes are not brought to rest.
    """
    longer = float(rigid.durations.sum())
    knots = np.concatenate(([0.0], np.cumsum(rigid.durations)))
    ends = np.linspace(0.0, longer, _FLEXIBLE_PIECES + 1)
    shares = _means(rigid.efforts, knots, ends) / slew.amplitude
    local = fastest_near(slew, shares, longer, _FLEXIBLE_STEPS)
    if local.missed > 1e3 * _MET:
        raise PlanFailed(
            f"no fast slew that ends with the modes at rest was found near the rigid craft's "
            f"({longer:.4f} s): {local.missed:.2g} of them is left; take drives: moving, about the "
            "eigenaxis"
        )
    return _transcribed(slew, local, rigid.found)


def _rigid_near(stiff: Reorientation, flexible: Fastest) -> float:
    """Return what the rigid craft takes near a flexible one's slew [s]; infinite: none.

    The flexible craft's programs go on from the rigid one's slew, and may leave its optimum.
    """
    duration = float(flexible.durations.sum())
    local = fastest_near(stiff, flexible.efforts / stiff.amplitude, duration, _STEPS)
    return local.duration if local.missed < _MET else np.inf


def _transcribed(slew: Reorientation, local: LocalArcs, found: int) -> Fastest:
    """Return a local optimum on equal pieces as it is."""
    pieces = len(local.shares)
    durations = np.full(pieces, local.duration / pieces)
    return Fastest(local.shares * slew.amplitude, durations, False, np.nan, found)


def _ends(slew: Reorientation) -> tuple[Vector, Vector, Vector]:
    return slew.first, slew.last, slew.amplitude


def _violation(slew: Reorientation, efforts: Matrix, durations: Vector) -> float:
    """Return the largest wrong-signed part of the switching functions, of their largest value.

    With (dr/dd)^T mu = 1 for all arcs, a change of the effort of a piece by du lets the duration
    change by -mu^T (dr/du) du: Pontryagin's condition asks mu^T dr/du for the sign of the effort.
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


def _means(efforts: Matrix, knots: Vector, ends: Vector) -> Matrix:
    """Return the mean efforts between some times of efforts held between knots."""
    held = np.vstack((np.zeros(efforts.shape[1]), np.cumsum(efforts * np.diff(knots)[:, None], 0)))
    gained = np.column_stack([np.interp(ends, knots, column) for column in held.T])
    return np.asarray(np.diff(gained, axis=0) / np.diff(ends)[:, None])


def _on_ticks(
    slew: Reorientation, best: Fastest, start: float, period: float
) -> tuple[Matrix, Matrix]:
    """Return states at the ticks and efforts held over them that end at rest at the goal.

    The means over the ticks miss it by a little, of second order in the period. The smallest change
    that ends there is weighed by the room below the amplitude, see held_efforts.
    """
    knots = np.concatenate(([0.0], np.cumsum(best.durations)))
    ticks = tick_times(start, float(knots[-1]), period)
    means = _means(best.efforts, knots, ticks)
    least, chosen = np.inf, (np.zeros((0, 0)), means)
    for spare in _SPARE:
        effort = np.vstack((means, np.zeros((spare, means.shape[1]))))
        held = np.full(len(effort), period)
        for _ in range(_ROUNDS):
            end = slew.ended(effort, held)
            missed = float(abs(end.missed / slew.scale).max())
            if missed < least:
                least, chosen = missed, (end.states, effort)
            if missed < _CLOSE:
                return chosen
            slopes = (end.by_effort / slew.scale[:, None, None]).reshape(len(end.missed), -1)
            room = np.maximum(slew.amplitude - abs(effort), 0.0).ravel() ** 2
            weighed = slopes * room
            lost = -end.missed / slew.scale
            change = weighed.T @ np.linalg.lstsq(weighed @ slopes.T, lost, rcond=1e-12)[0]
            effort = np.clip(effort + change.reshape(effort.shape), -slew.amplitude, slew.amplitude)
    return chosen


def _read(slew: Reorientation, states: Matrix) -> tuple[Matrix, Matrix]:
    """Return positions and rates of the joints at the ticks, without jumps of a whole turn."""
    rows = [slew.model.joint_state(x) for x in states]
    turn = slew.attitude.turn_of(np.array([position for position, _ in rows]))
    turn[0] = slew.attitude.turn_of(slew.first)
    position = continuous(turn) @ slew.attitude.axes.T
    position[0] = slew.first
    velocity = np.array([rate for _, rate in rows])
    velocity[-1] = 0.0
    return position, velocity


def _ringing(slew: Reorientation, x: Vector) -> float:
    """Return the amplitude of the tips in a state, the platform held [m]."""
    model = slew.model
    if not model.modes:
        return 0.0
    linear = model.linearise(x[: model.positions])
    n = model.before_modes
    modes, rates = model.modal_state(x)
    slow = np.sqrt(np.diag(linear.mass)[n:] / np.diag(linear.stiffness)[n:])
    swing = np.hypot(modes, slow * rates)
    return float((abs(model.appendages.tip) @ swing).max(initial=0.0))


def _statement(best: Fastest) -> str:
    """Return in one sentence what is known of the slew's optimality."""
    of = f"the best of {best.found} starts"
    if not best.exact:
        return f"{of} on {best.durations.size} pieces, a local optimum"
    switches = best.durations.size - 1
    if best.violation <= _ALLOWED:
        return f"{of}, extremal with {switches} switches: Pontryagin's condition holds"
    return (
        f"{of} with {switches} switches; a switching function has the wrong sign by "
        f"{100.0 * best.violation:.2g} % of its largest value"
    )
