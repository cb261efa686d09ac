"""The limit that a bounded drive sets: the convex optimum over the duration, and the least time."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flexslew_control.planners.minimax.linear_path import is_linear
from flexslew_control.planners.minimax.members import Ensemble, members_of
from flexslew_control.planners.minimax.program import Limits
from flexslew_control.planners.minimax.question import Question, convex_program
from flexslew_control.planners.minimax.rounds import Goal, solved
from flexslew_control.planners.minimax.shortest import least_duration
from flexslew_control.planners.slew import Slew
from flexslew_control.planners.trajectories import rigid_duration
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import PlanFailed

_PIECES = 60  # of each effort
_LEVELS = 7  # of the stiffness: fewer members make a lower bound
_POINTS = 6  # of the curve
_GOAL = Goal(close=0.03, iterations=8)  # any round's bound is one


class LimitCurve(NamedTuple):
    """What no efforts on 60 pieces can pass below, for a linear plant."""

    duration: Vector  # (points,) [s]
    residual: Vector  # lower bounds of the worst tip deflection, (points,) [m]
    least_time: float | None  # to rest, modes included, on the nominal plant [s]; None: unknown


def limit_curve(slew: Slew, spread: tuple[float, float], max_duration: float) -> LimitCurve | None:
    """Return the convex optimum over the duration; None: the plant is not linear.

    Args:
        slew: the requested slew, with the feedback that flies it.
        spread: lowest and highest relative error of the stiffness [-].
        max_duration: duration at which the curve ends [s].
    """
    if slew.static or not slew.model.modes or not is_linear(slew.model):
        return None
    free = np.full(slew.goal.size, np.inf)
    limits = Limits(slew.effort_limit, np.array([-free, free]), free, np.inf)
    rigid = rigid_duration(slew.model, slew.start, slew.goal, slew.effort_limit)
    ensemble = Ensemble(
        vary={"stiffness": (min(spread[0], 0.0), max(spread[1], 0.0))}, count=_LEVELS
    )
    question = Question(slew, ensemble, rigid, _PIECES, limits, False, 0.0, 1)
    nominal = replace(question, ensemble=Ensemble(vary={}), exact=True)
    least = least_duration(nominal)
    duration = np.linspace(rigid, max(max_duration, rigid), _POINTS + 1)[1:]
    found = [_bound(replace(question, duration=float(t))) for t in duration]
    known = np.isfinite(found) & (np.array(found) > 0.0)
    return LimitCurve(duration[known], np.array(found)[known], least)


def _bound(question: Question) -> float:
    """Return a lower bound of the worst residual [m]; infinite: there is no slew."""
    program = convex_program(question, members_of(question.ensemble, question.slew))
    try:
        return solved(program, goal=_GOAL).bound
    except PlanFailed:
        return np.inf
