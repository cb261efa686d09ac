"""What is said of a plan: the answer of the action plan_slew, and the event."""

from flexslew_msgs import action, msg
from rclpy.action.server import ServerGoalHandle

from flexslew_control.plan import Plan
from flexslew_control.planning import Refusal
from flexslew_plant.bench.events import Event, Level

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


_WORDS = {
    "planned": "planned",
    "plan_drafted": "drafted, to be adopted or refused",
    "plan_refused": "refused by the operator",
}


def plan_event(kind: str, plan: Plan, digest: str, who: str, now: float, epoch: int) -> Event:
    """Return what the log says of a plan.

    Args:
        kind: planned (it is published), plan_drafted or plan_refused.
        plan: the plan.
        digest: its hash.
        who: asked for it; empty: nobody by name.
        now: simulated time [s].
        epoch: counts resets.
    """
    words = f"{plan.method}: {plan.duration:g} s {_WORDS[kind]}, hash {digest[:12]}"
    data = {"hash": digest, "method": plan.method, "who": who or "unnamed"}
    tick = round(now / plan.period)
    return Event(tick, now, epoch, Level.INFO, "planner", kind, words, data)
