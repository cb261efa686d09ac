"""Conversion of records to ROS messages. Questions and answers are bytes: see bench.wire."""

from array import array
from collections.abc import Mapping
from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration, Time
from flexslew_msgs import msg

from flexslew_plant.arrays import Vector
from flexslew_plant.bench.message_fields import event_fields
from flexslew_plant.bench.wire import Stamp, stamp_of
from flexslew_plant.events import Event


def message_of(kind: Any, fields: Mapping[str, Any]) -> Any:
    """Return a message of ROS with these fields; arrays and stamps become the types of rclpy."""
    return kind(**{name: _ros_value(value) for name, value in fields.items()})


def _ros_value(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return doubles(value)
    return Time(sec=value.sec, nanosec=value.nanosec) if isinstance(value, Stamp) else value


def event_message(event: Event) -> msg.Event:
    """Return the event as a message."""
    return message_of(msg.Event, event_fields(event))


def stamp(seconds: float) -> Time:
    """Return simulated seconds as a stamp."""
    return Time(**stamp_of(seconds)._asdict())


def seconds_of(at: Time | Duration) -> float:
    """Return a stamp or a duration as seconds."""
    return float(at.sec + at.nanosec * 1e-9)


def doubles(values: Vector) -> "array[float]":
    """Return an array as the type that rclpy copies fastest."""
    return array("d", values.tobytes())
