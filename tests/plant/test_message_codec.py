"""Every type is packed and read as the reference serialiser does, and nothing else is taken."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from flexslew_lab.log.bag_columns import blocks_of
from flexslew_lab.log.files.mcap_scan import RawMessage
from flexslew_lab.log.messages.cdr import decode, encode
from flexslew_lab.log.messages.schemas import store
from flexslew_lab.log.recording.recording_order import of_namespace
from flexslew_plant.errors import BadInput
from flexslew_plant.graph.topics import TOPICS
from flexslew_plant.message_codec import layout_of, leading
from flexslew_plant.message_types import Field, fields, leaves

TF, TRANSFORM = "tf2_msgs/msg/TFMessage", "geometry_msgs/msg/TransformStamped"
TYPES = sorted({topic.type for topic in TOPICS.values()})
FLAT = [name for name in TYPES if all(not f.nested or not f.array for f in fields(name))]
MEASUREMENT = "flexslew_msgs/msg/Measurement"
LETTERS = list("abc_äß ")


def drawn(kind: str, rng: np.random.Generator, texts: int = 9) -> dict[str, Any]:
    """Return a random message, with texts of at most so many letters."""

    def one(field: Field) -> Any:
        if field.nested:
            return drawn(field.nested, rng, texts)
        if field.code == "s":
            return "".join(rng.choice(LETTERS, rng.integers(texts + 1)))
        if field.code in "df":
            return float(rng.integers(-99, 99)) / 8.0
        return bool(rng.integers(2)) if field.code == "?" else int(rng.integers(127))

    return {
        field.name: [one(field) for _ in range(field.fixed or rng.integers(5))]
        if field.array
        else one(field)
        for field in fields(kind)
    }


def transforms(*parts: dict[str, Any]) -> bytes:
    """Return these as one message."""
    decoded = [decode(TRANSFORM, encode(TRANSFORM, part)) for part in parts]
    return bytes(store().serialize_cdr(store().types[TF](decoded), TF))


def assert_equal(expected: Any, found: Any) -> None:
    if isinstance(expected, dict):
        for name, value in expected.items():
            assert_equal(value, getattr(found, name))
    else:
        assert (list(found) if isinstance(expected, list) else found) == expected


@pytest.mark.parametrize("kind", FLAT)
def test_bytes_and_columns_are_those_of_the_reference_serialiser(kind: str) -> None:
    rng = np.random.default_rng(7)
    for message in ({}, *(drawn(kind, rng) for _ in range(50))):
        data = encode(kind, message)
        decoded = decode(kind, data)
        assert_equal(message, decoded)
        assert bytes(store().serialize_cdr(decoded, kind)) == data
        (block,) = blocks_of("topic", kind, [RawMessage(0, 0, 0, data)])
        for name, column in block.columns.items():
            value: Any = decoded
            for part in name.split("."):
                value = getattr(value, part)
            assert np.array_equal(column[0], value), name


def test_leading_fields_are_read_without_the_others() -> None:
    rng = np.random.default_rng(7)
    for kind in (MEASUREMENT, "flexslew_msgs/msg/EffortCommand", "flexslew_msgs/msg/Event"):
        message = drawn(kind, rng) | {"header": {"frame_id": ""}}
        found = leading(kind, "tick", "epoch").unpack_from(encode(kind, message))
        assert found == (message["tick"], message["epoch"])


def test_transforms_belong_to_the_namespace_of_their_frames() -> None:
    rng = np.random.default_rng(7)
    for _ in range(20):
        frames = rng.choice(["base", "hub", "b/base", "b/hub", "c/d/hub"], rng.integers(1, 4))
        message = drawn(TRANSFORM, rng)
        parts = [message | {"child_frame_id": str(frame)} for frame in frames]
        whole = transforms(*parts)
        places = {"/" + str(frame).rpartition("/")[0] for frame in frames}
        for namespace in ("/", "/b", "/c/d"):
            assert of_namespace(whole, namespace) == (places == {namespace})
        with pytest.raises(BadInput, match="no TFMessage"):
            of_namespace(whole[:-3], "/")


def test_a_sequence_of_messages_has_no_columns() -> None:
    with pytest.raises(BadInput, match=f"{TF}: transforms is a sequence of geometry_msgs"):
        leaves(TF)


def test_whatever_bytes_come_their_sizes_fit_or_they_are_refused() -> None:
    rng = np.random.default_rng(1)
    messages = [encode(MEASUREMENT, drawn(MEASUREMENT, rng, texts=2)) for _ in range(40)]
    refused = 0
    for _ in range(1000):
        damaged = bytearray(messages[rng.integers(len(messages))])
        for at in rng.integers(0, len(damaged), rng.integers(9)):
            damaged[at] = (0, 255, int(rng.integers(256)))[rng.integers(3)]
        data = bytes(damaged[: rng.integers(len(damaged) + 1)] if rng.random() < 0.3 else damaged)
        try:
            layout = layout_of(MEASUREMENT, data)
        except BadInput:
            refused += 1
            continue
        assert layout.items[-1].end <= len(data)
        for size, item in pairwise(layout.items):
            if size.code in "#[":
                assert int.from_bytes(data[size.at : size.end], "little") == item.length
    assert refused > 300
