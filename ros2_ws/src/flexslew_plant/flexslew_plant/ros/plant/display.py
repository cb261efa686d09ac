"""The display side of the plant node: standard topics that RViz, Foxglove and PlotJuggler draw."""

from itertools import islice

import numpy as np
from builtin_interfaces.msg import Time
from flexslew_msgs.msg import AppendageState
from geometry_msgs.msg import Point, TransformStamped
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import ColorRGBA, Header, String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from flexslew_plant.arrays import Vector
from flexslew_plant.bench.bench import Bench, Truth
from flexslew_plant.bench.wire import stamp_of
from flexslew_plant.graph import topics
from flexslew_plant.measurement import Measurement
from flexslew_plant.ros.offers import publisher
from flexslew_plant.ros.outlet import DirectPublisher
from flexslew_plant.ros.outlets import DirectPublishers
from flexslew_plant.ros.plant.instrument_display import InstrumentDisplay
from flexslew_plant.ros.plant.platform_display import PlatformDisplay
from flexslew_plant.ros.template import Template
from flexslew_plant.testbeds import Testbed
from flexslew_plant.testbeds.robot_model import NO_ROTATION, Frame

# in the order in which their numbers are written
_TOPICS = (
    topics.CLOCK,
    topics.JOINT_STATES,
    topics.APPENDAGE_STATES,
    topics.TF,
    topics.MARKERS,
)


