"""metadata.yaml and the QoS texts, as rosbag2 (version 9) reads them."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from flexslew_lab.bag_layout import qos_profile
from flexslew_lab.schemas import type_hash


class TopicCount(NamedTuple):
    """A topic and how many messages of it there are."""

    topic: str
    type: str
    messages: int


class _Plain(yaml.SafeDumper):
    """YAML without anchors, which rosbag2's reader does not know."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def plain_yaml(data: Any) -> str:
    """Return data as YAML without anchors."""
    return str(yaml.dump(data, Dumper=_Plain, sort_keys=False, default_flow_style=False))


def information(
    file: str, start: int, end: int, topics: Iterable[TopicCount], distribution: str
) -> dict[str, Any]:
    """Return what rosbag2 wants to know about a bag.

    Args:
        file: name of the .mcap file.
        start: first log time [ns].
        end: last log time [ns].
        topics: all of them.
        distribution: of ROS.
    """
    topics = list(topics)
    messages = sum(t.messages for t in topics)
    duration = {"nanoseconds": max(end - start, 0)}
    starting = {"nanoseconds_since_epoch": start}
    return {
        "version": 9,
        "storage_identifier": "mcap",
        "duration": duration,
        "starting_time": starting,
        "message_count": messages,
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": t.topic,
                    "type": t.type,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": [qos_profile(t.topic)],
                    "type_description_hash": type_hash(t.type),
                },
                "message_count": t.messages,
            }
            for t in topics
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file],
        "files": [
            {
                "path": file,
                "starting_time": starting,
                "duration": duration,
                "message_count": messages,
            }
        ],
        "custom_data": None,
        "ros_distro": distribution,
    }


def write_description(path: Path, content: dict[str, Any]) -> None:
    """Write metadata.yaml such that it is there whole or not at all."""
    draft = path.with_suffix(".tmp")
    draft.write_text(plain_yaml({"rosbag2_bagfile_information": content}), encoding="utf-8")
    draft.replace(path)
