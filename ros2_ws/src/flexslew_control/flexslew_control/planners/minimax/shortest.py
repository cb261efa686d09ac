"""The shortest slew: the least duration whose optimum is good enough, or that is feasible."""

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
_LONGER = 12  # times that a duration is doubled before none is said to do


def shortest(question: Question, bound: float, progress: Progress) -> Found:
    """Return the shortest slew whose worst residual is within a bound.

    Args:
        question: what is sought; its duration is the longest that is allowed.
        bound: of the worst residual [m].
        progress: called with every program that is solved.

    Raises:
        PlanFailed: the longest slew that is allowed does not meet the bound.
    """
    period = question.slew.period
    high = int(np.ceil(question.duration / period - 1e-9))
    best = _within(question, high, bound, progress)
    if best is None:
        raise PlanFailed(_no_duration(question, bound, progress))
    low = min(int(question.rigid / period), high - 1)  # nothing is faster
    while high - low > max(1, int(_CLOSE * high)):
        middle = (low + high) // 2
        found = _within(question, middle, bound, progress)
        if found is None:
            low = middle
        else:
            high, best = middle, found
    return best


def least_duration(question: Question) -> float | None:
    """Return the least duration in which the limits let efforts lead to the goal [s]; None: none.

    Args:
        question: what is sought; its duration is where the search starts.
    """
    members = members_of(question.ensemble, question.slew)
    period = question.slew.period
    low = min(int(question.duration / period), int(question.rigid / period))
    high = max(2 * low, int(np.ceil(question.rigid / period)), 2)
    for _ in range(_LONGER):
        if _feasible(question, members, high):
            break
        low, high = high, 2 * high
    else:
        return None
    while high - low > max(1, int(_CLOSE * high)):
        middle = (low + high) // 2
        low, high = (low, middle) if _feasible(question, members, middle) else (middle, high)
    return high * period


def enough_time(question: Question) -> str:
    """Return in words in what time the limits let efforts lead to the goal."""
    least = least_duration(question)
    if least is None:
        return f"no duration up to {2**_LONGER * question.duration:.4g} s is enough; widen a limit"
    return (
        f"a duration of {rounded_up(least):g} s (now {question.duration:g} s) is enough; a rigid "
        f"body takes {question.rigid:.4g} s"
    )


def _within(question: Question, ticks: int, bound: float, progress: Progress) -> Found | None:
    """Return the optimum in so many ticks; None: it leaves more than the bound."""
    shorter = replace(question, duration=ticks * question.slew.period)
    try:
        found = found_optimum(shorter, progress, bound)
    except PlanFailed:
        return None
    return found if found.optimum.worst <= bound else None


def _no_duration(question: Question, bound: float, progress: Progress) -> str:
    """Return in words what the longest slew leaves, and how long one takes that leaves little."""
    ticks = int(np.ceil(question.duration / question.slew.period - 1e-9))
    now = question.duration
    for _ in range(3):
        ticks = ticks * 3 // 2
        found = _within(question, ticks, bound, progress)
        if found is not None:
            return (
                f"no slew of {now:g} s leaves {bound:g} m or less on every member; "
                f"one of {found.duration:g} s does"
            )
    return (
        f"no slew of {now:g} s leaves {bound:g} m or less on every member, nor one of "
        f"{ticks * question.slew.period:g} s"
    )


def _feasible(question: Question, members: tuple[Member, ...], ticks: int) -> bool:
    """Return whether some efforts keep to the limits in so many ticks."""
    asked = replace(question, duration=ticks * question.slew.period)
    try:
        if all(is_linear(member.model) for member in members):
            solved(convex_program(asked, members), goal=Goal(feasible=True))
        else:
            found_optimum(replace(asked, ensemble=replace(asked.ensemble, vary={})), ignore)
    except PlanFailed:
        return False
    return True
