"""Measurement and EffortCommand as the CDR bytes that go over DDS, without message objects.

The two messages of every tick are the bench's hot path; building and copying message objects costs
about as much as everything else between two ticks. The layout is that of flexslew_msgs in
little-endian CDR: alignment counts from behind the four bytes of encapsulation.
"""

from functools import lru_cache
from struct import Struct
from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.bench.measurement import EffortCommand, Measurement

_HEAD = b"\x00\x01\x00\x00"
_LENGTH = Struct("<I")
_QUESTION = Struct("<4xiII")  # stamp, length of frame_id
_TICK = Struct("<QII")  # tick, epoch, length of controller
_ANSWER = Struct("<4xiIQII")  # stamp, tick, epoch, length of controller


class Stamp(NamedTuple):
    """Simulated time of a message."""

    sec: int
    nanosec: int


def stamp_of(seconds: float) -> Stamp:
    """Return simulated seconds as a stamp."""
    return Stamp(*divmod(round(seconds * 1e9), 1_000_000_000))


@lru_cache(maxsize=64)
def _format(head: str, at: int, name: int, counts: tuple[int, ...]) -> Struct:
    """Return the layout of a message whose head ends at `at`, before its name and its arrays."""
    parts = [head, f"{name}s"]
    at += name
    for count in counts:
        pad = -at % 4
        parts.append(f"{pad}xI")
        at += pad + 4
        if count:
            pad = -at % 8
            parts.append(f"{pad}x{count}d")
            at += pad + 8 * count
    return Struct("".join(parts))


def measurement_bytes(m: Measurement) -> bytes:
    """Return the question as it goes over DDS."""
    name = m.controller.encode() + b"\x00"
    arrays = [array.tolist() for array in m[4:]]
    layout = _format("<4siIIc3xQII", 32, len(name), tuple(map(len, arrays)))
    values: list[object] = [_HEAD, *stamp_of(m.time), 1, b"\x00", m.tick, m.epoch, len(name), name]
    for array in arrays:
        values.append(len(array))
        values += array
    return layout.pack(*values)


def measurement_from(data: bytes, period: float) -> tuple[Measurement, Stamp]:
    """Return the question and its stamp; its time is that of the tick to the last bit."""
    sec, nanosec, frame = _QUESTION.unpack_from(data)
    at = 16 + frame
    at += -(at - 4) % 8
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
    layout = _format("<4siIQII", 24, len(name), (len(effort),))
    tick, epoch = command.tick, command.epoch
    return layout.pack(_HEAD, *at, tick, epoch, len(name), name, len(effort), *effort)


def command_from(data: bytes) -> EffortCommand:
    """Return the answer."""
    _, _, tick, epoch, length = _ANSWER.unpack_from(data)
    name = data[28 : 28 + length - 1].decode()
    effort, _ = _array(data, 28 + length)
    return EffortCommand(tick, epoch, name, effort)


def _array(data: bytes, at: int) -> tuple[Vector, int]:
    """Return the sequence of doubles at `at` and where it ends."""
    at += -(at - 4) % 4
    (count,) = _LENGTH.unpack_from(data, at)
    at += 4
    if not count:
        return np.empty(0), at
    at += -(at - 4) % 8
    return np.frombuffer(data, np.float64, count, at), at + 8 * count
