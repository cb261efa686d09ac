"""A message whose numbers are put into its bytes is the message built from them."""

from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from flexslew_plant.bench.wire import Stamp
from flexslew_plant.ros.template import Template


def joints(names: list[str]) -> Any:
    def build(at: Time, numbers: list[float]) -> JointState:
        m = len(names)
        return JointState(
            header=Header(stamp=at, frame_id="a"),
            name=names,
            position=numbers[:m],
            velocity=numbers[m:],
        )

    return build


def transforms(names: list[str]) -> Any:
    def build(at: Time, numbers: list[float]) -> TFMessage:
        found = []
        for name, number in zip(names, numbers, strict=True):
            transform = TransformStamped(header=Header(stamp=at), child_frame_id=name)
            transform.transform.translation.y = number
            found.append(transform)
        return TFMessage(transforms=found)

    return build


@pytest.mark.parametrize("names", [[], ["a"], ["yaw", "pitch of the hub", "ä"]])
@pytest.mark.parametrize(("kind", "make", "per_name"), [
    (JointState, joints, 2), (TFMessage, transforms, 1)
])  # fmt: skip
def test_filling_in_is_building(kind: Any, make: Any, per_name: int, names: list[str]) -> None:
    build, generator = make(names), np.random.default_rng(len(names))
    template = Template((build, per_name * len(names)))
    for sec, nanosec in ((0, 0), (7, 999_999_999), (-1, 5)):
        numbers = generator.standard_normal(per_name * len(names))
        (filled,) = template.filled(Stamp(sec, nanosec), numbers)
        expected = build(Time(sec=sec, nanosec=nanosec), numbers.tolist())
        assert deserialize_message(filled, kind) == expected


def test_several_messages_are_filled_in_at_once() -> None:
    """Their sizes are no multiples of eight bytes."""
    builds = [(joints(["a"]), 2), (transforms(["bc", "d"]), 2), (joints([]), 0), (joints(["e"]), 2)]
    kinds = JointState, TFMessage, JointState, JointState
    generator = np.random.default_rng(1)
    template = Template(*builds)
    for sec in (0, 3):
        numbers = generator.standard_normal(6)
        found = template.filled(Stamp(sec, 4), numbers)
        parts = np.split(numbers, [2, 4, 4])
        for kind, (build, _), data, part in zip(kinds, builds, found, parts, strict=True):
            expected = build(Time(sec=sec, nanosec=4), part.tolist())
            assert deserialize_message(data, kind) == expected


def test_a_number_that_the_message_drops_is_an_error() -> None:
    with pytest.raises(RuntimeError, match="0 of 1 numbers"):
        Template((joints(["a"]), 2), (lambda at, numbers: JointState(header=Header(stamp=at)), 1))
