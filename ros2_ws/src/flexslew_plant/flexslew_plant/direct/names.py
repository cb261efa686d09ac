"""Where the plant and the recorder of a bench listen, and whether direct lines are used at all."""

import os
from collections.abc import Mapping
from hashlib import sha256

from flexslew_plant.errors import BadInput

SETTING = "FLEXSLEW_TRANSPORT"  # environment variable
AUTO, DDS = "auto", "dds"
RECORDER = "recorder"  # in place of a topic, which begins with a slash
SOCKET = "socket"  # the transport of direct lines


def direct(environment: Mapping[str, str]) -> bool:
    """Return whether question and answer take a direct line where there is one.

    Raises:
        BadInput: FLEXSLEW_TRANSPORT is neither auto nor dds.
    """
    value = environment.get(SETTING, "") or AUTO
    if value not in (AUTO, DDS):
        words = f"{AUTO} (direct lines on this machine) or {DDS} (DDS alone)"
        raise BadInput(words, key=SETTING, value=value)
    return value == AUTO


def address(domain: int, measurement_topic: str, command_topic: str) -> bytes:
    """Return the name of the plant's socket, which is on no disk (unix(7), abstract).

    Args:
        domain: ROS_DOMAIN_ID.
        measurement_topic: absolute name of the topic of measurements, with namespace and
            remappings.
        command_topic: the same of commands; RECORDER: the name of the recorder's socket instead.
    """
    bench = f"{os.getuid()} {domain} {measurement_topic} {command_topic}"
    return b"\0flexslew/" + sha256(bench.encode()).hexdigest()[:32].encode()
