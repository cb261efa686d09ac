"""The shortest slew: the least duration with an optimum within a bound, or a feasible one."""

from dataclasses import replace

import numpy as np

from flexslew_control.planners.minimax.linear_path import is_linear
from flexslew_control.planners.minimax.members import Member, members_of
from flexslew_control.planners.minimax.optimum import Found, found_optimum
from flexslew_control.planners.minimax.question import Question, convex_program
from flexslew_control.planners.minimax.rounds import Goal, solved
from flexslew_control.planners.progress import Progress, ignore
from flexslew_control.planners.trajectories import rounded_up
from flexslew_plant.errors import PlanFailed

_CLOSE = 5e-4  # of the duration, to which the shortest is found [-]
_COARSE = 0.03  # the same of the least that is feasible on a plant that is not linear [-]
_TIMES = 3  # that a duration is lengthened by half before the bound counts as out of reach
_STEPS = 12  # at least, of a search for what the limits allow
_ATTEMPTS, _ATTEMPT_RATIO = 6, 1.05  # durations from the least on, and from one to the next
_MAX_ITERATIONS = 12  # times that a duration is doubled before none counts as enough


def minimum_time(question: Question, bound: float, progress: Progress) -> Found:
    """Return the shortest slew with a worst residual within a bound.

    Args:
        question: the problem; its duration is the longest that is allowed.
        bound: largest worst residual [m].
        progress: called with every program that is solved.

    Raises:
        PlanFailed: if the longest slew that is allowed does not meet the bound.
    """
    period = question.slew.period
    high = int(np.ceil(question.duration / period - 1e-9))
    best = _bounded_optimum(question, high, bound, progress)
    if best is None:
        raise PlanFailed(_no_duration(question, bound, progress))
    low = min(int(question.too_short / period), high - 1)
    return _bisect(question, low, best, bound, progress)


def least_duration(question: Question) -> float | None:
    """Return the least duration in which the limits let efforts lead to the goal [s]; None: none.

    Args:
        question: what is sought; its duration is too short.
    """
    members = members_of(question.ensemble, question.slew)
    linear = all(is_linear(member.model) for member in members)
    period, close = question.slew.period, _CLOSE if linear else _COARSE
    low = int(question.duration / period)
    if not linear:  # a search for what cannot be is long
        low = max(low, int(question.too_short / period))
    high = max(2 * low, int(np.ceil(question.rigid / period)), 2)
    for _ in range(_MAX_ITERATIONS):
        if _feasible(question, members, high, linear):
            break
        low, high = high, 2 * high
    else:
        return None
    while high - low > max(1, int(close * high)):
        middle = (low + high) // 2
        feasible = _feasible(question, members, middle, linear)
        low, high = (low, middle) if feasible else (middle, high)
    return high * period


def suggest_duration(question: Question) -> str:
    """Return in words a duration that leads to a plan, as tried."""
    least = least_duration(question)
    if least is None:
        longest = 2**_MAX_ITERATIONS * question.duration
        return f"no duration up to {longest:.4g} s is enough; widen a limit"
    duration = rounded_up(least)
    for _ in range(_ATTEMPTS):
        try:
            found_optimum(replace(question, duration=duration), ignore)
        except PlanFailed:  # of a search that ends after max_steps
            duration = rounded_up(_ATTEMPT_RATIO * duration)
            continue
        return (
            f"a duration of {duration:g} s (now {question.duration:g} s) is enough; a rigid "
            f"body takes {question.rigid:.4g} s"
        )
    return (
        f"the limits allow a duration of {rounded_up(least):g} s (now {question.duration:g} s), "
        f"but max_steps: {question.steps} are too few to find its efforts; take more"
    )


def _bisect(question: Question, low: int, best: Found, bound: float, progress: Progress) -> Found:
    """Return the shortest optimum within a bound, between too few ticks and one that is within."""
    high = int(np.ceil(best.duration / question.slew.period - 1e-9))
    while high - low > max(1, int(_CLOSE * high)):
        middle = (low + high) // 2
        found = _bounded_optimum(question, middle, bound, progress)
        if found is None:
            low = middle
        else:
            high, best = middle, found
    return best


def _bounded_optimum(
    question: Question, ticks: int, bound: float, progress: Progress
) -> Found | None:
    """Return the optimum in so many ticks; None: it leaves more than the bound."""
    problem = replace(question, duration=ticks * question.slew.period)
    try:
        found = found_optimum(problem, progress, bound)
    except PlanFailed:
        return None
    return found if found.optimum.worst <= bound else None


def _no_duration(question: Question, bound: float, progress: Progress) -> str:
    """Return in words which duration meets the bound, or which bound the longest one meets."""
    ticks = int(np.ceil(question.duration / question.slew.period - 1e-9))
    words = f"no slew of {question.duration:g} s leaves {bound:g} m or less on every member"
    for _ in range(_TIMES):
        low, ticks = ticks, ticks * 3 // 2
        found = _bounded_optimum(question, ticks, bound, progress)
        if found is not None:
            found = _bisect(question, low, found, bound, progress)
            return f"{words}; the shortest that does takes {found.duration:g} s"
    max_duration = ticks * question.slew.period
    try:
        left = found_optimum(replace(question, duration=max_duration), progress).optimum.worst
    except PlanFailed as refused:
        return f"{words}, nor one of {max_duration:g} s: {refused}"
    return f"{words}, nor one of {max_duration:g} s, which leaves {rounded_up(left):g} m at least"


def _feasible(question: Question, members: tuple[Member, ...], ticks: int, linear: bool) -> bool:
    """Return whether some efforts keep to the limits in so many ticks; linear: all members are."""
    problem = replace(question, duration=ticks * question.slew.period)
    try:
        if linear:
            solved(convex_program(problem, members), goal=Goal(feasible=True))
        else:
            steps = max(problem.steps, _STEPS)
            found_optimum(replace(problem, feasible=True, steps=steps), ignore)
    except PlanFailed:
        return False
    return True
