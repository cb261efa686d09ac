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
    """A message of ROS as bytes; building and serialising an object costs ten times as much.

    Args:
        build: from a stamp and numbers to the message; called once, with marks by which their
            places in the bytes are found.
        count: how many numbers.

    Raises:
        RuntimeError: a number does not stand in the message, or stands there twice.
    """

    def __init__(self, build: Callable[[Time, list[float]], Any], count: int) -> None:
        marks = [_FIRST * (k + 1) for k in range(count)]
        data = serialize_message(build(Time(sec=_SEC, nanosec=_NANOSEC), marks))
        self._bytes = bytearray(data)
        body = memoryview(self._bytes)[_HEAD:]
        size = len(body)
        self._numbers = np.frombuffer(body[: size - size % 8], "<f8")
        self._words = np.frombuffer(body[: size - size % 4], "<i4")
        where = np.flatnonzero(np.isin(self._numbers, marks))
        if len(where) != count:
            raise RuntimeError(f"{len(where)} of {count} numbers found in the message")
        order = np.rint(self._numbers[where] / _FIRST).astype(int) - 1
        self._places = where[np.argsort(order)]
        self._sec, self._nanosec = (
            np.flatnonzero(self._words == mark) for mark in (_SEC, _NANOSEC)
        )

    def filled(self, at: Stamp, numbers: Vector) -> bytes:
        """Return the message with this stamp and these numbers, shape (count,)."""
        self._words[self._sec] = at.sec
        self._words[self._nanosec] = at.nanosec
        self._numbers[self._places] = numbers
        return bytes(self._bytes)
