"""metadata.yaml and the QoS texts, as rosbag2 (version 9) reads them."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from flexslew_lab.log.bag_layout import qos_profile
from flexslew_lab.log.files.whole_file import write_whole
from flexslew_lab.log.messages.schemas import type_hash
from flexslew_plant.yaml_data import yaml_text


class TopicCount(NamedTuple):
    """A topic and how many messages of it there are."""

    topic: str
    type: str
    messages: int


def information(
    file: str, start: int, end: int, topics: Iterable[TopicCount], distribution: str
) -> dict[str, Any]:
    """Return the content of a bag's rosbag2 metadata file.

    Args:
        file: name of the .mcap file.
        start: first log time [ns].
        end: last log time [ns].
        topics: all topics, with their counts.
        distribution: ROS distribution.
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
    write_whole(path, yaml_text({"rosbag2_bagfile_information": content}, False))
