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
_GOOD, _POOR = 0.7, 0.2  # shares of the predicted gain
_FIRST_ARCS, _ARC_STEPS = 0.1, 20  # radius of the arcs' programs [-], and how many at most
_GONE = 1e-5  # arcs that are no longer, of the duration
_TRIED = 2  # programs for each step that is taken, at most
_NEARLY = 1e-5  # end conditions of a slew at a fixed duration, scaled
_SETTLED = 1e-7  # predicted gain, of the duration
_PROGRAM: Any = {"presolve": False}  # it takes longer than it saves: all rows are full


class LocalArcs(NamedTuple):
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
        beyond = np.abs(self.missed).sum() + np.maximum(self.excess, 0.0).sum()
        merit = self.duration + price * float(beyond)
        return merit if np.isfinite(merit) else np.inf


class _About(NamedTuple):
    """A flight and its slopes, scaled."""

    flight: _Trial
    by_share: Matrix  # (conditions, pieces joints)
    by_duration: Vector  # (conditions,)
    excess_by_share: Matrix  # (rows, pieces joints)
    excess_by_duration: Vector  # (rows,)

    def about(self, trial: _Trial) -> "_About":
        """Return the same slopes, about what a trial has really missed: of second order."""
        moved = (trial.shares - self.flight.shares).ravel()
        longer = trial.duration - self.flight.duration
        missed = trial.missed - self.by_share @ moved - self.by_duration * longer
        return self._replace(flight=self.flight._replace(missed=missed))


def fastest_near(
    slew: Reorientation, shares: Matrix, duration: float, steps: int, held: bool = False
) -> LocalArcs:
    """Return the fastest slew near some efforts.

    Args:
        slew: what is turned.
        shares: of the amplitude, over equal pieces, shape (pieces, joints).
        duration: to start from [s].
        steps: that are taken, at most.
        held: whether it keeps its duration, and is sought until it nearly meets its end.
    """
    price, radius = _PRICE * duration, _LARGEST_RADIUS if held else _FIRST_RADIUS
    stretch = 0.0 if held else _OF_DURATION
    here = _linearise_about(slew, shares, duration)
    for _ in range(_TRIED * steps):
        step = _step(here, price, radius, stretch)
        if step is None:
            break
        predicted = here.flight.merit(price) - step[2]
        there = _evaluate(slew, step[0], step[1])
        gain = here.flight.merit(price) - there.merit(price)
        if gain < _GOOD * predicted:
            again = _step(here.about(there), price, radius, stretch)
            other = there if again is None else _evaluate(slew, again[0], again[1])
            if other.merit(price) < there.merit(price):
                there, gain = other, here.flight.merit(price) - other.merit(price)
        if gain > 0.0:
            steps -= 1
            here = _linearise_about(slew, there.shares, there.duration)
        if gain > _GOOD * predicted:
            radius = min(2.0 * radius, _LARGEST_RADIUS)
        elif gain < _POOR * predicted:
            radius *= 0.5 if gain > 0.0 else 0.3
        if held and np.abs(here.flight.missed).max() < _NEARLY:
            break
        if predicted < _SETTLED * here.flight.duration or radius < _SMALLEST_RADIUS or not steps:
            break
    found = here.flight
    missed = max(float(np.abs(found.missed).max()), float(found.excess.max(initial=0.0)))
    return LocalArcs(found.duration, found.shares, missed)


def settled_arcs(slew: Reorientation, signs: Matrix, guess: Vector) -> tuple[Matrix, Vector]:
    """Return the arcs that are left of some, and their durations: programs by the durations.

    Arcs that a program takes away altogether are left out.

    Args:
        slew: what is turned.
        signs: of the efforts of the arcs, shape (arcs, joints).
        guess: their durations, shape (arcs,) [s].
    """
    whole, d, radius = float(guess.sum()), guess, _FIRST_ARCS
    price = _PRICE * whole
    end = Arcs(slew, signs).linearised(d)
    merit = float(d.sum() + price * np.abs(end[0] / slew.scale).sum())
    for _ in range(_ARC_STEPS):
        missed, slopes = end[0] / slew.scale, end[1] / slew.scale[:, None]
        r, arcs = missed.size, d.size
        cost = np.concatenate((np.ones(arcs), np.full(2 * r, price)))
        rows = np.hstack((slopes, -np.eye(r), np.eye(r)))
        low = np.maximum(-d, -radius * whole)
        bounds: Any = np.vstack(
            (
                np.column_stack((low, np.full(arcs, radius * whole))),
                np.tile([0.0, np.inf], (2 * r, 1)),
            )
        )
        found = linprog(cost, A_eq=rows, b_eq=-missed, bounds=bounds, method="highs-ds")
        if found.x is None or found.fun is None:
            break
        there = d + found.x[:arcs]
        new = Arcs(slew, signs).linearised(there)
        other = float(there.sum() + price * np.abs(new[0] / slew.scale).sum())
        predicted = merit - float(d.sum()) - float(found.fun)
        if merit - other < _POOR * predicted:
            radius *= 0.3
        if other < merit:
            d, end, merit = there, new, other
        if predicted < _SETTLED * whole or radius < _SMALLEST_RADIUS:
            break
    return _merged(signs, d, _GONE * whole)


def _merged(signs: Matrix, durations: Vector, gone: float) -> tuple[Matrix, Vector]:
    """Return arcs without those that are shorter than `gone` [s], equal neighbours as one."""
    kept, lasting = list[Vector](), list[float]()
    for sign, d in zip(signs[durations > gone], durations[durations > gone], strict=True):
        if kept and (kept[-1] == sign).all():
            lasting[-1] += float(d)
        else:
            kept.append(sign)
            lasting.append(float(d))
    return np.array(kept), np.array(lasting)


def _evaluate(slew: Reorientation, shares: Matrix, duration: float) -> _Trial:
    states = slew.states(shares * slew.amplitude, duration)
    missed = slew.missed(states[-1:])[0] / slew.scale
    return _Trial(duration, shares, missed, slew.beyond(states[1:]).ravel())


def _linearise_about(slew: Reorientation, shares: Matrix, duration: float) -> _About:
    pieces = len(shares)
    end = slew.ended(shares * slew.amplitude, np.full(pieces, duration / pieces))
    scale = slew.scale
    by_share = end.by_effort * slew.amplitude / scale[:, None, None]
    return _About(
        _Trial(duration, shares, end.missed / scale, end.along.excess),
        by_share.reshape(scale.size, -1),
        end.by_duration.mean(axis=1) / scale,
        (end.along.by_effort * slew.amplitude).reshape(end.along.excess.size, shares.size),
        end.along.by_duration.mean(axis=1),
    )


def _step(
    here: _About, price: float, radius: float, stretch: float
) -> tuple[Matrix, float, float] | None:
    """Return shares, duration and predicted merit of the program's solution; None: it has none."""
    duration, shares, missed, excess = here.flight
    r, count, now = missed.size, shares.size, shares.ravel()
    low, high = np.maximum(-1.0, now - radius), np.minimum(1.0, now + radius)
    longer = stretch * min(radius, 1.0) * duration
    low, high = np.append(low, -longer), np.append(high, longer)
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
    right = here.by_share @ now - missed
    if not np.isfinite(np.column_stack((ends, right))).all():  # it tumbles beyond any number
        return None
    found = linprog(cost, below, most, rows, right, bounds, method="highs-ds", options=_PROGRAM)
    if found.x is None or found.fun is None:
        return None
    changed = float(found.x[count])
    return found.x[:count].reshape(shares.shape), duration + changed, duration + float(found.fun)
