"""The `planner` node: plans for its actions, for trajectories and for its own parameters.

See plan_actions. A trajectory of `joint_trajectory` is published as a plan, as is a goal of
`follow_joint_trajectory`.
"""

from functools import partial
from math import inf
from pathlib import Path
from time import monotonic

from flexslew_msgs import msg

from flexslew_control.plan_service.job import Outcome, PlanJob
from flexslew_control.plan_service.requests import ASSUMPTIONS
from flexslew_control.plans.plan_file import load_plan
from flexslew_control.plans.planned_course import PATIENCE
from flexslew_control.ros.follow_trajectory import follow_trajectory
from flexslew_control.ros.plan_actions import PlanActions
from flexslew_control.ros.plan_release import NodePlanRelease
from flexslew_control.ros.plan_result import failure
from flexslew_control.ros.planner_settings import PlannerSettings
from flexslew_control.ros.trajectory_requests import TrajectoryRequests
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics
from flexslew_plant.refusal import Cause, Refusal
from flexslew_plant.ros.graph import PlantWatch
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.node_process import run_node
from flexslew_plant.ros.offers import subscription
from flexslew_plant.ros.parameters import handle_changes, new_node, settings_of

_POLL_PERIOD = 0.2  # between two polls at the graph [wall s]
_PLAN_PERIOD = 0.02  # between two polls at the planning process [wall s]
_LATE = 0.1  # a poll that comes so much later is the planner's own fault [wall s]


class Planner:
    """Makes one plan at a time, in a process of its own."""

    def __init__(self, loop: Loop) -> None:
        self.loop = loop
        self.node = node = new_node("planner")
        self._alive = alive = loop.only(node, "planner")
        self._presence = alive.heartbeats
        self._settings: PlannerSettings = settings_of(node, PlannerSettings, ASSUMPTIONS)
        self._job = PlanJob(not self._settings.file, loop.hurry)
        self._next_check = self._next_poll = 0.0
        self._plan_by = inf  # when its own plan is made at the latest [wall s]
        s = self._settings
        self._release = NodePlanRelease(node, loop, alive, s.trust, s.first_law())
        testbed = subscription(node, topics.TESTBED, self._on_testbed)
        set_assumptions = self._release.requests.set_assumptions
        if why := set_assumptions({key: getattr(s, key) for key in ASSUMPTIONS}):
            raise BadInput(why)
        handle_changes(node, set_assumptions)
        self._trajectories = TrajectoryRequests(node, self._job, self._release)
        self._trajectory_server = follow_trajectory(node, loop, self._job, self._release)
        self._watch = PlantWatch(loop, node, testbed, alive.heartbeats, s.exit_with_plant)
        self._actions = PlanActions(node, loop, self._job, self._release)

    def poll(self) -> float:
        """Look for the plant and for plans; return the wall seconds until the next look."""
        now = monotonic()
        if (
            self._next_poll and now > self._next_poll + _LATE
        ):  # a long plan was written, no heartbeat read
            self._presence.extend_timeouts(now - self._next_poll)
        wait = self._next(now)
        self._next_poll = now + wait
        return wait

    def _next(self, now: float) -> float:
        if now >= self._next_check:
            self._watch.look()
            if self.loop.stopped:
                self._finish_requests(Refusal("the run is over", cause=Cause.RUN_OVER))
            self._release.begin()
            self._release.check_laws()
            self._start_plan(now)
            self._next_check = now + _POLL_PERIOD
            if self._trajectory_server is not None:
                self._trajectory_server.poll()
        if self._alive.is_second(now):
            return _POLL_PERIOD
        pending = self._release.responses.poll(now)
        if not self._job.busy:
            return _PLAN_PERIOD if pending else self._next_check - now
        self._job.poll()
        return _PLAN_PERIOD

    def close(self) -> None:
        """End the process that plans."""
        self._job.close()

    def interrupted(self) -> bool:
        """Answer every goal before the node leaves."""
        self._finish_requests(Refusal("the planner was interrupted", cause=Cause.CANCELED))
        return False

    def _finish_requests(self, why: Refusal) -> None:
        """Answer every goal with this refusal; the answers are sent while the loop closes."""
        self._job.end(why)
        self._release.responses.end()
        if self._trajectory_server is not None:
            self._trajectory_server.end(str(why))

    def leave(self) -> None:
        """End the actions."""
        self._actions.leave()
        if self._trajectory_server is not None:
            self._trajectory_server.leave()

    def _on_plan(self, outcome: Outcome) -> None:
        """Publish what the parameters ask for; without it the node has no purpose."""
        if isinstance(outcome, Refusal):
            if self.loop.stopped or outcome.cause is Cause.CANCELED:
                return  # the node ends for another reason
            raise failure(outcome)
        self._release.begin_with(self._release.with_statement(outcome))

    def _on_testbed(self, testbed: msg.Testbed) -> None:
        if not self._release.notify(testbed):
            return
        self._watch.seen = True
        if self._settings.file:
            self._release.begin_with(load_plan(Path(self._settings.file)))
        elif self._settings.plan:
            self._plan_by = monotonic() + PATIENCE
            self._next_check = 0.0

    def _start_plan(self, now: float) -> None:
        """Make the plan of the parameters when it is known for which law, or patience is over."""
        if self._job.busy or not (now >= self._plan_by or self._release.laws.has_active_law):
            return
        if self._plan_by < inf:
            self._plan_by = inf
            request = partial(self._release.requests.parameter_request, self._settings.plan)
            self._job.ask(request, self._on_plan)


def main() -> None:
    """Run the node until it is interrupted."""
    run_node(Planner)


if __name__ == "__main__":
    main()
