"""The `planner` node: plans on request and what its parameters ask for.

The action `plan_slew` publishes its plan, `draft_plan` keeps it until somebody decides.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import monotonic

from flexslew_msgs import action, msg
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.task import Future

from flexslew_control.plan import Plan
from flexslew_control.plan_file import load_plan
from flexslew_control.planning import Iteration, Planning, PlanRequest
from flexslew_control.ros.plan_release import MODEL, PlanRelease
from flexslew_control.ros.plan_result import BUSY, CANCELED, failure, plan_result
from flexslew_control.ros.planner_settings import PlannerSettings
from flexslew_plant import topics
from flexslew_plant.refusal import Refusal
from flexslew_plant.ros.graph import PlantWatch
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.node_process import run_node
from flexslew_plant.ros.offers import subscription
from flexslew_plant.ros.parameters import new_node, settings_of

_POLL_PERIOD = 0.2  # between two polls at the graph [wall s]
_PLANNING = 0.02  # between two polls at the planning process [wall s]


class Planner:
    """Makes one plan at a time, in a process of its own."""

    def __init__(self, loop: Loop) -> None:
        self.loop = loop
        self.node = node = new_node("planner")
        alive = loop.live(node, "planner")
        self._settings: PlannerSettings = settings_of(node, PlannerSettings, (MODEL,))
        self._planning = Planning(soon=not self._settings.file)
        self._goal: ServerGoalHandle | None = None  # that is planned for; None: the parameters
        self._done: Future | None = None  # of the plan under way
        self._next_look = 0.0
        s = self._settings
        self._release = PlanRelease(node, loop, alive, (s.kp, s.kd), s.trust, s.in_charge())
        testbed = subscription(node, topics.TESTBED, self._on_testbed)
        self._release.serve_model(node, s.model)
        self._watch = PlantWatch(loop, testbed, self._settings.exit_with_plant)
        self._servers = [
            ActionServer(
                node,
                action.PlanSlew,
                name,
                partial(self._execute, hand_over, hand_over == self._release.publish),
                cancel_callback=lambda _: CancelResponse.ACCEPT,
            )
            for name, hand_over in (
                (topics.PLAN_SLEW, self._release.publish),
                (topics.DRAFT_PLAN, self._release.keep),
            )
        ]

    def poll(self) -> float:
        """Look for the plant and for plans; return the wall seconds until the next look."""
        now = monotonic()
        if now >= self._next_look:
            self._watch.look()
            self._next_look = now + _POLL_PERIOD
        awaited = self._release.poll(now)
        if self._done is None:
            return _PLANNING if awaited else self._next_look - now
        for news in self._planning.news():
            self._take(news)
        if self._done is not None and self._goal is not None and self._goal.is_cancel_requested:
            self._planning.cancel()
            self._take(CANCELED)
        return _PLANNING

    def close(self) -> None:
        """End the process that plans, and the actions."""
        self._planning.close()
        for server in self._servers:
            server.destroy()

    def _ask(self, request: PlanRequest | Refusal, goal: ServerGoalHandle | None) -> Future:
        """Begin to plan; return the future of what comes of it."""
        self._goal, self._done = goal, self.loop.future()
        done = self._done
        if isinstance(request, Refusal):
            self._take(request)
        else:
            self._planning.ask(request)
        self.loop.hurry()
        return done

    def _take(self, news: Iteration | Plan | Refusal) -> None:
        """Take a message of the planning process."""
        if isinstance(news, Iteration):
            if self._goal is not None:
                values = news._asdict()
                number = values.pop("number")
                self._goal.publish_feedback(action.PlanSlew.Feedback(iteration=number, **values))
            return
        done, self._done = self._done, None
        if done is not None:
            done.set_result(news)
        if self._goal is None and isinstance(news, Refusal):
            raise failure(news)
        if self._goal is None and isinstance(news, Plan):
            self._release.publish(news, "")

    def _on_testbed(self, testbed: msg.Testbed) -> None:
        if not self._release.announce(testbed):
            return
        self._watch.seen = True
        if self._settings.file:
            self._release.publish(load_plan(Path(self._settings.file)), "")
        elif self._settings.plan and self._done is None:
            self._ask(self._release.own_request(self._settings.plan), None)

    async def _execute(
        self, hand_over: Callable[[Plan, str], msg.Plan], flown: bool, goal: ServerGoalHandle
    ) -> action.PlanSlew.Result:
        outcome = await self._outcome(goal)
        if not isinstance(outcome, Plan):
            return plan_result(goal, outcome, None)
        plan = hand_over(outcome, goal.request.who)
        answered = await self._release.answered(plan.hash) if flown else None
        return plan_result(goal, outcome, plan, answered)

    async def _outcome(self, goal: ServerGoalHandle) -> Plan | Refusal:
        """Return what comes of a goal."""
        request = goal.request
        if self._done is not None:
            return BUSY
        requested = self._release.request(request.request, request.period, request.effort_limit)
        return self._release.checked(await self._ask(requested, goal))


def main() -> None:
    """Run the node until it is interrupted."""
    run_node(Planner)


if __name__ == "__main__":
    main()
