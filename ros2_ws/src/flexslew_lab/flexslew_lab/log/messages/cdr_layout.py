"""Where the fields of a message lie in its bytes, to read many messages as arrays at once."""

import struct
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from flexslew_lab.log.messages.cdr import HEADER, fields
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput


class CdrColumn(NamedTuple):
    """The place of one field in every message of the same shape."""

    name: str  # nested names joined by dots
    offset: int  # in the CDR bytes
    dtype: str  # of NumPy; empty for strings
    length: int  # -1: one number; else the length of the sequence
    text: tuple[str, ...] | str = ""  # of strings, which are part of the shape


class Layout(NamedTuple):
    """Columns of a message, and the bytes that must be equal for another to lie the same way."""

    columns: tuple[CdrColumn, ...]
    shape: tuple[int, ...]  # offsets of the lengths and of the strings' bytes
    template: bytes  # the message that it was read from


def layout(type_name: str, data: bytes) -> Layout:
    """Return where the fields of this message lie, for reading many of them as arrays.

    Args:
        type_name: a type without sequences of nested types.
        data: CDR bytes of one message.

    Raises:
        BadInput: the bytes are not such a message.

    """
    if data[:2] != HEADER[:2]:
        raise BadInput("the bytes are not little-endian CDR", type_name)
    shape = list(range(4))
    columns: list[CdrColumn] = []
    try:
        end = _walk(type_name, data, "", 4, columns, shape)
    except (struct.error, UnicodeDecodeError, IndexError) as error:
        raise BadInput(f"{len(data)} bytes are not a {type_name}: {error}") from None
    if not end <= len(data) < end + 4:
        raise BadInput(f"{len(data)} bytes are not a {type_name}: its fields take {end}")
    return Layout(tuple(columns), tuple(shape), data)


def _walk(
    type_name: str, data: bytes, prefix: str, at: int, columns: list[CdrColumn], shape: list[int]
) -> int:
    """Append the columns of one struct that starts at `at`; return where it ends."""

    def text(at: int) -> tuple[str, int]:
        at += -at % 4
        (size,) = struct.unpack_from("<I", data, at)
        end = at + 4 + size
        if end > len(data) or size == 0 or data[end - 1]:
            raise IndexError("a string ends outside of the message")
        shape.extend(range(at, end))
        return data[at + 4 : end - 1].decode(), end

    for name, array, fixed, code, nested in fields(type_name):
        name = prefix + name
        count = fixed or -1
        if array and not fixed:
            at += -at % 4
            (count,) = struct.unpack_from("<I", data, at)
            shape.extend(range(at, at + 4))
            at += 4
            if count > len(data):
                raise IndexError(f"{name} would have {count} values")
        if nested:
            if array:
                raise BadInput(f"{type_name} has no fixed layout: {name} is a sequence of {nested}")
            at = _walk(nested, data, name + ".", at, columns, shape)
        elif code == "s":
            if not array:
                word, at = text(at)
                columns.append(CdrColumn(name, at, "", -1, word))
                continue
            words = []
            for _ in range(count):
                word, at = text(at)
                words.append(word)
            columns.append(CdrColumn(name, at, "", count, tuple(words)))
        else:
            size = struct.calcsize(code)
            if count:
                # CDR counts from behind its 4-byte header, a multiple of 4
                at += -(at - 4) % size
            columns.append(CdrColumn(name, at, "<" + code if size > 1 else code, count))
            at += size * abs(count)
            if at > len(data):
                raise IndexError(f"{name} ends outside of the message")
    return at


def gather(kind: Layout, rows: np.ndarray) -> Iterator[tuple[str, Any]]:
    """Yield (field, array) for messages of one layout, row by row.

    Args:
        kind: their layout.
        rows: their bytes, shape (messages, size), uint8.

    """
    for name, offset, dtype, count, words in kind.columns:
        if not dtype:
            yield name, words
            continue
        width = np.dtype(dtype).itemsize * abs(count)
        block = np.ascontiguousarray(rows[:, offset : offset + width])
        values: Vector = block.view(dtype) if width else np.zeros((len(rows), 0))
        yield name, values[:, 0] if count < 0 else values
