"""The answer of the action plan_slew."""

from flexslew_msgs import action, msg
from rclpy.action.server import ServerGoalHandle

from flexslew_control.active_laws import describe_plan_law
from flexslew_control.plan import Plan
from flexslew_control.plans.planned_course import PlanResponse
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.refusal import Cause, Refusal


def failure(why: Refusal) -> BadInput | PlanFailed:
    """Return why there is no plan of the parameters, as the error that ends the node."""
    kind = PlanFailed if why.cause is Cause.NO_MANOEUVRE else BadInput
    return kind(f"parameter plan: {why}")


def plan_result(
    goal: ServerGoalHandle,
    outcome: Plan | Refusal,
    plan: msg.Plan | None,
    response: PlanResponse | None = None,
) -> action.PlanSlew.Result:
    """Return the result of a goal, and end the goal with it.

    Args:
        goal: goal that requested the plan.
        outcome: the plan, or why there is none.
        plan: published message; None without one.
        response: the controllers' answers to it; None: none were awaited.
    """
    result = action.PlanSlew.Result()
    if isinstance(outcome, Plan):
        result.plan = plan
        parts = [response.message if response is not None else "", describe_plan_law(outcome)]
        result.message = "; ".join(filter(None, (*parts, outcome.summary.get("warning"))))
        if response is not None and (response.refused or response.inactive):
            result.error_code = result.FAILED
            goal.abort()
        else:
            goal.succeed()
        return result
    result.message = str(outcome)
    if outcome.cause is Cause.CANCELED:
        result.error_code = result.CANCELED
        goal.canceled()
    else:
        failed = outcome.cause is Cause.NO_MANOEUVRE
        result.error_code = result.FAILED if failed else result.BAD_INPUT
        goal.abort()
    return result
