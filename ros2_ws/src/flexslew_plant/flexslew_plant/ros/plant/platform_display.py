"""The motion of a free platform in standard messages, for those without flexslew_msgs."""

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Quaternion, Twist, Vector3, WrenchStamped
from geometry_msgs.msg import Wrench as WrenchMessage
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu
from std_msgs.msg import Header

from flexslew_plant.arrays import Vector
from flexslew_plant.bench.wire import Stamp
from flexslew_plant.graph import topics
from flexslew_plant.ros.outlets import DirectPublishers
from flexslew_plant.ros.template import Template
from flexslew_plant.testbeds import Testbed
from flexslew_plant.testbeds.contract import CanFloat, Floating

_NOT_GIVEN = [-1.0, *[0.0] * 8]  # covariance for "not measured" (sensor_msgs/Imu)


class PlatformDisplay:
    """Publishes `imu`, `odometry` and `wrench` where the testbed's platform floats freely.

    They are the true motion, without the errors of any sensor; covariances are zero, which is
    "unknown", and `imu` has no linear acceleration. Twist, rates and wrench are along body axes.

    Args:
        direct_publishers: of the plant.
        prefix: of the names of frames.
    """

    def __init__(self, direct_publishers: DirectPublishers, prefix: str) -> None:
        self._prefix = prefix
        self._floating: Floating | None = None
        topic_names = (topics.IMU, topics.ODOMETRY, topics.WRENCH)
        self.publishers = [direct_publishers.publisher(name) for name in topic_names]

    def draw(self, testbed: Testbed) -> None:
        """Show this testbed from now on."""
        self._floating = testbed.floating() if isinstance(testbed, CanFloat) else None
        if self._floating is not None:
            world, body = self._prefix + "world", self._prefix + self._floating.frame
            self._template = _template(world, body)

    def show(self, at: Stamp, x: Vector, effort: Vector, time: float) -> None:
        """Publish one sample.

        Args:
            at: its time, as messages have it.
            x: the state [q, v].
            effort: applied last, one per actuator [N m or N].
            time: its time [s].
        """
        if self._floating is None:
            return
        place, attitude, velocity, rate = self._floating.motion(x)
        force, torque = self._floating.wrench(x, effort, time)
        motion = (place, attitude, velocity, rate)
        numbers = np.concatenate((attitude, rate, *motion, force, torque))
        for topic_publisher, data in zip(
            self.publishers, self._template.filled(at, numbers), strict=True
        ):
            topic_publisher.publish(data)


def _template(world: str, body: str) -> Template:
    """Return imu, odometry and wrench of a platform with this frame in that one."""

    def imu(at: Time, numbers: list[float]) -> Imu:
        return Imu(
            header=Header(stamp=at, frame_id=body),
            orientation=_quaternion(numbers[:4]),
            angular_velocity=_vector(numbers[4:]),
            linear_acceleration_covariance=_NOT_GIVEN,
        )

    def odometry(at: Time, numbers: list[float]) -> Odometry:
        message = Odometry(header=Header(stamp=at, frame_id=world), child_frame_id=body)
        x, y, z = numbers[:3]
        place = Point(x=x, y=y, z=z)
        message.pose.pose = Pose(position=place, orientation=_quaternion(numbers[3:7]))
        linear, angular = _vector(numbers[7:10]), _vector(numbers[10:])
        message.twist.twist = Twist(linear=linear, angular=angular)
        return message

    def wrench(at: Time, numbers: list[float]) -> WrenchStamped:
        force, torque = _vector(numbers[:3]), _vector(numbers[3:])
        return WrenchStamped(
            header=Header(stamp=at, frame_id=body),
            wrench=WrenchMessage(force=force, torque=torque),
        )

    return Template((imu, 7), (odometry, 13), (wrench, 6))


def _quaternion(numbers: list[float]) -> Quaternion:
    x, y, z, w = numbers
    return Quaternion(x=x, y=y, z=z, w=w)


def _vector(numbers: list[float]) -> Vector3:
    x, y, z = numbers
    return Vector3(x=x, y=y, z=z)
