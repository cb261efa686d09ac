"""The topics of plans: the messages to present listeners, and to later ones."""

from flexslew_msgs import msg
from rclpy.node import Node

from flexslew_control.message_fields import plan_fields
from flexslew_control.plan import Plan
from flexslew_control.ros.trajectories import trajectory_message
from flexslew_plant.graph import topics
from flexslew_plant.ros.messages import message_of, stamp
from flexslew_plant.ros.offers import publisher
from flexslew_plant.testbeds.orientation.attitude import AttitudeJoints


class PlanPublisher:
    """Publishes plans, latched.

    Args:
        node: node of the planner.

    Attributes:
        told: the plan that a new listener receives last; None: it receives none.
        attitude: the joints of the testbed that read one; None: none do.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publishers = {n: publisher(node, n) for n in (topics.PLAN, topics.PLANNED_TRAJECTORY)}
        self.told: Plan | None = None
        self.attitude: AttitudeJoints | None = None

    def message(self, plan: Plan, now: float, epoch: int) -> msg.Plan:
        """Return a plan as a message.

        Args:
            plan: the plan.
            now: its stamp [s]: a reset drops it, but not that of 0 s.
            epoch: number of resets before.
        """
        fields = plan_fields(plan, self.attitude)
        return message_of(msg.Plan, {"stamp": stamp(now), **fields, "epoch": epoch})

    def offer(self, plan: Plan, message: msg.Plan) -> None:
        """Publish a plan."""
        self.told = plan
        self._publishers[topics.PLAN].publish(message)
        self._publishers[topics.PLANNED_TRAJECTORY].publish(trajectory_message(plan))

    def clear(self) -> None:
        """Withdraw earlier messages from later listeners."""
        if self.told is None:
            return
        self.told = None
        for name, entry in self._publishers.items():
            self._node.destroy_publisher(entry)
            self._publishers[name] = publisher(self._node, name)
