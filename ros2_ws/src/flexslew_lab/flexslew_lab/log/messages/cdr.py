"""Messages as bytes and back, without ROS: XCDR1, little-endian, as rmw_fastrtps writes it."""

import struct
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from rosbags.interfaces import Nodetype

from flexslew_lab.log.messages.schemas import store
from flexslew_plant.errors import BadInput

HEADER = b"\x00\x01\x00\x00"  # CDR, little-endian
_CODES = {
    "bool": "?", "byte": "B", "char": "B", "int8": "b", "uint8": "B", "int16": "h",
    "uint16": "H", "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f",
    "float64": "d",
}  # fmt: skip
_STAMP = struct.Struct("<iI")
_TIME = "builtin_interfaces/msg/Time"
_STAMP_AT = {  # offset of the first stamp where it is not the first field
    "tf2_msgs/msg/TFMessage": 8,
    "visualization_msgs/msg/MarkerArray": 8,
}
# Their stamp is of the wall clock, or when a trajectory begins.
_OTHER_TIME = frozenset({"rcl_interfaces/msg/Log", "trajectory_msgs/msg/JointTrajectory"})


class Field(NamedTuple):
    """One member of a type, with its place in the store's terms."""

    name: str
    array: bool  # a sequence or an array
    fixed: int  # length of a fixed array, else 0
    code: str  # of a number in `struct`'s terms, "s" of a string, "" of a nested type
    nested: str  # the type's name where it is nested


@lru_cache
def fields(type_name: str) -> tuple[Field, ...]:
    """Return the members of a type in their order on the wire.

    Raises:
        BadInput: the type is not known.

    """
    try:
        _, members = store().fielddefs[type_name]
    except KeyError:
        raise BadInput(f"no definition of {type_name} is known") from None
    found = []
    for name, (kind, rest) in members:
        array = kind in (Nodetype.ARRAY, Nodetype.SEQUENCE)
        fixed = int(rest[1]) if kind == Nodetype.ARRAY else 0
        inner: Any = rest[0] if array else (kind, rest)
        if inner[0] == Nodetype.NAME:
            found.append(Field(name, array, fixed, "", str(inner[1])))
        else:
            base = inner[1][0]
            found.append(Field(name, array, fixed, "s" if base == "string" else _CODES[base], ""))
    return tuple(found)


def encode(type_name: str, message: Any) -> bytes:
    """Return the CDR bytes of a message.

    Args:
        type_name: `package/msg/Type`.
        message: a mapping, or anything with attributes named as the fields; arrays may be NumPy
            arrays or sequences; a field that is missing is zero or empty. A time may be an
            integer [ns].

    Raises:
        BadInput: a field has a value of another kind.

    """
    values: list[Any] = [HEADER]
    lengths: list[int] = []
    try:
        _collect(type_name, message, values, lengths)
        return _message_struct(type_name, tuple(lengths)).pack(*values)
    except (struct.error, TypeError, ValueError, AttributeError) as error:
        raise BadInput(f"this does not fit the message: {error}", type_name) from None


def decode(type_name: str, data: bytes) -> Any:
    """Return a message object with the fields of the type as attributes.

    Raises:
        BadInput: the bytes are not such a message.

    """
    try:
        return store().deserialize_cdr(data, type_name)
    except Exception as error:  # corrupt bytes meet generated code
        raise BadInput(f"{len(data)} bytes are not a {type_name}: {error}") from None


def stamp_of(type_name: str, data: bytes, last: int) -> int:
    """Return the simulated time that a message carries [ns], or `last` where it has none.

    Args:
        type_name: `package/msg/Type`.
        data: its CDR bytes.
        last: the latest known simulated time [ns].

    """
    return time_at(stamp_offset(type_name), data, last)


def time_at(offset: int, data: bytes, last: int) -> int:
    """Return the simulated time that a message carries [ns], or `last` where it has none.

    Args:
        offset: where it stands, see stamp_offset.
        data: CDR bytes.
        last: the latest known simulated time [ns].

    """
    if offset == 0 or len(data) < offset + 8:
        return last
    if offset == 8 and data[4:8] == b"\x00\x00\x00\x00":  # a sequence with nothing in it
        return last
    seconds, nanoseconds = _STAMP.unpack_from(data, offset)
    return int(seconds * 1_000_000_000 + nanoseconds)


@lru_cache
def stamp_offset(type_name: str) -> int:
    """Return the offset of the stamp in the CDR bytes; 0 if there is none in simulated time."""
    if type_name in _STAMP_AT:
        return _STAMP_AT[type_name]
    if type_name in _OTHER_TIME:
        return 0
    first = next(iter(fields(type_name)), None)
    leading = first is not None and not first.array
    has_stamp = first is not None and first.nested in (
        _TIME,
        "std_msgs/msg/Header",
    )
    return 4 if leading and has_stamp else 0


def _collect(type_name: str, message: Any, values: list[Any], lengths: list[int]) -> None:
    """Append what `_packer` packs, and the lengths of all sequences and strings."""
    if type_name == _TIME and isinstance(message, (int, np.integer)):
        values.extend(divmod(int(message), 1_000_000_000))
        return
    mapping = isinstance(message, Mapping)
    for name, array, fixed, code, nested in fields(type_name):
        value = message.get(name) if mapping else getattr(message, name, None)
        if not array:
            _collect_one(code, nested, value, values, lengths)
            continue
        items = () if value is None else value
        if fixed:
            items = items if len(items) else [0] * fixed
            if len(items) != fixed:
                raise ValueError(f"{name} needs {fixed} values, not {len(items)}")
        else:
            values.append(len(items))
            lengths.append(len(items))
        if code == "d":
            values.append(np.ascontiguousarray(items, dtype="<f8").tobytes())
        else:
            for item in items:
                _collect_one(code, nested, item, values, lengths)


def _collect_one(code: str, nested: str, value: Any, values: list[Any], lengths: list[int]) -> None:
    if nested:
        _collect(nested, {} if value is None else value, values, lengths)
    elif code == "s":
        text = b"\x00" if value is None else str(value).encode() + b"\x00"
        values += (len(text), text)
        lengths.append(len(text))
    else:
        values.append(0 if value is None else value)


@lru_cache(4096)
def _message_struct(type_name: str, lengths: tuple[int, ...]) -> struct.Struct:
    """Return the struct, with all alignment, of a message with sequences of these lengths."""
    rest = iter(lengths)
    parts = ["<4s"]
    at = 0

    def put(size: int, code: str, count: int = 1) -> None:
        nonlocal at
        padding = -at % size if count else 0
        parts.append(f"{padding}x{code}" if padding else code)
        at += padding + size * count

    def put_one(code: str, nested: str) -> None:
        if nested:
            put_struct(nested)
        elif code == "s":
            size = next(rest)
            put(4, "I")
            put(1, f"{size}s", size)
        else:
            put(struct.calcsize(code), code)

    def put_struct(name: str) -> None:
        for _, array, fixed, code, nested in fields(name):
            if not array:
                put_one(code, nested)
                continue
            count = fixed or next(rest)
            if not fixed:
                put(4, "I")
            if code == "d":
                put(8, f"{8 * count}s", count)
            else:
                for _ in range(count):
                    put_one(code, nested)

    put_struct(type_name)
    return struct.Struct("".join(parts))
