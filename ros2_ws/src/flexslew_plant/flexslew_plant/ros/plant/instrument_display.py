"""What gyros and star trackers read, in standard messages."""

from collections.abc import Callable
from functools import partial

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, QuaternionStamped, Vector3
from rclpy.node import Node
from sensor_msgs.msg import Imu
from std_msgs.msg import Header

from flexslew_plant.arrays import Vector
from flexslew_plant.bench.wire import Stamp, stamp_of
from flexslew_plant.graph import topics
from flexslew_plant.measurement import Measurement
from flexslew_plant.ros.offers import publisher
from flexslew_plant.ros.template import Template
from flexslew_plant.testbeds.instruments import Gyro, Instrument, StarTracker
from flexslew_plant.testbeds.instruments.instrument import channels

_NOT_GIVEN = [-1.0, *[0.0] * 8]  # covariance for "not measured" (sensor_msgs/Imu)


class InstrumentDisplay:
    """Publishes each gyro on `sensors/imu` and each star tracker on `sensors/attitude`.

    They are the readings of the measurement, faults included, at each of its ticks; of a star
    tracker those that there are. The frame is named as the sensor and coincides with the
    platform's: all numbers are along body axes. Stamps are those of the measurement.

    Args:
        node: the plant.
        instruments: instruments of the testbed on the bench.
        prefix: prefix of the names of frames.

    Attributes:
        names: names of the published sensors, without the prefix.
    """

    def __init__(self, node: Node, instruments: tuple[Instrument, ...], prefix: str) -> None:
        imu, attitude = (
            publisher(node, topics.SENSORS_IMU),
            publisher(node, topics.SENSORS_ATTITUDE),
        )
        self.names: list[str] = []
        self._senders: list[tuple[slice, Callable[[Stamp, Vector], None]]] = []
        for one in instruments:
            frame = prefix + one.name
            if isinstance(one, Gyro):
                send = _sender(imu.publish, Template((partial(_imu, frame), 3)))
            elif isinstance(one, StarTracker):
                send = _sender(attitude.publish, Template((partial(_attitude, frame), 4)))
            else:
                continue
            self.names.append(one.name)
            self._senders.append((channels(one), send))

    def show(self, measurement: Measurement) -> None:
        """Publish what the instruments read at this tick."""
        for where, send in self._senders:
            reading = measurement.tip_deflection[where]
            if len(reading) == 3 or reading.any():
                send(stamp_of(measurement.time), reading)


def _sender(
    publish: Callable[[bytes], None], template: Template
) -> Callable[[Stamp, Vector], None]:
    """Return what publishes a reading."""
    return lambda at, reading: publish(*template.filled(at, reading))


def _imu(frame: str, at: Time, numbers: list[float]) -> Imu:
    x, y, z = numbers
    return Imu(
        header=Header(stamp=at, frame_id=frame),
        orientation_covariance=_NOT_GIVEN,
        angular_velocity=Vector3(x=x, y=y, z=z),
        linear_acceleration_covariance=_NOT_GIVEN,
    )


def _attitude(frame: str, at: Time, numbers: list[float]) -> QuaternionStamped:
    x, y, z, w = numbers
    orientation = Quaternion(x=x, y=y, z=z, w=w)
    return QuaternionStamped(header=Header(stamp=at, frame_id=frame), quaternion=orientation)
