"""What rosbags and mcap-ros2-support read in a bag that came over ROS 2, on every topic."""

import json
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.checks.check import check_log
from flexslew_lab.log.messages.cdr import decode
from flexslew_lab.log.messages.schemas import store
from flexslew_plant.graph import topics

from .flight import Flight, slew

PYMCAP = Path(sys.executable).with_name("pymcap-cli")


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Any:
    return Flight(slew(duration=3.0), tmp_path_factory.mktemp("flight")).bag


@pytest.mark.slow
def test_nothing_is_lost_in_the_log(bag: Any) -> None:
    assert [finding for finding in check_log(bag) if not finding.ok] == []


def test_every_topic_is_recorded(bag: Any) -> None:
    of_free_platforms = {f"/{name}" for name in (topics.IMU, topics.ODOMETRY, topics.WRENCH)}
    assert {*BagReader(bag).overview.counts} == {*TOPICS} - of_free_platforms


def test_rosbags_reads_every_message_as_we_do(bag: Any) -> None:
    by_bag = get_typestore(Stores.EMPTY)  # the definitions of the bag
    read: Counter[str] = Counter()
    with Reader(bag) as reader:
        for connection in reader.connections:
            by_bag.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
        for connection, _, data in reader.messages():
            kind = connection.msgtype
            # written again, as the recorded bytes have noise as padding
            theirs = by_bag.serialize_cdr(by_bag.deserialize_cdr(data, kind), kind)
            assert theirs == store().serialize_cdr(decode(kind, data), kind), connection.topic
            read[connection.topic] += 1
    assert read == Counter(m.topic for m in BagReader(bag).messages())


def test_mcap_decodes_every_message(bag: Any) -> None:
    with next(bag.glob("*.mcap")).open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        decoded = [(channel.topic, ros) for _, channel, _, ros in reader.iter_decoded_messages()]
    recorded = Counter(m.topic for m in BagReader(bag).messages())
    assert Counter(topic for topic, _ in decoded) == recorded
    frames, still = (
        {t.child_frame_id for topic, ros in decoded if topic == name for t in ros.transforms}
        for name in ("/tf", "/tf_static")
    )
    spaces = {m.ns for topic, ros in decoded if topic == "/markers" for m in ros.markers}
    (robot,) = [ros.data for topic, ros in decoded if topic == "/robot_description"]
    joints = [ros for topic, ros in decoded if topic == "/joint_states"]
    assert frames == {"base", "hub"}
    assert still == {"beam_positive", "beam_negative"}
    assert all(f'<link name="{frame}"' in robot for frame in frames | still)
    assert spaces
    assert all(list(ros.name) == ["base_yaw", "hub_pitch"] for ros in joints)


@pytest.mark.skipif(
    not PYMCAP.exists(),
    reason="no pymcap-cli, a tool under the GPL: .ci/tools installs it with others for development",
)
def test_pymcap_finds_no_fault(bag: Any) -> None:
    doctor = [PYMCAP, "doctor", "--format", "jsonl"]
    lines = subprocess.run(
        [*map(str, doctor), str(next(bag.glob("*.mcap")))],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    summary = json.loads(lines.splitlines()[-1])
    assert (summary["errors"], summary["warnings"], summary["complete"]) == (0, 0, True)
