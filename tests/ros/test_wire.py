"""The hand-packed bytes are what the middleware reads and writes."""

from array import array
from typing import Any

import numpy as np
import pytest
from flexslew_msgs import msg
from rclpy.serialization import deserialize_message, serialize_message

from flexslew_control.controllers.controller import Answer
from flexslew_control.law import Estimate, Reference
from flexslew_control.message_fields import answer_fields, state_bytes
from flexslew_lab.log.messages.cdr import encode
from flexslew_plant.bench.records import Truth
from flexslew_plant.bench.wire import (
    Stamp,
    command_bytes,
    command_from,
    measurement_bytes,
    measurement_from,
    truth_bytes,
)
from flexslew_plant.measurement import EffortCommand, Measurement
from flexslew_plant.ros.messages import stamp

NAMES = ("", "a", "pd_feedforward", "an_even_longer_name")
ARRAYS = ("joint_position", "joint_velocity", "tip_deflection", "root_curvature", "applied_effort")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("sizes", [(2, 2, 2, 2, 2), (1, 1, 0, 0, 1), (3, 3, 1, 0, 3)])
def test_a_measurement_has_the_bytes_of_the_message(name: Any, sizes: Any) -> None:
    arrays = [np.arange(n) - 0.1 for n in sizes]
    question = Measurement(1234, 5, 12.34, name, *arrays)
    message = msg.Measurement(tick=1234, epoch=5, controller=name)
    message.header.stamp = stamp(12.34)
    for field, values in zip(ARRAYS, arrays, strict=True):
        setattr(message, field, array("d", values))
    data = measurement_bytes(question)
    assert deserialize_message(data, msg.Measurement) == message
    again, at = measurement_from(bytes(serialize_message(message)), 0.01)
    assert again[:4] == (1234, 5, 1234 * 0.01, name)
    assert at == Stamp(12, 340_000_000)
    for values, back in zip(arrays, again[4:], strict=True):
        assert values.tolist() == back.tolist()


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("size", [0, 1, 2, 5])
def test_a_command_has_the_bytes_of_the_message(name: Any, size: int) -> None:
    effort = np.arange(size, dtype=float) * 0.3
    data = command_bytes(EffortCommand(7, 1, name, effort), Stamp(3, 4))
    message = deserialize_message(data, msg.EffortCommand)
    assert (message.tick, message.epoch, message.controller) == (7, 1, name)
    assert list(message.effort) == effort.tolist()
    assert message.instance == 0
    told = command_bytes(EffortCommand(7, 1, name, effort), Stamp(3, 4), 2**63 - 5)
    message = deserialize_message(told, msg.EffortCommand)
    for data in (told, bytes(serialize_message(message))):
        again = command_from(data)
        assert (again[:3], again.instance) == ((7, 1, name), 2**63 - 5)
        assert again.effort.tolist() == effort.tolist()
    before = command_from(told[:-8])  # of a process, or of a log, from before there was the field
    assert (before[:3], before.instance) == ((7, 1, name), 0)
    assert before.effort.tolist() == effort.tolist()


@pytest.mark.parametrize("sizes", [(5, 2, 2, 2), (1, 1, 0, 0), (0, 0, 0, 0), (7, 3, 3, 1)])
def test_a_truth_has_the_bytes_of_the_message(sizes: Any) -> None:
    n, *others = sizes
    arrays = [np.arange(size) + 0.1 * size for size in (n, n, *others)]
    data = truth_bytes(Truth._make((1234, 12.34, 5, *arrays, 0.75)))
    message = deserialize_message(data, msg.PlantState)
    assert (message.header.stamp, message.header.frame_id) == (stamp(12.34), "")
    assert (message.tick, message.epoch, message.energy) == (1234, 5, 0.75)
    for name, values in zip(Truth._fields[3:8], arrays, strict=True):
        assert list(getattr(message, name)) == values.tolist()
    assert data == encode("flexslew_msgs/msg/PlantState", message)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("terms", [(), ("p",), ("feedforward", "proportional", "derivative")])
@pytest.mark.parametrize("joints", [1, 2, 3])
def test_a_controller_state_has_the_bytes_of_the_message(
    name: str, terms: Any, joints: int
) -> None:
    rows = iter(np.random.default_rng(joints).normal(size=(20, joints)))
    reference = Reference(*(next(rows) for _ in Reference._fields))
    estimate = Estimate(next(rows), next(rows), next(rows), np.diag(next(rows)), next(rows), 2.5)
    answer = Answer(
        EffortCommand(1234, 5, name, next(rows)),
        reference,
        estimate,
        {t: next(rows) for t in terms},
        *((np.array([0.5, -0.5, 0.5, 0.5]), np.array([0.0, 0.0, 0.0, 1.0])) if joints == 3 else ()),
    )
    data = state_bytes(answer, Stamp(12, 340_000_000))
    message = deserialize_message(data, msg.ControllerState)
    assert message.header.stamp == stamp(12.34)
    for field, value in answer_fields(answer).items():
        found = getattr(message, field)
        assert (list(found) == value.tolist()) if isinstance(value, np.ndarray) else found == value
    assert data == encode("flexslew_msgs/msg/ControllerState", message)


def test_a_frame_in_the_header_shifts_nothing() -> None:
    message = msg.Measurement(tick=9, controller="x", joint_position=array("d", [1.0]))
    message.header.frame_id = "hub_frame"
    question, _ = measurement_from(bytes(serialize_message(message)), 0.01)
    assert (question.tick, question.controller) == (9, "x")
    assert question.joint_position.tolist() == [1.0]


def test_whatever_bytes_come_they_are_understood_or_refused() -> None:
    rng = np.random.default_rng(1)
    question = Measurement(1234, 5, 12.34, "pd_feedforward", *[np.array([-0.1, 0.9])] * len(ARRAYS))
    command = EffortCommand(7, 1, "pd_feedforward", np.array([0.3, 0.6]))
    asked, answered = measurement_bytes(question), command_bytes(command, Stamp(3, 4))
    refused = 0
    for _ in range(2000):
        damaged = bytearray(asked if rng.random() < 0.5 else answered)
        for at in rng.integers(0, len(damaged), rng.integers(1, 9)):
            damaged[at] = (0, 255, int(rng.integers(256)))[rng.integers(3)]
        data = bytes(damaged[: rng.integers(len(damaged) + 1)] if rng.random() < 0.3 else damaged)
        for understand in (command_from, lambda data: measurement_from(data, 0.01)):
            try:
                understand(data)
            except ValueError:
                refused += 1
        again, _ = measurement_from(asked, 0.01)  # whose size was that of the damaged one
        assert again[:4] == (1234, 5, 1234 * 0.01, "pd_feedforward")
        assert again.applied_effort.tolist() == question.applied_effort.tolist()
    assert refused > 1000


def test_numbers_in_the_other_order_are_refused() -> None:
    data = command_bytes(EffortCommand(7, 1, "a", np.zeros(2)), Stamp(3, 4))
    with pytest.raises(ValueError, match="EffortCommand in little-endian CDR"):
        command_from(b"\x00\x00" + data[2:])
