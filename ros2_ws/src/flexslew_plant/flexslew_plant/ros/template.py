"""Messages of which only stamps and numbers change, as bytes that are written once."""

from collections.abc import Callable
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message

from flexslew_plant.arrays import Vector
from flexslew_plant.bench.wire import Stamp

_HEAD = 4  # bytes of encapsulation, from behind which CDR aligns
_SEC, _NANOSEC = 0x2A5EC0DE, 0x1A5EC0DE  # marks that no other field has
_FIRST = -(2.0**900)  # the k-th number is marked by (k + 1) of these


class Template:
    """Messages of one stamp as bytes; to build and serialise objects costs ten times as much.

    Args:
        parts: of each message how it is built from a stamp and numbers, and how many these are;
            called once, with marks by which their places in the bytes are found.

    Raises:
        RuntimeError: a number does not stand in its message, or stands there twice.
    """

    def __init__(self, *parts: tuple[Callable[[Time, list[float]], Any], int]) -> None:
        stamp = Time(sec=_SEC, nanosec=_NANOSEC)
        first, slices = 0, []
        buffer = bytearray()
        for build, count in parts:
            marks = [_FIRST * (k + 1) for k in range(first, first + count)]
            data = serialize_message(build(stamp, marks))
            found = int(np.isin(np.frombuffer(_padded(data[_HEAD:], 8), "<f8"), marks).sum())
            if found != count:
                raise RuntimeError(f"{found} of {count} numbers found in the message")
            buffer += bytes((-len(buffer) - _HEAD) % 8)
            slices.append(slice(len(buffer), len(buffer) + len(data)))
            buffer += data
            first += count
        view = memoryview(buffer)
        self._parts = [view[part] for part in slices]
        self._numbers = np.frombuffer(view[: len(buffer) // 8 * 8], "<f8")
        self._words = np.frombuffer(view[: len(buffer) // 4 * 4], "<i4")
        where = np.flatnonzero(np.isin(self._numbers, [_FIRST * (k + 1) for k in range(first)]))
        order = np.rint(self._numbers[where] / _FIRST).astype(int) - 1
        self._places = where[np.argsort(order)]
        self._sec, self._nanosec = (
            np.flatnonzero(self._words == mark) for mark in (_SEC, _NANOSEC)
        )

    def filled(self, at: Stamp, numbers: Vector) -> list[bytes]:
        """Return the messages with this stamp and these numbers, those of the first one first."""
        self._words[self._sec] = at.sec
        self._words[self._nanosec] = at.nanosec
        self._numbers[self._places] = numbers
        return [part.tobytes() for part in self._parts]


def _padded(data: bytes, size: int) -> bytes:
    """Return what of some bytes makes whole words of this size."""
    return data[: len(data) // size * size]
