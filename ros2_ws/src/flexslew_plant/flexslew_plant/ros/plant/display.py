"""The display side of the plant node: standard topics that RViz, Foxglove and PlotJuggler draw."""

from typing import Any

import numpy as np
from flexslew_msgs.msg import AppendageState
from geometry_msgs.msg import Point, TransformStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import ColorRGBA, String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from flexslew_plant import topics
from flexslew_plant.bench.bench import Bench, Truth
from flexslew_plant.ros.messages import doubles, stamp
from flexslew_plant.ros.offers import publisher


class Display:
    """Publishes joint and appendage states, tf, markers and /clock at display rate.

    Frames carry the namespace of the node, as /tf serves every bench of a domain.

    Args:
        node: the plant.
        bench: whose truth is shown.
        rate: samples per simulated second; 0: nothing is shown.
    """

    def __init__(self, node: Node, bench: Bench, rate: float) -> None:
        self._bench = bench
        self._prefix = f"{node.get_namespace()}/".lstrip("/")
        self.set_rate(rate)
        self._testbed = bench.testbed
        self._scene = bench.testbed.scene()
        self._frame = (*self._scene.line_frames, "world")[0]  # of the appendages
        self._clock = publisher(node, topics.CLOCK)
        self._joints = publisher(node, topics.JOINT_STATES)
        self._appendages = publisher(node, topics.APPENDAGE_STATES)
        self._tf = publisher(node, topics.TF)
        self._markers = publisher(node, topics.MARKERS)
        self._samples = (self._clock, self._joints, self._appendages, self._tf, self._markers)
        self._description = publisher(node, topics.ROBOT_DESCRIPTION)
        self._description.publish(String(data=self._scene.robot_description))

    def set_rate(self, rate: float) -> None:
        """Show so many samples per simulated second; 0: none."""
        self._every = max(1, round(1.0 / (rate * self._bench.settings.period))) if rate else 0

    @property
    def publishers(self) -> list[Publisher[Any]]:
        """What is published at this rate."""
        return [*self._samples] if self._every else []

    def show(self, truth: Truth) -> None:
        """Publish this truth if it is due."""
        if not self._every or truth.tick % self._every:
            return
        model, appendages = self._bench.model, self._bench.appendages
        at, x = stamp(truth.time), np.concatenate((truth.position, truth.velocity))
        modes, rates = model.modal_state(x)
        position, velocity = model.joint_state(x)
        self._clock.publish(Clock(clock=at))
        joints = JointState(
            name=list(model.joint_names),
            position=doubles(position),
            velocity=doubles(velocity),
            effort=doubles(truth.applied_effort),
        )
        joints.header.stamp = at
        self._joints.publish(joints)
        state = AppendageState(
            name=list(appendages.names),
            tip_deflection=doubles(truth.tip_deflection),
            tip_velocity=doubles(appendages.tip @ rates),
            root_curvature=doubles(appendages.curvature @ modes),
            modal_position=doubles(modes),
            modal_velocity=doubles(rates),
        )
        state.header.stamp, state.header.frame_id = at, self._prefix + self._frame
        self._appendages.publish(state)
        if self._bench.testbed is not self._testbed:  # an antenna has a new target
            self._testbed = self._bench.testbed
            self._scene = self._testbed.scene()
        transforms = []
        for frame in self._scene.frames_at(truth.position, truth.time):
            transform = TransformStamped(child_frame_id=self._prefix + frame.child)
            transform.header.stamp, transform.header.frame_id = at, self._prefix + frame.parent
            place, turn = transform.transform.translation, transform.transform.rotation
            place.x, place.y, place.z = frame.translation
            turn.x, turn.y, turn.z, turn.w = map(float, frame.rotation)
            transforms.append(transform)
        self._tf.publish(TFMessage(transforms=transforms))
        markers = []
        lines = zip(self._scene.lines(truth.position), self._scene.line_frames, strict=True)
        for number, (line, parent) in enumerate(lines):
            marker = Marker(ns="beams", id=number, type=Marker.LINE_STRIP, action=Marker.ADD)
            marker.header.stamp, marker.header.frame_id = at, self._prefix + parent
            marker.pose.orientation.w = 1.0
            marker.scale.x = 0.15
            marker.color = ColorRGBA(r=0.2, g=0.6, b=0.9, a=1.0)
            marker.points = [Point(x=x, y=y, z=z) for x, y, z in line.tolist()]
            markers.append(marker)
        self._markers.publish(MarkerArray(markers=markers))
