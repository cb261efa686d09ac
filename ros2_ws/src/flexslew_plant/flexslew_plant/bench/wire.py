"""The messages of every tick as the CDR bytes that go over DDS, without message objects.

They are the bench's hot path; building and copying message objects costs about as much as
everything else between two ticks.
"""

from typing import NamedTuple

import numpy as np

from flexslew_plant.bench.records import Truth
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import EffortCommand, Measurement
from flexslew_plant.message_codec import layout_of, packer

_MEASUREMENT, _COMMAND = "flexslew_msgs/msg/Measurement", "flexslew_msgs/msg/EffortCommand"
_FRAME = ""  # of a header


class Stamp(NamedTuple):
    """Simulated time of a message."""

    sec: int
    nanosec: int


def stamp_of(seconds: float) -> Stamp:
    """Return simulated seconds as a stamp."""
    return Stamp(*divmod(round(seconds * 1e9), 1_000_000_000))


def measurement_bytes(m: Measurement) -> bytes:
    """Return the question as it goes over DDS."""
    tick, epoch, time, *fields = m
    return packer(_MEASUREMENT)(*stamp_of(time), _FRAME, tick, epoch, *fields)


def truth_bytes(truth: Truth) -> bytes:
    """Return flexslew_msgs/PlantState as it goes over DDS."""
    tick, time, epoch, *fields = truth
    return packer("flexslew_msgs/msg/PlantState")(*stamp_of(time), _FRAME, tick, epoch, *fields)


def measurement_from(data: bytes, period: float) -> tuple[Measurement, Stamp]:
    """Return the question and its stamp; its time is that of the tick to the last bit.

    Raises:
        BadInput: these bytes are none.
    """
    layout = layout_of(_MEASUREMENT, data)
    sec, nanosec, tick, epoch, *vectors = layout.numbers.unpack_from(data)
    name, numbers = layout.texts[1], map(np.frombuffer, vectors)
    return Measurement(tick, epoch, tick * period, name, *numbers), Stamp(sec, nanosec)


def command_bytes(command: EffortCommand, at: Stamp, instance: int = 0) -> bytes:
    """Return the answer as it goes over DDS.

    Args:
        command: the answer.
        at: stamp of its question.
        instance: instance of the process that answers; 0: not given.
    """
    return packer(_COMMAND)(*at, *command[:4], instance)


def command_from(data: bytes) -> EffortCommand:
    """Return the answer, with a read-only effort; its last field may be missing.

    Raises:
        BadInput: these bytes are none.
    """
    try:
        layout = layout_of(_COMMAND, data)
    except BadInput:
        layout = layout_of(_COMMAND, data, 1)
        if layout.items[-1].end != len(data):
            raise
    _, _, tick, epoch, effort, *instance = layout.numbers.unpack_from(data)
    return EffortCommand(tick, epoch, layout.texts[0], np.frombuffer(effort), *instance)
