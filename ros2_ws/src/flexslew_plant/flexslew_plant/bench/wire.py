"""The messages of every tick as the CDR bytes that go over DDS, without message objects.

They are the bench's hot path; building and copying message objects costs about as much as
everything else between two ticks. The layout is that of flexslew_msgs in
little-endian CDR: alignment counts from behind the four bytes of encapsulation.
"""

from collections.abc import Iterable
from functools import lru_cache
from struct import Struct
from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import NOTHING, Vector
from flexslew_plant.bench.records import Truth
from flexslew_plant.measurement import EffortCommand, Measurement

HEAD = b"\x00\x01\x00\x00"  # encapsulation
_LENGTH = Struct("<I")
_QUESTION = Struct("<iII")  # stamp, length of frame_id
_TICK = Struct("<QII")  # tick, epoch, length of controller
_ANSWER = Struct("<iIQII")  # stamp, tick, epoch, length of controller


class Stamp(NamedTuple):
    """Simulated time of a message."""

    sec: int
    nanosec: int


def stamp_of(seconds: float) -> Stamp:
    """Return simulated seconds as a stamp."""
    return Stamp(*divmod(round(seconds * 1e9), 1_000_000_000))


@lru_cache(maxsize=256)
def _layout(head: str, at: int, parts: tuple[int | str, ...]) -> Struct:
    """Return the layout of a message.

    Args:
        head: its first fields, in the terms of `struct`.
        at: where they end [bytes].
        parts: of each further field the number of its doubles, as a sequence; or "d", one double;
            "I", the length of a sequence of strings; "12s", a string of 12 bytes.
    """
    layout = [head]

    def put(size: int, code: str, count: int = 1) -> None:
        nonlocal at
        pad = -at % size
        layout.append(f"{pad}x{code}")
        at += pad + size * count

    for part in parts:
        if part == "d":
            put(8, "d")
            continue
        put(4, "I")
        if isinstance(part, int) and part:
            put(8, f"{part}d", part)
        elif isinstance(part, str) and part != "I":
            put(1, part, int(part[:-1]))
    return Struct("".join(layout))


def stamped_bytes(at: Stamp, tick: int, epoch: int, fields: Iterable[object]) -> bytes:
    """Return a message that begins with header, tick and epoch as it goes over DDS.

    Args:
        at: its stamp.
        tick: of the message.
        epoch: of the message.
        fields: the others, in order: vectors, strings, lists of strings or floats.
    """
    parts: list[int | str] = []
    values: list[object] = [HEAD, *at, 1, b"\x00", tick, epoch]

    def text(word: str) -> None:
        data = word.encode() + b"\x00"
        parts.append(f"{len(data)}s")
        values.extend((len(data), data))

    for field in fields:
        if isinstance(field, np.ndarray):
            numbers = field.tolist()
            parts.append(len(numbers))
            values.append(len(numbers))
            values += numbers
        elif isinstance(field, str):
            text(field)
        elif isinstance(field, list):
            parts.append("I")
            values.append(len(field))
            for word in field:
                text(word)
        else:
            parts.append("d")
            values.append(field)
    return _layout("<4siIIc3xQI", 28, tuple(parts)).pack(*values)


def measurement_bytes(m: Measurement) -> bytes:
    """Return the question as it goes over DDS."""
    return stamped_bytes(stamp_of(m.time), m.tick, m.epoch, m[3:])


def truth_bytes(truth: Truth) -> bytes:
    """Return flexslew_msgs/PlantState as it goes over DDS."""
    tick, time, epoch, *fields = truth
    return stamped_bytes(stamp_of(time), tick, epoch, fields)


def measurement_from(data: bytes, period: float) -> tuple[Measurement, Stamp]:
    """Return the question and its stamp; its time is that of the tick to the last bit."""
    data = data[4:]  # where its numbers are aligned
    sec, nanosec, frame = _QUESTION.unpack_from(data)
    at = 12 + frame
    at += -at % 8
    tick, epoch, length = _TICK.unpack_from(data, at)
    at += 16
    name = data[at : at + length - 1].decode()
    at += length
    arrays = []
    for _ in range(5):
        array, at = _array(data, at)
        arrays.append(array)
    return Measurement(tick, epoch, tick * period, name, *arrays), Stamp(sec, nanosec)


def command_bytes(command: EffortCommand, at: Stamp) -> bytes:
    """Return the answer as it goes over DDS, with the stamp of its question."""
    name = command.controller.encode() + b"\x00"
    effort = command.effort.tolist()
    layout = _layout("<4siIQI", 20, (f"{len(name)}s", len(effort)))
    tick, epoch = command.tick, command.epoch
    return layout.pack(HEAD, *at, tick, epoch, len(name), name, len(effort), *effort)


def command_from(data: bytes) -> EffortCommand:
    """Return the answer."""
    data = data[4:]
    _, _, tick, epoch, length = _ANSWER.unpack_from(data)
    name = data[24 : 24 + length - 1].decode()
    effort, _ = _array(data, 24 + length)
    return EffortCommand(tick, epoch, name, effort)


def _array(data: bytes, at: int) -> tuple[Vector, int]:
    """Return the sequence of doubles at `at`, which may only be read, and where it ends."""
    at += -at % 4
    (count,) = _LENGTH.unpack_from(data, at)
    at += 4
    if not count:
        return NOTHING, at
    at += -at % 8
    return np.frombuffer(data, np.float64, count, at), at + 8 * count
