"""What changed a run, as data: the same in process, on the topic and in the log."""

from enum import IntEnum
from typing import Any, NamedTuple


class Level(IntEnum):
    """How bad it is; the numbers are those of flexslew_msgs/Event."""

    INFO = 0
    WARNING = 1
    FAULT = 2


class Event(NamedTuple):
    """Something that took effect at a tick."""

    tick: int
    time: float  # simulated [s]
    epoch: int
    level: Level
    source: str  # the node
    kind: str  # started, switched, missed, rejected, fallback, brake, disturbance, finished, ...
    message: str  # one line for a person
    data: dict[str, Any]  # the same for a program
