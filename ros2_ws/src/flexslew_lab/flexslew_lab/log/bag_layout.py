"""What every bag of this project has in common: topics, their types and QoS, metadata records."""

import hashlib
from collections.abc import Mapping

from flexslew_plant.graph import topics
from flexslew_plant.graph.topics import Topic

FORMAT = "1"  # of the metadata records; another one is another version of the project
TRIAL_RECORD = "flexslew"  # metadata record at the start: trial, trial_file, versions, ...
RUN_RECORD = "flexslew_run"  # metadata record at the end: wall_time, exit_code, ...
ROSBAG_RECORD = "rosbag2"
METADATA_FILE = "metadata.yaml"
MAGIC = b"\x89MCAP0\r\n"


# Absolute names, as a bench without a namespace has them: a bag does not know where it was flown.
TOPICS: dict[str, Topic] = {
    "/" + name.lstrip("/"): topic
    for name, topic in topics.TOPICS.items()
    if name not in topics.NOT_RECORDED
}

_INFINITE_DURATION = {"sec": 9223372036, "nsec": 854775807}


def qos_profile(topic: str) -> dict[str, object]:
    """Return the offered QoS of a topic as rosbag2 (version 9) writes it."""
    known = TOPICS.get(topic, Topic(topic, "", 10))
    return {
        "history": "keep_last",
        "depth": known.depth,
        "reliability": "reliable" if known.reliable else "best_effort",
        "durability": "transient_local" if known.latched else "volatile",
        "deadline": dict(_INFINITE_DURATION),
        "lifespan": dict(_INFINITE_DURATION),
        "liveliness": "automatic",
        "liveliness_lease_duration": dict(_INFINITE_DURATION),
        "avoid_ros_namespace_conventions": False,
    }


def with_checksum(data: Mapping[str, str]) -> dict[str, str]:
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
