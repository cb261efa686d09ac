"""References without feedforward: a step to the goal, and a smooth profile to compare with."""

from typing import Literal

import numpy as np

from flexslew_control.plan import Plan
from flexslew_control.planners.attitude.attitude_goal import GoalKey
from flexslew_control.planners.entry import PlannerEntry
from flexslew_control.planners.feedforward.basis import Basis
from flexslew_control.planners.feedforward.manoeuvre import manoeuvre_of
from flexslew_control.planners.feedforward.optimized_feedforward import on_ticks
from flexslew_control.planners.progress import Progress
from flexslew_control.planners.slew import FeedbackKey, Slew, plan_on_ticks, tick_times
from flexslew_control.planners.slewing import SlewPlanner
from flexslew_control.planners.trajectories import Profile
from flexslew_control.shared_keys import DesignModel, Initial, Start
from flexslew_plant.settings import NonNegative, Positive, section


@section
class NoPlan:
    """A step to the goal, without a profile or feedforward."""

    method: Literal["none"] = "none"
    goal: GoalKey = None
    start: Start = 0.0
    duration: NonNegative = 0.0  # time after which the manoeuvre counts as over [s]


@section
class ReferenceOnly:
    """A polynomial profile to the goal, without feedforward."""

    method: Literal["reference_only"] = "reference_only"
    model: DesignModel = None
    initial: Initial = None
    goal: GoalKey = None
    start: Start = 0.0
    duration: Positive = 25.0  # duration of the manoeuvre [s]
    reference: Profile = "cubic"  # profile of the reference
    feedback: FeedbackKey = None


def plan_none(settings: NoPlan, slew: Slew, progress: Progress) -> Plan:
    """Return the plan with the goal as its reference from its first tick on."""
    ticks = tick_times(settings.start, settings.duration, slew.period)
    position = np.tile(slew.goal, (len(ticks), 1))
    zeros = np.zeros_like(position)
    summary = {"duration": settings.duration}
    return plan_on_ticks(settings, slew, (position, zeros), zeros[1:], summary)


def plan_reference_only(settings: ReferenceOnly, slew: Slew, progress: Progress) -> Plan:
    """Return the plan with the reference and zero feedforward, to compare with."""
    manoeuvre = manoeuvre_of(slew, settings.duration, settings.reference)
    basis = Basis("constant", 1, settings.duration)
    weights = np.zeros((1, manoeuvre.model.joints))
    return on_ticks(settings, slew, manoeuvre, basis, weights)


NONE = PlannerEntry(NoPlan, SlewPlanner(plan_none, one_axis=False), feedforward=False)
REFERENCE = PlannerEntry(
    ReferenceOnly, SlewPlanner(plan_reference_only), feedforward=False, takes_duration=True
)
