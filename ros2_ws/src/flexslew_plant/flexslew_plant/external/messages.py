"""The messages between the bench and an external plant, as bytes, for any transport.

A message is a header of 16 bytes and a body. The header is `kind` (uint32), `epoch` (uint32) and
`tick` (uint64); all numbers are little-endian. The body is JSON in UTF-8, a text in UTF-8, or
float64 numbers. docs/external_plant.md is the reference.
"""

import json
from enum import IntEnum
from struct import Struct
from typing import Any, NamedTuple

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.errors import FlexslewError

PROTOCOL = 1  # version of what stands here
HEADER = Struct("<IIQ")  # kind, epoch, tick
LARGEST = 1 << 20  # of a message [B]
_NUMBERS = np.dtype("<f8")


class MessageKind(IntEnum):
    """What a message is."""

    HELLO = 1  # bench: JSON with protocol, period, parameters and initial positions
    DESCRIPTION = 2  # plant: JSON with protocol, joints and tips
    RESET = 3  # bench: return to tick 0 of an epoch; answered by the measurement of tick 0
    EFFORT = 4  # bench: numbers that act from this tick to the next one, one per joint
    MEASUREMENT = 5  # plant: numbers at a tick
    SHUTDOWN = 6  # bench: end the process; without an answer
    ERROR = 7  # plant: text, why it cannot go on
    BRAKE = 8  # bench: stop all motion and hold; answered by the same, empty


class PlantFault(FlexslewError):
    """A plant cannot go on, or has broken the protocol; one line."""


class Message(NamedTuple):
    """A message with its body as bytes."""

    kind: int
    epoch: int
    tick: int
    body: bytes


def encoded(kind: MessageKind, epoch: int = 0, tick: int = 0, body: bytes = b"") -> bytes:
    """Return a message as bytes."""
    return HEADER.pack(kind, epoch, tick) + body


def decoded(data: bytes) -> Message:
    """Return the message that these bytes are.

    Raises:
        PlantFault: they are shorter than a header.
    """
    if len(data) < HEADER.size:
        raise PlantFault(f"a message of {len(data)} bytes; a header has {HEADER.size}")
    kind, epoch, tick = HEADER.unpack_from(data)
    return Message(kind, epoch, tick, data[HEADER.size :])


def number_bytes(numbers: Vector) -> bytes:
    """Return numbers as a body."""
    return np.ascontiguousarray(numbers, dtype=_NUMBERS).tobytes()


def numbers_of(body: bytes, count: int, finite: bool = True) -> Vector:
    """Return the numbers of a body, shape (count,), read-only.

    Args:
        body: of a message.
        count: how many there must be.
        finite: whether each must be finite.

    Raises:
        PlantFault: another number of them, or one that is not finite.
    """
    if len(body) != count * _NUMBERS.itemsize:
        expected = f"{count} numbers are {count * _NUMBERS.itemsize}"
        raise PlantFault(f"a body of {len(body)} bytes; {expected}")
    numbers = np.frombuffer(body, dtype=_NUMBERS)
    if finite and not np.isfinite(numbers).all():
        place = int(np.flatnonzero(~np.isfinite(numbers))[0])
        raise PlantFault(f"number {place} is {numbers[place]}; all must be finite")
    return numbers


def json_bytes(values: dict[str, Any]) -> bytes:
    """Return plain data as a body."""
    return json.dumps(values, allow_nan=False).encode()


def json_of(body: bytes) -> dict[str, Any]:
    """Return the plain data of a body.

    Raises:
        PlantFault: it is no JSON object.
    """
    try:
        values = json.loads(body)
    except (ValueError, RecursionError) as error:
        raise PlantFault(f"a body that is no JSON ({error})") from None
    if not isinstance(values, dict):
        raise PlantFault(f"JSON that is a {type(values).__name__}; an object is needed")
    return values


def text_of(body: bytes) -> str:
    """Return the text of a body; what is no UTF-8 is escaped."""
    return body.decode(errors="backslashreplace")
