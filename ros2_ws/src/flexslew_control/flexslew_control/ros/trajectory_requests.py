"""Messages on `joint_trajectory` become a plan, or an event that gives the refusal."""

from functools import partial

from rclpy.node import Node
from trajectory_msgs.msg import JointTrajectory

from flexslew_control.plan_service.job import BUSY, Outcome, PlanJob
from flexslew_control.plan_service.release import PlanRelease
from flexslew_control.ros.trajectories import METHOD, trajectory_section
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics
from flexslew_plant.refusal import Refusal
from flexslew_plant.ros.offers import subscription


class TrajectoryRequests:
    """Requests a plan through the points of each trajectory.

    Args:
        node: node of the planner.
        job: job that makes the plan.
        release: release that publishes the plan.
    """

    def __init__(self, node: Node, job: PlanJob, release: PlanRelease) -> None:
        self._job, self._release = job, release
        subscription(node, topics.JOINT_TRAJECTORY, self._on_trajectory)

    def _on_trajectory(self, message: JointTrajectory) -> None:
        flight = self._release.flight
        if self._job.busy:
            self._done(flight, BUSY)
            return
        try:
            requests = self._release.requests
            section = trajectory_section(message, requests.next_start(), requests.shaping)
        except BadInput as error:
            self._done(flight, error.refusal)
            return
        self._job.ask(
            partial(self._release.requests.request, section),
            partial(self._done, flight),
            late=partial(self._release.late, flight),
        )

    def _done(self, flight: int | None, outcome: Outcome) -> None:
        outcome = self._release.checked(outcome, flight)
        if isinstance(outcome, Refusal):
            self._release.refuse(METHOD, outcome)
        else:
            self._release.publish(outcome, "")
