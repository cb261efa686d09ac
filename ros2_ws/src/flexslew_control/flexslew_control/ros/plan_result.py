"""What the action plan_slew answers."""

from flexslew_msgs import action, msg
from rclpy.action.server import ServerGoalHandle

from flexslew_control.plan import Plan
from flexslew_control.planning import Refusal

CANCELED = Refusal(False, "canceled by the client")


def plan_result(
    goal: ServerGoalHandle, outcome: Plan | Refusal, plan: msg.Plan | None
) -> action.PlanSlew.Result:
    """Return the result of a goal, and end the goal with it.

    Args:
        goal: that was planned for.
        outcome: what came of it.
        plan: as published; None without one.
    """
    result = action.PlanSlew.Result()
    if isinstance(outcome, Plan):
        result.plan = plan
        goal.succeed()
        return result
    result.message = outcome.message
    if outcome is CANCELED:
        result.error_code = result.CANCELED
        goal.canceled()
    else:
        result.error_code = result.BAD_INPUT if outcome.bad_input else result.FAILED
        goal.abort()
    return result
