"""A controller of the bench with nothing but messages: what it takes in any language.

See docs/any_language.md. A proportional and derivative law that holds the joints at zero.
"""

import random
import time
from contextlib import suppress

import rclpy
from flexslew_msgs.msg import Alive, ControllerStatus, EffortCommand, Measurement, Testbed
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

LOOP = QoSProfile(depth=4000)  # reliable
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEST_EFFORT = QoSProfile(depth=20, reliability=ReliabilityPolicy.BEST_EFFORT)
STIFFNESS, DAMPING = 400.0, 1500.0  # [N m/rad, N m s/rad]


class Controller(Node):
    """Answers when it is named."""

    def __init__(
        self, name: str = "any_language", law: str = "docs/examples/any_language.py"
    ) -> None:
        super().__init__(name)
        self.limit: list[float] = []
        instance = random.getrandbits(63)
        self.status = ControllerStatus(
            controller=self.get_name(),
            law=law,
            reason="no testbed yet",
            instance=instance,
        )
        self.heartbeat = Alive(
            node=self.get_name(), role="controller", instance=instance, since=time.time_ns()
        )
        self.effort = self.create_publisher(EffortCommand, "effort_command", LOOP)
        self.told = self.create_publisher(ControllerStatus, "controller_status", LATCHED)
        self.alive = self.create_publisher(Alive, "alive", BEST_EFFORT)
        self.create_subscription(Testbed, "testbed", self.on_testbed, LATCHED)
        self.create_subscription(Measurement, "measurement", self.on_measurement, LOOP)
        self.create_timer(0.25, lambda: self.alive.publish(self.heartbeat))
        self.create_timer(0.1, lambda: self.told.publish(self.status))

    def on_testbed(self, testbed: Testbed) -> None:
        """Know the actuators: now it could answer."""
        self.limit = list(testbed.effort_limit)
        self.status.ready, self.status.reason = True, ""
        self.told.publish(self.status)

    def on_measurement(self, m: Measurement) -> None:
        """Answer the question if it is for this controller; every question is an observation."""
        self.status.last_tick, self.status.epoch = m.tick, m.epoch
        if m.controller != self.get_name() or not self.limit:
            return
        joints = zip(m.joint_position, m.joint_velocity, self.limit, strict=True)
        effort = [
            min(max(-STIFFNESS * position - DAMPING * rate, -limit), limit)  # NaN stays NaN
            for position, rate, limit in joints
        ]
        self.answer(m, effort)

    def answer(self, m: Measurement, effort: list[float]) -> None:
        """Publish the answer to a question."""
        self.effort.publish(
            EffortCommand(
                stamp=m.header.stamp,
                tick=m.tick,
                epoch=m.epoch,
                controller=m.controller,
                effort=effort,
                instance=self.heartbeat.instance,
            )
        )


if __name__ == "__main__":
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(Controller())
