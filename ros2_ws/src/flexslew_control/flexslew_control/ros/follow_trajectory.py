"""The action of `control_msgs` that robots are moved by: FollowJointTrajectory.

Only where that package is installed: it is not among the wheels.
"""

from bisect import bisect_right
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from typing import Any

from rclpy.action import CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.duration import Duration
from rclpy.node import Node
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectoryPoint

from flexslew_control.plan_service.job import BUSY, CANCELED, Outcome, PlanJob
from flexslew_control.plans.tracking import Tolerance, Tracked, Tracking, TrackingCode, TrackingEnd
from flexslew_control.ros.bench_clock import BenchClock
from flexslew_control.ros.plan_release import NodePlanRelease
from flexslew_control.ros.trajectories import trajectory_section
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics
from flexslew_plant.refusal import Cause, Refusal
from flexslew_plant.ros.coroutines import CoroutineActionServer, PendingResult
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.messages import seconds_of, stamp
from flexslew_plant.ros.offers import subscription

INSTALLED = find_spec("control_msgs") is not None
_ANY_ERROR = -1.0  # a tolerance: any error is allowed (control_msgs/JointTolerance)
_OF_PLATFORMS = ("multi_dof_trajectory", "component_path_tolerance", "component_goal_tolerance")


class FollowTrajectory:
    """Publishes a trajectory as a plan, and compares the joints with it until it is over.

    Args:
        node: node of the planner.
        loop: loop that serves the node.
        job: job that makes the plan.
        release: release that publishes the plan.
    """

    def __init__(self, node: Node, loop: Loop, job: PlanJob, release: NodePlanRelease) -> None:
        from control_msgs.action import FollowJointTrajectory

        self._kind: Any = FollowJointTrajectory
        self._node, self._loop, self._job, self._release = node, loop, job, release
        self._active: dict[bytes, _Flight] = {}  # by the goal's number
        self._server = CoroutineActionServer(
            node,
            FollowJointTrajectory,
            topics.FOLLOW_JOINT_TRAJECTORY,
            self._execute,
            cancel_callback=self._on_cancel,
        )

    def poll(self) -> None:
        """End flights that cannot go on, since the run is over or starts again."""
        for flight in self._active.values():
            if (end := flight.lost(self._release.clock)) is not None:
                flight.over(end)

    def end(self, why: str) -> None:
        """Answer every goal: the node ends."""
        for flight in self._active.values():
            flight.over(TrackingEnd(TrackingCode.GOAL_TOLERANCE_VIOLATED, why))

    def leave(self) -> None:
        """End the action."""
        self._server.destroy()

    def _on_cancel(self, goal: ServerGoalHandle) -> CancelResponse:
        """Reject to cancel a published plan, which is flown: the bench stops by the brake."""
        return CancelResponse.REJECT if _number(goal) in self._active else CancelResponse.ACCEPT

    async def _execute(self, goal: ServerGoalHandle) -> Any:
        end = await self._track(goal)
        if end.code == TrackingCode.SUCCESSFUL:
            goal.succeed()
        elif goal.is_cancel_requested:
            goal.canceled()
        else:
            goal.abort()
        return self._kind.Result(error_code=int(end.code), error_string=end.words)

    async def _track(self, goal: ServerGoalHandle) -> TrackingEnd:
        request = goal.request
        rejection = self._rejection(request)
        if rejection is not None:
            return rejection
        outcome = await self._request_plan(goal)
        if isinstance(outcome, Refusal):
            past = outcome.cause is Cause.PAST
            code = TrackingCode.OLD_HEADER_TIMESTAMP if past else TrackingCode.INVALID_GOAL
            return TrackingEnd(code, str(outcome))
        if goal.is_cancel_requested:
            return TrackingEnd(TrackingCode.INVALID_GOAL, str(CANCELED))
        path, at_end = request.path_tolerance, request.goal_tolerance
        tolerance_joints = (
            tolerance.name for tolerance in (*path, *at_end)
        )  # joints that stay, too
        tracking = Tracking(
            outcome,
            tuple(dict.fromkeys((*request.trajectory.joint_names, *tolerance_joints))),
            {t.name: Tolerance(t.position, t.velocity) for t in path},
            {t.name: Tolerance(t.position, t.velocity) for t in at_end},
            seconds_of(request.goal_time_tolerance),
        )
        flight = _Flight(
            tracking,
            self._release.clock.epoch,
            self._loop.future(),
            partial(self._release.has_later_plan, outcome),
        )
        states = subscription(
            self._node,
            topics.JOINT_STATES,
            partial(flight.update, partial(self._publish_feedback, goal, tracking)),
        )
        self._active[_number(goal)] = flight
        try:
            message = self._release.publish(outcome, "")
            response = await self._release.responses.response_future(message.hash)
            if response.refused or response.inactive:
                return TrackingEnd(TrackingCode.INVALID_GOAL, response.message)
            end: TrackingEnd = await flight.ended
            return end
        finally:
            del self._active[_number(goal)]
            self._node.destroy_subscription(states)

    def _rejection(self, request: Any) -> TrackingEnd | None:
        """Return why a request does not fit this bench, or None."""
        known, requested = self._release.requests.joint_names, request.trajectory.joint_names
        tolerances = (*request.path_tolerance, *request.goal_tolerance)
        unknown = [
            name for name in (*requested, *(t.name for t in tolerances)) if name not in known
        ]
        if not requested or unknown:
            named = f"{unknown[0]} is unknown" if unknown else "none is named"
            words = f"joint_names: {named}; allowed: {', '.join(known)}"
            return TrackingEnd(TrackingCode.INVALID_JOINTS, words)
        if any(t.acceleration > 0.0 for t in tolerances):
            words = "acceleration: is not measured; leave its tolerances at zero"
            return TrackingEnd(TrackingCode.INVALID_GOAL, words)
        limits = [x for t in tolerances for x in (t.position, t.velocity, t.acceleration)]
        if any(not (x >= 0.0 or x == _ANY_ERROR) for x in limits):
            words = "tolerances: 0 or more, or -1 (any error is allowed)"
            return TrackingEnd(TrackingCode.INVALID_GOAL, words)
        for field in _OF_PLATFORMS:
            if _has_points(getattr(request, field, ())):
                words = f"{field}: the bench moves joints; give a trajectory of joints"
                return TrackingEnd(TrackingCode.INVALID_GOAL, words)
        return None

    async def _request_plan(self, goal: ServerGoalHandle) -> Outcome:
        """Return the plan through the points, or why there is none."""
        if self._job.busy:
            return BUSY
        try:
            requests = self._release.requests
            section = trajectory_section(
                goal.request.trajectory, requests.next_start(), requests.shaping
            )
        except BadInput as error:
            return error.refusal
        done, flight = self._loop.future(), self._release.flight
        self._job.ask(
            partial(self._release.requests.request, section),
            done.set_result,
            late=partial(self._release.late, flight),
        )
        return self._release.checked(await done, flight)

    def _publish_feedback(
        self, goal: ServerGoalHandle, tracking: Tracking, time: float, seen: Tracked
    ) -> None:
        feedback = self._kind.Feedback(joint_names=list(tracking.joints))
        feedback.header.stamp = stamp(time)
        after = Duration(nanoseconds=round(1e9 * max(time - tracking.plan.start, 0.0))).to_msg()
        if hasattr(
            feedback, "index"
        ):  # of the last point that was passed; control_msgs 6.3 or later
            passed = [seconds_of(point.time_from_start) for point in goal.request.trajectory.points]
            feedback.index = max(bisect_right(passed, seconds_of(after)) - 1, 0)
        for field in ("desired", "actual", "error"):
            position, velocity = getattr(seen, field)
            point = JointTrajectoryPoint(
                positions=position.tolist(), velocities=velocity.tolist(), time_from_start=after
            )
            setattr(feedback, field, point)
        goal.publish_feedback(feedback)


