"""The fastest reorientation near some efforts: successive linear programs.

About the present flight the end conditions r are linear in the efforts' shares s and the duration:
    min T + dT + mu |r + (dr/ds) ds + (dr/dT) dT|_1,    |s + ds| <= 1,    |ds| <= radius.
Limits of the path g <= 0 are linearised at the ends of the pieces, their excess at the same price.
The step is taken if the true merit T + mu (|r|_1 + |max(g, 0)|_1) falls, and the radius grows or
shrinks by how well the program predicted the gain. Where it predicted it badly, the program is
solved again about what the step really missed, a correction of second order (Nocedal and Wright,
chapters 15 and 18). Its solutions are vertices, so the efforts become those of arcs at their
limits.
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import linprog

from flexslew_control.planners.time_optimal.three_axes.reorientation import Arcs, Reorientation
from flexslew_plant.arrays import Matrix, Vector

_PRICE = 10.0  # mu, of the first duration
_FIRST_RADIUS, _LARGEST_RADIUS, _SMALLEST_RADIUS = 0.5, 2.0, 1e-5  # of the amplitude
_OF_DURATION = 0.3  # by which share it may change at radius one [-]
_GOOD, _LOW_RATIO = 0.7, 0.2  # shares of the predicted gain
_FIRST_ARC_RADIUS, _ARC_STEPS = 0.1, 20  # radius of the arcs' programs [-], and how many at most
_MIN_ARC = 1e-5  # arcs that are no longer, of the duration
_ATTEMPTS = 2  # programs for each step that is taken, at most
_END_TOLERANCE = 1e-5  # end conditions of a slew at a fixed duration, scaled
_CONVERGED = 1e-7  # predicted gain, of the duration
_SOLVER_OPTIONS: Any = {"presolve": False}  # it takes longer than it saves: all rows are full


class LocalOptimum(NamedTuple):
    """A local optimum."""

    duration: float  # [s]
    shares: Matrix  # of the amplitude, (pieces, joints)
    missed: float  # largest end condition or excess, of Reorientation.scale [-]


class _Trial(NamedTuple):
    """A flight alone, scaled."""

    duration: float
    shares: Matrix
    missed: Vector  # (conditions,)
    excess: Vector  # beyond the limits of the path: at all ends of pieces, or where it has slopes

    def merit(self, price: float) -> float:
        """Return T + mu (|r|_1 + |max(g, 0)|_1)."""
        violation = np.abs(self.missed).sum() + np.maximum(self.excess, 0.0).sum()
        merit = self.duration + price * float(violation)
        return merit if np.isfinite(merit) else np.inf


class _LinearizedFlight(NamedTuple):
    """A flight and its slopes, scaled."""

    flight: _Trial
    by_share: Matrix  # (conditions, pieces joints)
    by_duration: Vector  # (conditions,)
    excess_by_share: Matrix  # (rows, pieces joints)
    excess_by_duration: Vector  # (rows,)

    def about(self, trial: _Trial) -> "_LinearizedFlight":
        """Return the same slopes, about what a trial has really missed: of second order."""
        change = (trial.shares - self.flight.shares).ravel()
        duration_change = trial.duration - self.flight.duration
        error = trial.missed - self.by_share @ change - self.by_duration * duration_change
        return self._replace(flight=self.flight._replace(missed=error))


def local_minimum_time(
    slew: Reorientation, shares: Matrix, duration: float, steps: int, fixed_duration: bool = False
) -> LocalOptimum:
    """Return the fastest slew near some efforts.

    Args:
        slew: what is turned.
        shares: of the amplitude, over equal pieces, shape (pieces, joints).
        duration: to start from [s].
        steps: that are taken, at most.
        fixed_duration: whether it keeps its duration, and is sought until it nearly meets its end.
    """
    price, radius = _PRICE * duration, _LARGEST_RADIUS if fixed_duration else _FIRST_RADIUS
    duration_share = 0.0 if fixed_duration else _OF_DURATION
    here = _linearize_flight(slew, shares, duration)
    for _ in range(_ATTEMPTS * steps):
        step = _step(here, price, radius, duration_share)
        if step is None:
            break
        predicted = here.flight.merit(price) - step[2]
        candidate = _evaluate(slew, step[0], step[1])
        gain = here.flight.merit(price) - candidate.merit(price)
        if gain < _GOOD * predicted:
            second = _step(here.about(candidate), price, radius, duration_share)
            other = candidate if second is None else _evaluate(slew, second[0], second[1])
            if other.merit(price) < candidate.merit(price):
                candidate, gain = other, here.flight.merit(price) - other.merit(price)
        if gain > 0.0:
            steps -= 1
            here = _linearize_flight(slew, candidate.shares, candidate.duration)
        if gain > _GOOD * predicted:
            radius = min(2.0 * radius, _LARGEST_RADIUS)
        elif gain < _LOW_RATIO * predicted:
            radius *= 0.5 if gain > 0.0 else 0.3
        if fixed_duration and np.abs(here.flight.missed).max() < _END_TOLERANCE:
            break
        if predicted < _CONVERGED * here.flight.duration or radius < _SMALLEST_RADIUS or not steps:
            break
    found = here.flight
    error = max(float(np.abs(found.missed).max()), float(found.excess.max(initial=0.0)))
    return LocalOptimum(found.duration, found.shares, error)


def refine_durations(slew: Reorientation, signs: Matrix, guess: Vector) -> tuple[Matrix, Vector]:
    """Return the arcs that are left of some, and their durations: programs by the durations.

    Arcs that a program takes away altogether are left out.

    Args:
        slew: what is turned.
        signs: of the efforts of the arcs, shape (arcs, joints).
        guess: their durations, shape (arcs,) [s].
    """
    whole, d, radius = float(guess.sum()), guess, _FIRST_ARC_RADIUS
    price = _PRICE * whole
    end = Arcs(slew, signs).residual_jacobian(d)
    merit = float(d.sum() + price * np.abs(end[0] / slew.scale).sum())
    for _ in range(_ARC_STEPS):
        error, slopes = end[0] / slew.scale, end[1] / slew.scale[:, None]
        r, count = error.size, d.size
        cost = np.concatenate((np.ones(count), np.full(2 * r, price)))
        rows = np.hstack((slopes, -np.eye(r), np.eye(r)))
        low = np.maximum(-d, -radius * whole)
        bounds: Any = np.vstack(
            (
                np.column_stack((low, np.full(count, radius * whole))),
                np.tile([0.0, np.inf], (2 * r, 1)),
            )
        )
        found = linprog(cost, A_eq=rows, b_eq=-error, bounds=bounds, method="highs-ds")
        if found.x is None or found.fun is None:
            break
        candidate = d + found.x[:count]
        new = Arcs(slew, signs).residual_jacobian(candidate)
        other = float(candidate.sum() + price * np.abs(new[0] / slew.scale).sum())
        predicted = merit - float(d.sum()) - float(found.fun)
        if merit - other < _LOW_RATIO * predicted:
            radius *= 0.3
        if other < merit:
            d, end, merit = candidate, new, other
        if predicted < _CONVERGED * whole or radius < _SMALLEST_RADIUS:
            break
    return _merged(signs, d, _MIN_ARC * whole)


def _merged(signs: Matrix, durations: Vector, min_duration: float) -> tuple[Matrix, Vector]:
    """Return the arcs of at least `min_duration` [s], equal neighbours as one."""
    kept, lengths = list[Vector](), list[float]()
    for sign, d in zip(
        signs[durations > min_duration], durations[durations > min_duration], strict=True
    ):
        if kept and (kept[-1] == sign).all():
            lengths[-1] += float(d)
        else:
            kept.append(sign)
            lengths.append(float(d))
    return np.array(kept), np.array(lengths)


def _evaluate(slew: Reorientation, shares: Matrix, duration: float) -> _Trial:
    states = slew.states(shares * slew.amplitude, duration)
    error = slew.rest_error(states[-1:])[0] / slew.scale
    return _Trial(duration, shares, error, slew.limit_excess(states[1:]).ravel())


def _linearize_flight(slew: Reorientation, shares: Matrix, duration: float) -> _LinearizedFlight:
    pieces = len(shares)
    end = slew.ended(shares * slew.amplitude, np.full(pieces, duration / pieces))
    scale = slew.scale
    by_share = end.by_effort * slew.amplitude / scale[:, None, None]
    return _LinearizedFlight(
        _Trial(duration, shares, end.missed / scale, end.along.excess),
        by_share.reshape(scale.size, -1),
        end.by_duration.mean(axis=1) / scale,
        (end.along.by_effort * slew.amplitude).reshape(end.along.excess.size, shares.size),
        end.along.by_duration.mean(axis=1),
    )


def _step(
    here: _LinearizedFlight, price: float, radius: float, duration_share: float
) -> tuple[Matrix, float, float] | None:
    """Return shares, duration and predicted merit of the program's solution; None: it has none."""
    duration, shares, error, excess = here.flight
    r, count, now = error.size, shares.size, shares.ravel()
    low, high = np.maximum(-1.0, now - radius), np.minimum(1.0, now + radius)
    duration_change = duration_share * min(radius, 1.0) * duration
    low, high = np.append(low, -duration_change), np.append(high, duration_change)
    limited = np.column_stack((here.excess_by_share, here.excess_by_duration))
    most = here.excess_by_share @ now - excess
    # a limit that nothing inside these bounds reaches is left out
    near = np.maximum(limited * low, limited * high).sum(axis=1) > most
    limited, most, g = limited[near], most[near], int(near.sum())
    cost = np.concatenate((np.zeros(count), [1.0], np.full(2 * r + g, price)))
    ends = np.column_stack((here.by_share, here.by_duration))
    rows = np.hstack((ends, -np.eye(r), np.eye(r), np.zeros((r, g))))
    below = np.hstack((limited, np.zeros((g, 2 * r)), -np.eye(g)))
    bounds: Any = np.vstack((np.column_stack((low, high)), np.tile([0.0, np.inf], (2 * r + g, 1))))
    right = here.by_share @ now - error
    if not np.isfinite(np.column_stack((ends, right))).all():  # it tumbles beyond any number
        return None
    found = linprog(
        cost, below, most, rows, right, bounds, method="highs-ds", options=_SOLVER_OPTIONS
    )
    if found.x is None or found.fun is None:
        return None
    changed = float(found.x[count])
    return found.x[:count].reshape(shares.shape), duration + changed, duration + float(found.fun)
