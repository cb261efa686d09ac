"""What every bag of this project has in common: topics, their types and QoS, metadata records."""

import hashlib
from collections.abc import Mapping
from typing import NamedTuple

FORMAT = "1"  # of the metadata records; another one is another version of the project
TRIAL_RECORD = "flexslew"  # metadata record at the start: trial, trial_file, versions, ...
RUN_RECORD = "flexslew_run"  # metadata record at the end: wall_time, exit_code, ...
ROSBAG_RECORD = "rosbag2"
METADATA_FILE = "metadata.yaml"
MAGIC = b"\x89MCAP0\r\n"


class Topic(NamedTuple):
    """A topic as the bag knows it."""

    type: str
    latched: bool = False
    depth: int = 10


TOPICS: dict[str, Topic] = {
    "/measurement": Topic("flexslew_msgs/msg/Measurement", depth=1000),
    "/effort_command": Topic("flexslew_msgs/msg/EffortCommand"),
    "/truth": Topic("flexslew_msgs/msg/PlantState", depth=1000),
    "/controller_state": Topic("flexslew_msgs/msg/ControllerState", depth=1000),
    "/controller_status": Topic("flexslew_msgs/msg/ControllerStatus", latched=True, depth=1),
    "/plan": Topic("flexslew_msgs/msg/Plan", latched=True, depth=1),
    "/testbed": Topic("flexslew_msgs/msg/Testbed", latched=True, depth=1),
    "/events": Topic("flexslew_msgs/msg/Event", latched=True, depth=1000),
    "/joint_states": Topic("sensor_msgs/msg/JointState"),
    "/appendage_states": Topic("flexslew_msgs/msg/AppendageState"),
    "/tf": Topic("tf2_msgs/msg/TFMessage", depth=100),
    "/tf_static": Topic("tf2_msgs/msg/TFMessage", latched=True, depth=1),
    "/robot_description": Topic("std_msgs/msg/String", latched=True, depth=1),
    "/markers": Topic("visualization_msgs/msg/MarkerArray"),
    "/clock": Topic("rosgraph_msgs/msg/Clock"),
    "/rosout": Topic("rcl_interfaces/msg/Log", latched=True, depth=1000),
}

_FOREVER = {"sec": 9223372036, "nsec": 854775807}


def qos_profile(topic: str) -> dict[str, object]:
    """Return the offered QoS of a topic as rosbag2 (version 9) writes it."""
    known = TOPICS.get(topic, Topic(""))
    return {
        "history": "keep_last",
        "depth": known.depth,
        "reliability": "reliable",
        "durability": "transient_local" if known.latched else "volatile",
        "deadline": dict(_FOREVER),
        "lifespan": dict(_FOREVER),
        "liveliness": "automatic",
        "liveliness_lease_duration": dict(_FOREVER),
        "avoid_ros_namespace_conventions": False,
    }


def sealed(data: Mapping[str, str]) -> dict[str, str]:
    """Return a metadata record with its format and checksum, which MCAP itself does not give."""
    record = {"format": FORMAT, **{key: str(value) for key, value in data.items()}}
    return {**record, "checksum": checksum(record)}


def checksum(data: Mapping[str, str]) -> str:
    """Return the SHA-256 over all entries but the checksum itself."""
    digest = hashlib.sha256()
    for key in sorted(data):
        if key != "checksum":
            for part in (key, data[key]):
                raw = part.encode()
                digest.update(len(raw).to_bytes(8, "little") + raw)
    return digest.hexdigest()