def _number(goal: ServerGoalHandle) -> bytes:
    return bytes(goal.goal_id.uuid)


def _has_points(field: Any) -> bool:
    """Return whether a client has filled in a list, or the points of a trajectory."""
    return bool(getattr(field, "points", field))


class _Flight:
    """A trajectory that is flown.

    Args:
        tracking: of its plan.
        epoch: in which it is flown.
        end: gets what comes of it.
        replaced: returns whether another plan is flown in its place at a simulated time [s].
    """

    def __init__(
        self, tracking: Tracking, epoch: int, end: PendingResult, replaced: Callable[[float], bool]
    ) -> None:
        self._tracking, self._epoch, self.ended = tracking, epoch, end
        self._replaced = replaced

    def update(self, publish: Callable[[float, Tracked], None], states: JointState) -> None:
        """Hold the joints against the plan."""
        time, names = seconds_of(states.header.stamp), states.name
        positions = dict(zip(names, states.position, strict=True))
        rates = dict(zip(names, states.velocity, strict=True))
        seen = self._tracking.at(time, positions, rates)
        publish(time, seen)
        if (end := self._tracking.end(time, seen, self._replaced(time))) is not None:
            self.over(end)

    def lost(self, clock: BenchClock) -> TrackingEnd | None:
        """Return why nothing can come of it any more, or None."""
        if clock.epoch != self._epoch:
            words = "the bench was reset"
        elif clock.over:
            words = f"the run is over at {clock.now():g} s; see display_rate, goal_time_tolerance"
        else:
            return None
        return TrackingEnd(TrackingCode.GOAL_TOLERANCE_VIOLATED, words)

    def over(self, end: TrackingEnd) -> None:
        """Set the result, once."""
        if not self.ended.done():
            self.ended.set_result(end)


def follow_trajectory(
    node: Node, loop: Loop, job: PlanJob, release: NodePlanRelease
) -> FollowTrajectory | None:
    """Return what serves the action; None where `control_msgs` is not installed."""
    return FollowTrajectory(node, loop, job, release) if INSTALLED else None