class Display:
    """Publishes joint, appendage and platform states, tf, markers and /clock at display rate.

    Frames carry the namespace of the node, as /tf serves every bench of a domain.

    Args:
        node: the plant.
        direct_publishers: outlets of the node.
        bench: bench with the state that is shown.
        rate: samples per simulated second; 0: nothing is shown.
    """

    def __init__(
        self, node: Node, direct_publishers: DirectPublishers, bench: Bench, rate: float
    ) -> None:
        self._bench = bench
        self._prefix = f"{node.get_namespace()}/".lstrip("/")
        self.set_rate(rate)
        self._listener_count: list[int] | None = (
            None  # subscriptions by topic while the bench is paused
        )
        self._publishers = [direct_publishers.publisher(name) for name in _TOPICS]
        self._platform = PlatformDisplay(direct_publishers, self._prefix)
        self._instruments = InstrumentDisplay(node, bench.appendages.instruments, self._prefix)
        self._draw(bench.testbed)
        static = publisher(node, topics.TF_STATIC)
        here = self._scene.body
        sensors = [
            Frame(here, name, (0.0, 0.0, 0.0), NO_ROTATION) for name in self._instruments.names
        ]
        if fixed := [*self._scene.fixed, *sensors]:
            static.publish(TFMessage(transforms=[self._transform(frame) for frame in fixed]))
        description = publisher(node, topics.ROBOT_DESCRIPTION)
        description.publish(String(data=self._scene.robot_description))
        self._static_publishers = (static, description)

    def set_rate(self, rate: float) -> None:
        """Show so many samples per simulated second; 0: none."""
        self._every = max(1, round(1.0 / (rate * self._bench.settings.period))) if rate else 0

    def due(self, tick: int) -> bool:
        """Return whether something is shown at this tick."""
        return self._every > 0 and tick % self._every == 0

    @property
    def publishers(self) -> list[DirectPublisher]:
        """What is published at this rate."""
        return [*self._publishers, *self._platform.publishers] if self._every else []

    def show(self, truth: Truth) -> None:
        """Publish this truth if it is due."""
        self._listener_count = None
        if self.due(truth.tick):
            self._publish(truth)

    def refresh(self) -> None:
        """Publish the truth of a paused bench once more for subscriptions that have come since."""
        before, self._listener_count = (
            self._listener_count,
            [topic_publisher.count for topic_publisher in self._publishers],
        )
        if not self._every or before is None:
            return
        if any(now > then for now, then in zip(self._listener_count, before, strict=True)):
            self._publish(self._bench.truth())

    def _publish(self, truth: Truth) -> None:
        if self._bench.testbed is not self._testbed:  # an antenna has a new target
            self._draw(self._bench.testbed)
        at, x = stamp_of(truth.time), np.concatenate((truth.position, truth.velocity))
        active = [topic_publisher.received for topic_publisher in self._publishers]
        if any(active):
            messages = self._template.filled(at, self._numbers(truth, x))
            for topic_publisher, data, is_active in zip(
                self._publishers, messages, active, strict=True
            ):
                if is_active:
                    topic_publisher.publish(data)
        self._platform.show(at, x, truth.applied_effort, truth.time)

    def sense(self, measurement: Measurement) -> None:
        """Publish the readings of instruments, regardless of the display rate."""
        self._instruments.show(measurement)

    def _numbers(self, truth: Truth, x: Vector) -> Vector:
        """Return what is shown of a state: joints, appendages, frames and points of lines."""
        model, appendages = self._bench.model, self._bench.appendages
        (modes, rates), (position, velocity) = model.modal_state(x), model.joint_state(x)
        effort, named = truth.applied_effort[: model.joints], self._named
        if effort.size < model.joints:
            effort = np.concatenate((effort, np.zeros(model.joints - effort.size)))
        numbers: list[float] = []
        for frame in self._dynamic_frames(truth.position, truth.time):
            numbers += frame.translation
            numbers += frame.rotation
        return np.concatenate(
            (
                position[named],
                velocity[named],
                effort[named],
                truth.tip_deflection,
                appendages.tip.dot(rates),
                appendages.curvature.dot(modes),
                modes,
                rates,
                np.array(numbers),
                *(line.ravel() for line in self._scene.lines(truth.position)),
            )
        )

    def _dynamic_frames(self, position: Vector, time: float) -> list[Frame]:
        """Return the frames that are not static."""
        return [
            f for f in self._scene.frames_at(position, time) if f.child not in self._static_frames
        ]

    def _draw(self, testbed: Testbed) -> None:
        """Show this testbed from now on."""
        self._testbed, self._scene = testbed, testbed.scene()
        self._platform.draw(testbed)
        self._static_frames = {frame.child for frame in self._scene.fixed}
        model, scene = testbed.model(), self._scene
        names = scene.joints if scene.joints is not None else model.joint_names
        every = tuple(names) == model.joint_names
        named = [model.joint_names.index(name) for name in names]
        self._named = slice(None) if every else named
        m, tips, n = len(names), len(model.appendages.names), model.modes
        rest = model.rest({})
        frames, lines = self._dynamic_frames(rest, 0.0), scene.lines(rest)
        first = (*scene.line_frames, "world")[0]  # of the appendages

        def joints(at: Time, numbers: list[float]) -> JointState:
            position, velocity, effort = _parts(numbers, m, m, m)
            return JointState(
                header=Header(stamp=at),
                name=list(names),
                position=position,
                velocity=velocity,
                effort=effort,
            )

        def appendages(at: Time, numbers: list[float]) -> AppendageState:
            tip, tip_rate, curvature, modes, rates = _parts(numbers, tips, tips, tips, n, n)
            return AppendageState(
                header=Header(stamp=at, frame_id=self._prefix + first),
                name=list(model.appendages.names),
                tip_deflection=tip,
                tip_velocity=tip_rate,
                root_curvature=curvature,
                modal_position=modes,
                modal_velocity=rates,
            )

        def transforms(at: Time, numbers: list[float]) -> TFMessage:
            each = _parts(numbers, *[7] * len(frames))
            new_frames = [
                Frame(f.parent, f.child, (x, y, z), (a, b, c, d))
                for f, (x, y, z, a, b, c, d) in zip(frames, each, strict=True)
            ]
            return TFMessage(transforms=[self._transform(frame, at) for frame in new_frames])

        def markers(at: Time, numbers: list[float]) -> MarkerArray:
            each = _parts(numbers, *[line.size for line in lines])
            found = zip(each, scene.line_frames, strict=True)
            return MarkerArray(
                markers=[
                    _marker(number, self._prefix + parent, points, at)
                    for number, (points, parent) in enumerate(found)
                ]
            )

        self._template = Template(
            (lambda at, _: Clock(clock=at), 0),
            (joints, 3 * m),
            (appendages, 3 * tips + 2 * n),
            (transforms, 7 * len(frames)),
            (markers, sum(line.size for line in lines)),
        )

    def _transform(self, frame: Frame, at: Time | None = None) -> TransformStamped:
        transform = TransformStamped(child_frame_id=self._prefix + frame.child)
        transform.header.stamp = at or Time()
        transform.header.frame_id = self._prefix + frame.parent
        place, rotation = transform.transform.translation, transform.transform.rotation
        place.x, place.y, place.z = map(float, frame.translation)
        rotation.x, rotation.y, rotation.z, rotation.w = map(float, frame.rotation)
        return transform


def _parts(numbers: list[float], *sizes: int) -> list[list[float]]:
    """Return the numbers in parts of these sizes."""
    each = iter(numbers)
    return [list(islice(each, size)) for size in sizes]


def _marker(number: int, frame: str, points: list[float], at: Time) -> Marker:
    """Return a line through the points (x, y, z, x, ...)."""
    marker = Marker(ns="beams", id=number, type=Marker.LINE_STRIP, action=Marker.ADD)
    marker.header.stamp, marker.header.frame_id = at, frame
    marker.pose.orientation.w = 1.0
    marker.scale.x = 0.15
    marker.color = ColorRGBA(r=0.2, g=0.6, b=0.9, a=1.0)
    each = iter(points)
    marker.points = [Point(x=x, y=y, z=z) for x, y, z in zip(each, each, each, strict=True)]
    return marker
