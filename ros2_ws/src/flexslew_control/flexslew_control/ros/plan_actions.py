"""The actions `plan_slew`, which publishes its plan, and `draft_plan`, which keeps a draft."""

from collections.abc import Callable
from functools import partial

from flexslew_msgs import action, msg
from rclpy.action import CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node

from flexslew_control.plan import Plan
from flexslew_control.plan_service.job import BUSY, Client, Outcome, PlanJob
from flexslew_control.plan_service.planning import Iteration
from flexslew_control.ros.motion_watch import MotionWatch
from flexslew_control.ros.plan_release import NodePlanRelease
from flexslew_control.ros.plan_result import plan_result
from flexslew_plant.graph import topics
from flexslew_plant.ros.coroutines import CoroutineActionServer
from flexslew_plant.ros.loop import Loop


class PlanActions:
    """Makes a plan for a goal, and answers it.

    Args:
        node: of the planner.
        loop: that serves it.
        job: that plans.
        release: that publishes or keeps plans.
    """

    def __init__(self, node: Node, loop: Loop, job: PlanJob, release: NodePlanRelease) -> None:
        self._node, self._loop, self._job, self._release = node, loop, job, release
        self._servers = [
            CoroutineActionServer(
                node,
                action.PlanSlew,
                name,
                partial(self._execute, release_plan, release_plan == release.publish),
                cancel_callback=lambda _: CancelResponse.ACCEPT,
            )
            for name, release_plan in (
                (topics.PLAN_SLEW, release.publish),
                (topics.DRAFT_PLAN, release.keep),
            )
        ]

    def leave(self) -> None:
        """End the actions."""
        for server in self._servers:
            server.destroy()

    async def _execute(
        self,
        release_plan: Callable[[Plan, str], msg.Plan],
        wait_response: bool,
        goal: ServerGoalHandle,
    ) -> action.PlanSlew.Result:
        outcome = await self._outcome(goal)
        if not isinstance(outcome, Plan):
            return plan_result(goal, outcome, None)
        plan = release_plan(outcome, goal.request.who)
        response = (
            await self._release.responses.response_future(plan.hash) if wait_response else None
        )
        return plan_result(goal, outcome, plan, response)

    async def _outcome(self, goal: ServerGoalHandle) -> Outcome:
        """Return the plan of a goal, or why there is none."""
        request, requests = goal.request, self._release.requests
        if self._job.busy:
            return BUSY
        flight = self._release.flight
        watch = None if flight is None else MotionWatch(self._node, self._release.before)
        done = self._loop.future()
        self._job.ask(
            partial(requests.request, request.request, request.period, request.effort_limit),
            done.set_result,
            Client(partial(_publish, goal), lambda: goal.is_cancel_requested),
            partial(self._release.late, flight),
            None if watch is None else watch.required,
        )
        outcome = await done
        if watch is not None:
            watch.end()
        checked = self._release.checked(outcome, flight)
        return watch.included(checked) if watch and isinstance(checked, Plan) else checked


def _publish(goal: ServerGoalHandle, iteration: Iteration) -> None:
    """Send an iteration to the client of a goal."""
    values = iteration._asdict()
    number = values.pop("number")
    goal.publish_feedback(action.PlanSlew.Feedback(iteration=number, **values))
