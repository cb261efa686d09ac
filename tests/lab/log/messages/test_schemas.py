"""Definitions and hashes as ROS 2 has them, and stamps."""

import pytest
from mcap_ros2._dynamic import generate_dynamic

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.messages import cdr
from flexslew_lab.log.messages.schemas import hash_of_schema, schema_text, type_hash
from flexslew_plant.errors import BadInput
from flexslew_plant.message_codec import HEAD
from flexslew_plant.message_types import SEPARATOR, definition

TYPES = sorted({topic.type for topic in TOPICS.values()})
ROS_HASHES = {  # as the generators of ROS 2 Kilted print them
    "std_msgs/msg/Header": (
        "RIHS01_f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01"
    ),
    "builtin_interfaces/msg/Time": (
        "RIHS01_b106235e25a4c5ed35098aa0a61a3ee9c9b18d197f398b0e4206cea9acf9c197"
    ),
}


def test_our_schemas_keep_the_comments_of_their_authors() -> None:
    text = schema_text("flexslew_msgs/msg/Measurement")
    assert "# encoders, one per joint in the order of Testbed.joint_names [rad or m]" in text


def test_nested_definitions_follow_behind_separators() -> None:
    parts = schema_text("flexslew_msgs/msg/PlantState").split(f"\n{SEPARATOR}\n")
    assert [part.splitlines()[0] for part in parts[1:]] == [
        "MSG: std_msgs/Header",
        "MSG: builtin_interfaces/Time",
    ]


@pytest.mark.parametrize(("name", "expected"), ROS_HASHES.items())
def test_type_hashes_are_those_of_ros(name: str, expected: str) -> None:
    assert type_hash(name) == expected


@pytest.mark.parametrize("name", TYPES)
def test_the_schema_alone_gives_the_same_hash(name: str) -> None:
    assert hash_of_schema(name, schema_text(name)) == type_hash(name)


@pytest.mark.parametrize("name", TYPES)
def test_the_mcap_decoder_of_ros2_reads_the_schema(name: str) -> None:
    assert name in generate_dynamic(name, schema_text(name))


def test_a_field_of_another_kind_is_refused_in_one_line() -> None:
    with pytest.raises(BadInput, match="flexslew_msgs/msg/EffortCommand: this does not fit"):
        cdr.encode("flexslew_msgs/msg/EffortCommand", {"tick": "seven"})


def test_an_unknown_type_is_named() -> None:
    with pytest.raises(BadInput, match="no definition of nobody_msgs/msg/Nothing"):
        definition("nobody_msgs/msg/Nothing")


@pytest.mark.parametrize(
    ("name", "message", "expected"),
    [
        ("flexslew_msgs/msg/PlantState", {"header": {"stamp": 1_500_000_007}}, 1_500_000_007),
        ("flexslew_msgs/msg/Event", {"stamp": 2_000_000_001}, 2_000_000_001),
        ("rosgraph_msgs/msg/Clock", {"clock": 3_000_000_002}, 3_000_000_002),
        ("rcl_interfaces/msg/Log", {"stamp": 10**18}, 42),
        ("std_msgs/msg/String", {"data": "robot"}, 42),
    ],
)
def test_stamps_are_read_without_decoding(name: str, message: object, expected: int) -> None:
    assert cdr.stamp_of(name, cdr.encode(name, message), 42) == expected


@pytest.mark.parametrize("name", ["tf2_msgs/msg/TFMessage", "visualization_msgs/msg/MarkerArray"])
def test_the_stamp_of_a_sequence_is_that_of_its_first_message(name: str) -> None:
    time = cdr.encode("builtin_interfaces/msg/Time", 3_000_000_005)[len(HEAD) :]
    assert cdr.stamp_of(name, HEAD + b"\x01\x00\x00\x00" + time, 42) == 3_000_000_005
    assert cdr.stamp_of(name, HEAD + bytes(4), 42) == 42
