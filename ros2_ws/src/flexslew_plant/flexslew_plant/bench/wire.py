"""The messages of every tick as the CDR bytes that go over DDS, without message objects.

They are the bench's hot path; building and copying message objects costs about as much as
everything else between two ticks. The layout is that of flexslew_msgs in
little-endian CDR: alignment counts from behind the four bytes of encapsulation.
"""

from collections.abc import Iterable
from functools import lru_cache
from struct import Struct, error
from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import EMPTY
from flexslew_plant.bench.records import Truth
from flexslew_plant.measurement import EffortCommand, Measurement

HEAD = b"\x00\x01\x00\x00"  # encapsulation
_LENGTH = Struct("<I")
_QUESTION = Struct("<iII")  # stamp, length of frame_id
_TICK = Struct("<QII")  # tick, epoch, length of controller
_HEADER_LAYOUT = "<4siIIc3xQI", 28  # encapsulation, header, tick and epoch, and where they end
_ANSWER = Struct("<iIQII")  # stamp, tick, epoch, length of controller
_INSTANCE = Struct("<Q")


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
            "Q", a whole number; "I", the length of a sequence of strings; "12s", a string of 12
            bytes.
    """
    layout = [head]

    def put(size: int, code: str, count: int = 1) -> None:
        nonlocal at
        pad = -at % size
        layout.append(f"{pad}x{code}")
        at += pad + size * count

    for part in parts:
        if isinstance(part, str) and part in "dQ":
            put(8, part)
            continue
        put(4, "I")
        if isinstance(part, int) and part:
            put(8, f"{part}d", part)
        elif isinstance(part, str) and part != "I":
            put(1, part, int(part[:-1]))
    return Struct("".join(layout))


@lru_cache(maxsize=256)
def _text(word: str) -> tuple[str, int, bytes]:
    """Return a string's place in a layout, its length, and its bytes."""
    data = word.encode() + b"\x00"
    return f"{len(data)}s", len(data), data


def message_bytes(at: Stamp, tick: int, epoch: int, fields: Iterable[object]) -> bytes:
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
        part, length, data = _text(word)
        parts.append(part)
        values.extend((length, data))

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
    return _layout(*_HEADER_LAYOUT, tuple(parts)).pack(*values)


def measurement_bytes(m: Measurement) -> bytes:
    """Return the question as it goes over DDS: as message_bytes would, in less time."""
    tick, epoch, time, name, position, velocity, tip, curvature, applied = m
    part, length, word = _text(name)
    q, v, w = position.tolist(), velocity.tolist(), tip.tolist()
    c, u = curvature.tolist(), applied.tolist()
    layout = _layout(*_HEADER_LAYOUT, (part, len(q), len(v), len(w), len(c), len(u)))
    return layout.pack(
        HEAD, *stamp_of(time), 1, b"\x00", tick, epoch, length, word,
        len(q), *q, len(v), *v, len(w), *w, len(c), *c, len(u), *u,
    )  # fmt: skip


def truth_bytes(truth: Truth) -> bytes:
    """Return flexslew_msgs/PlantState as it goes over DDS."""
    tick, time, epoch, *fields = truth
    return message_bytes(stamp_of(time), tick, epoch, fields)


class _Places(NamedTuple):
    """Positions of the parts of a question with strings and vectors of these lengths."""

    words: Struct  # all but the doubles; lengths before what they are of
    lengths: tuple[int, ...]  # of frame_id, name and vectors
    first: int  # byte from which on there are doubles, and lengths between them
    vectors: tuple[slice, ...]  # doubles from there on


_SIZES = 256  # of questions with cached positions
_places: dict[int, _Places] = {}  # of the newest question of each size


def measurement_from(data: bytes, period: float) -> tuple[Measurement, Stamp]:
    """Return the question and its stamp; its time is that of the tick to the last bit.

    Raises:
        ValueError: these bytes are none.
    """
    try:
        body = _body(data)  # where its numbers are aligned
        places = _places.get(len(body)) or _places_of(body)
        sec, nanosec, frame, tick, epoch, length, name, *counts = places.words.unpack_from(body)
        if (frame, length, *counts) != places.lengths:  # another one of the same size
            places = _places_of(body)
            sec, nanosec, _, tick, epoch, _, name, *_ = places.words.unpack_from(body)
        first = places.first
        numbers = np.frombuffer(body, np.float64, (len(body) - first) // 8, first)
        vectors = [numbers[part] for part in places.vectors]
        word = name.decode()
    except (ValueError, error):
        raise _none_of(data, "Measurement") from None
    return Measurement(tick, epoch, tick * period, word, *vectors), Stamp(sec, nanosec)


def _body(data: bytes) -> bytes:
    """Return what follows the encapsulation, which must be that of little-endian CDR."""
    if data[:2] != HEAD[:2]:
        raise ValueError
    return data[4:]


def _none_of(data: bytes, kind: str) -> ValueError:
    return ValueError(f"{len(data)} bytes are no {kind} in little-endian CDR (XCDR1)")


def _places_of(data: bytes) -> _Places:
    """Return where the parts of a question stand, and remember it for others of its size."""
    frame = _QUESTION.unpack_from(data)[2]
    pad = -(12 + frame) % 8
    at = 12 + frame + pad
    length = _TICK.unpack_from(data, at)[2]
    layout = f"<iII{frame + pad}xQII{max(length - 1, 0)}s{min(length, 1)}x"
    at += 16 + length
    first, lengths, vectors = (at + 7) & ~7, [frame, length], []
    for _ in range(5):
        pad = -at % 4
        (count,) = _LENGTH.unpack_from(data, at + pad)
        at += pad + 4
        after = (-at % 8 if count else 0) + 8 * count
        vectors.append(slice((at + after - first) // 8 - count, (at + after - first) // 8))
        layout += f"{pad}xI{after}x"
        at += after
        lengths.append(count)
    if at > len(data):
        raise ValueError
    places = _Places(Struct(layout), tuple(lengths), first, tuple(vectors))
    if len(_places) < _SIZES or len(data) in _places:
        _places[len(data)] = places
    return places


def command_bytes(command: EffortCommand, at: Stamp, instance: int = 0) -> bytes:
    """Return the answer as it goes over DDS.

    Args:
        command: the answer.
        at: stamp of its question.
        instance: instance of the process that answers; 0: not given.
    """
    part, length, name = _text(command.controller)
    effort = command.effort.tolist()
    layout = _layout("<4siIQI", 20, (part, len(effort), "Q"))
    tick, epoch = command.tick, command.epoch
    return layout.pack(HEAD, *at, tick, epoch, length, name, len(effort), *effort, instance)


def command_from(data: bytes) -> EffortCommand:
    """Return the answer, with a read-only effort; its last field may be missing.

    Raises:
        ValueError: these bytes are none.
    """
    try:
        body = _body(data)
        _, _, tick, epoch, length = _ANSWER.unpack_from(body)
        at = 24 + length + -length % 4
        (count,) = _LENGTH.unpack_from(body, at)
        first = at + 4 + -(at + 4) % 8
        effort = np.frombuffer(body, np.float64, count, first) if count else EMPTY
        end = first + 8 * count
        (instance,) = _INSTANCE.unpack_from(body, end) if len(body) > end else (0,)
        name = body[24 : 23 + length].decode()
    except (ValueError, error):
        raise _none_of(data, "EffortCommand") from None
    return EffortCommand(tick, epoch, name, effort, instance)
