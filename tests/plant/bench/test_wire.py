"""The messages of every tick carry the records of the bench."""

from typing import Any

import numpy as np
import pytest

from flexslew_control.controllers.controller import Answer
from flexslew_control.law import Estimate, Reference
from flexslew_control.message_fields import answer_fields, state_bytes
from flexslew_lab.log.messages.cdr import decode, encode
from flexslew_plant.bench.records import Truth
from flexslew_plant.bench.wire import (
    Stamp,
    command_bytes,
    command_from,
    measurement_bytes,
    measurement_from,
    truth_bytes,
)
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import EffortCommand, Measurement

NAMES = ("", "a", "pd_feedforward", "an_even_longer_name")
STAMP = Stamp(12, 340_000_000)


def assert_carries(kind: str, data: bytes, **expected: Any) -> None:
    found = decode(f"flexslew_msgs/msg/{kind}", data)
    stamp = found.header.stamp if hasattr(found, "header") else found.stamp
    assert (stamp.sec, stamp.nanosec) == STAMP
    for name, value in expected.items():
        assert np.array_equal(getattr(found, name), value), name


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("sizes", [(2, 2, 2, 2, 2), (1, 1, 0, 0, 1), (3, 3, 1, 0, 3)])
def test_a_measurement_is_sent_and_received(name: str, sizes: tuple[int, ...]) -> None:
    question = Measurement(1234, 5, 12.34, name, *(np.arange(n, dtype=float) - 0.1 for n in sizes))
    data = measurement_bytes(question)
    fields = question._asdict()
    del fields["time"]
    assert_carries("Measurement", data, **fields)
    again, at = measurement_from(data, 0.01)
    assert (again[:4], at) == ((1234, 5, 1234 * 0.01, name), STAMP)
    for sent, received in zip(question[4:], again[4:], strict=True):
        assert np.array_equal(sent, received)
        assert not received.flags.writeable


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("size", [0, 1, 2, 5])
def test_a_command_is_sent_and_received_also_without_its_last_field(name: str, size: int) -> None:
    command = EffortCommand(7, 1, name, np.arange(size, dtype=float) * 0.3, 2**63 - 5)
    data = command_bytes(command, STAMP, command.instance)
    assert_carries("EffortCommand", data, **command._asdict())
    older = [(data[:-8], 0)] if size else []  # of a process from before there was the field
    for coded, instance in [(data, command.instance), *older]:
        again = command_from(coded)
        assert (again[:3], again.instance) == (command[:3], instance)
        assert np.array_equal(again.effort, command.effort)
        assert not again.effort.flags.writeable


@pytest.mark.parametrize("sizes", [(5, 5, 2, 2, 2), (1, 1, 1, 0, 0), (0, 0, 0, 0, 0)])
def test_a_truth_is_sent(sizes: tuple[int, ...]) -> None:
    truth = Truth._make((1234, 12.34, 5, *(np.arange(n) + 0.1 * n for n in sizes), 0.75))
    fields = truth._asdict()
    del fields["time"]
    assert_carries("PlantState", truth_bytes(truth), **fields)


@pytest.mark.parametrize("terms", [(), ("p",), ("feedforward", "proportional", "derivative")])
@pytest.mark.parametrize("joints", [1, 2, 3])
def test_a_controller_state_is_sent(terms: tuple[str, ...], joints: int) -> None:
    rows = iter(np.random.default_rng(joints).normal(size=(20, joints)))
    reference = Reference(*(next(rows) for _ in Reference._fields))
    estimate = Estimate(next(rows), next(rows), next(rows), np.diag(next(rows)), next(rows), 2.5)
    answer = Answer(
        EffortCommand(1234, 5, "pd", next(rows)),
        reference,
        estimate,
        {t: next(rows) for t in terms},
        *((np.array([0.5, -0.5, 0.5, 0.5]), np.array([0.0, 0.0, 0.0, 1.0])) if joints == 3 else ()),
    )
    assert_carries("ControllerState", state_bytes(answer, STAMP), **answer_fields(answer))


def test_a_frame_in_the_header_shifts_nothing() -> None:
    message = {"header": {"frame_id": "hub_frame"}, "tick": 9, "joint_position": [1.0]}
    question, _ = measurement_from(encode("flexslew_msgs/msg/Measurement", message), 0.01)
    assert (question.tick, question.joint_position.tolist()) == (9, [1.0])


def test_numbers_in_the_other_order_are_refused() -> None:
    data = command_bytes(EffortCommand(7, 1, "a", np.zeros(2)), STAMP)
    with pytest.raises(BadInput, match="EffortCommand in little-endian CDR"):
        command_from(b"\x00\x00" + data[2:])
