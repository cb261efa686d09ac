"""Messages of a log as bytes and back, without ROS."""

from collections.abc import Iterator, Mapping
from functools import lru_cache
from struct import Struct, error
from typing import Any

import numpy as np

from flexslew_lab.log.messages.schemas import store
from flexslew_plant.errors import BadInput
from flexslew_plant.message_codec import HEAD, packer
from flexslew_plant.message_types import fields

_STAMP, _SIZE = Struct("<iI"), 4  # of a sequence
_TIME = "builtin_interfaces/msg/Time"
# Their stamp is of the wall clock, or when a trajectory begins.
_OTHER_TIME = frozenset({"rcl_interfaces/msg/Log", "trajectory_msgs/msg/JointTrajectory"})


def encode(type_name: str, message: Any) -> bytes:
    """Return the CDR bytes of a message.

    Args:
        type_name: `package/msg/Type`, one without sequences of nested types.
        message: a mapping, or anything with attributes named as the fields; arrays may be NumPy
            arrays or sequences; a field that is missing is zero or empty. A time may be an
            integer [ns].

    Raises:
        BadInput: a field has a value of another kind.

    """
    try:
        return packer(type_name)(*_values(type_name, message))
    except (error, TypeError, ValueError, AttributeError) as reason:
        raise BadInput(f"this does not fit the message: {reason}", type_name) from None


def _values(type_name: str, message: Any) -> Iterator[Any]:
    if type_name == _TIME and isinstance(message, (int, np.integer)):
        yield from divmod(int(message), 1_000_000_000)
        return
    mapping = isinstance(message, Mapping)
    for name, array, fixed, code, nested, _ in fields(type_name):
        value = message.get(name) if mapping else getattr(message, name, None)
        if nested:
            yield from _values(nested, {} if value is None else value)
        elif value is None:
            yield () if array else "" if code == "s" else 0
        elif fixed and len(value) != fixed:
            raise ValueError(f"{name} needs {fixed} values, not {len(value)}")
        else:
            yield value


def decode(type_name: str, data: bytes) -> Any:
    """Return a message object with the fields of the type as attributes.

    Raises:
        BadInput: the bytes are not such a message.

    """
    try:
        return store().deserialize_cdr(data, type_name)
    except Exception as reason:  # corrupt bytes meet generated code
        raise BadInput(f"{len(data)} bytes are not a {type_name}: {reason}") from None


def stamp_of(type_name: str, data: bytes, last: int) -> int:
    """Return the simulated time that a message carries [ns], or `last` where it has none.

    Args:
        type_name: `package/msg/Type`.
        data: its CDR bytes.
        last: the latest known simulated time [ns].

    """
    at = _stamp_offset(type_name)
    empty = at > len(HEAD) and not any(data[len(HEAD) : at])  # a sequence
    if at == 0 or empty or len(data) < at + _STAMP.size:
        return last
    seconds, nanoseconds = _STAMP.unpack_from(data, at)
    return int(seconds * 1_000_000_000 + nanoseconds)


@lru_cache
def _stamp_offset(type_name: str) -> int:
    """Return where the first stamp is in the CDR bytes; 0 if there is none in simulated time."""
    at = 0 if type_name in _OTHER_TIME else len(HEAD)
    while at and type_name != _TIME:
        first = fields(type_name)[0]
        at, type_name = at + _SIZE * first.array if first.nested else 0, first.nested
    return at
