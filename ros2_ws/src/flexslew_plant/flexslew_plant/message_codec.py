"""Messages as CDR bytes and back, by the fields of their .msg files.

XCDR1, little-endian, as rmw_fastrtps writes it: alignment counts from behind the four bytes of
encapsulation.
"""

from collections.abc import Callable, Iterable
from functools import lru_cache
from struct import Struct, error
from typing import Any, NamedTuple

import numpy as np

from flexslew_plant.errors import BadInput
from flexslew_plant.message_types import Field, fields, leaves

HEAD = b"\x00\x01\x00\x00"  # encapsulation
_SIZE = Struct("<I")
_WIDTHS = {code: Struct(f"<{code}").size for code in "?bBhHiIqQfds"} | {"#": 4, "[": 4}
_CACHED, _LARGEST = 256, 2000  # layouts, and the items of one that is cached


class Item(NamedTuple):
    """A number, a text, a sequence of numbers, or a size in front of a text or a sequence."""

    name: str  # of its field; nested names joined by dots
    at: int  # offset in the message [bytes]
    code: str  # of a number in the terms of `struct`; "s": a text; its size "#", a sequence's "["
    length: int = -1  # numbers of a sequence, bytes of a text; -1: one number

    @property
    def end(self) -> int:
        """Offset of the byte behind it."""
        return self.at + _WIDTHS[self.code] * abs(self.length)

    @property
    def fixed(self) -> bool:
        """Whether all messages of a layout have the same."""
        return self.code in "s#["


def _items(members: Iterable[Field], size_at: Callable[[int], int]) -> list[Item]:
    """Return the items of a message, from its encapsulation on.

    Args:
        members: of its type.
        size_at: returns the size that stands at an offset; called in the order of the message.
    """
    items = [Item("", 0, "s", len(HEAD))]

    def put(name: str, code: str, length: int = -1) -> int:
        at = items[-1].end
        at += (len(HEAD) - at) % _WIDTHS[code] if length else 0
        items.append(Item(name, at, code, length))
        return at

    def put_all(members: Iterable[Field], prefix: str) -> None:
        for field in members:
            name, length = prefix + field.name, field.fixed or -1
            if field.array and not field.fixed:
                length = size_at(put(name, "["))
            if field.code not in ("", "s"):
                put(name, field.code, length)
                continue
            for k in range(abs(length)):
                if field.nested:
                    put_all(fields(field.nested), f"{name}.{k}." if field.array else f"{name}.")
                else:
                    put(name, "s", size_at(put(name, "#")))

    put_all(members, "")
    return items


def _struct(items: Iterable[Item]) -> Struct:
    """Return what packs and reads these items of a message, sequences as their bytes."""
    layout, at = ["<"], 0
    for item in items:
        code = "I" if item.code in "#[" else item.code if item.length < 0 else "s"
        layout.append(f"{item.at - at}x{item.end - item.at if code == 's' else ''}{code}")
        at = item.end
    return Struct("".join(layout))


@lru_cache
def leading(type_name: str, *names: str) -> Struct:
    """Return what reads these fields near the start of a message, of a text its size.

    A text before the last of them must be empty, as the frame of a header is.
    """
    items = {item.name: item for item in reversed(_items(fields(type_name), lambda at: 1))}
    return _struct(items[name] for name in names)


class Layout(NamedTuple):
    """The places of all items in messages with the same sizes and texts."""

    items: list[Item]
    fixed: Struct  # reads sizes and texts
    words: tuple[Any, ...]  # the encapsulation, the sizes and the texts
    texts: tuple[str, ...]
    numbers: Struct  # reads numbers, and sequences as their bytes


_layouts: dict[tuple[str, int, int], list[Layout]] = {}  # by the arguments of layout_of


@lru_cache
def packer(type_name: str) -> Callable[..., bytes]:
    """Return a function of the values of all fields, those of a nested type one by one.

    Its source is written here, for each type once: it runs twice as fast as a loop over the fields.

    Raises:
        BadInput: a field is a sequence of a nested type.
    """
    values, lines, sizes, arguments = list[str](), list[str](), list[str](), ["HEAD"]
    for field in leaves(type_name):
        v = f"v{len(values)}"
        values.append(v)
        if field.array and field.code == "s":
            lines.append(f"{v} = [text.encode() + b'\\0' for text in {v}]")
            sizes.append(f"len({v}), *map(len, {v})")
            arguments.append(f"len({v}), *[part for text in {v} for part in (len(text), text)]")
            continue
        if field.code == "s":
            lines.append(f"{v} = {v}.encode() + b'\\0'")
        if not field.fixed and (field.array or field.code == "s"):
            sizes.append(f"n{v} := len({v})")
            arguments.append(f"n{v}")
        arguments.append(f"asarray({v}, {field.code}).tobytes()" if field.array else v)
    lines.append(f"layout = struct(({''.join(f'{size}, ' for size in sizes)}))")
    lines.append(f"return layout.pack({', '.join(arguments)})")

    @lru_cache(_CACHED)
    def struct(sizes: tuple[int, ...]) -> Struct:
        rest = iter(sizes)
        return _struct(_items(fields(type_name), lambda at: next(rest)))

    names: dict[str, Any] = {"HEAD": HEAD, "asarray": np.asarray, "struct": struct}
    names |= {code: np.dtype(f"<{code}") for code in "?bBhHiIqQfd"}
    exec("\n    ".join([f"def pack({', '.join(values)}):", *lines]), names)
    pack: Callable[..., bytes] = names["pack"]
    return pack


def layout_of(type_name: str, data: bytes, without: int = 0) -> Layout:
    """Return the layout of a message.

    Args:
        type_name: `package/msg/Type`.
        data: the message.
        without: how many last fields are left out, as in an older definition.

    Raises:
        BadInput: the bytes are no such message.
    """
    key = type_name, without, len(data)
    for known in _layouts.get(key, ()):
        if known.fixed.unpack_from(data) == known.words:
            return known
    try:
        found = _layout(fields(type_name)[: -without or None], data)
    except (ValueError, error):
        words = f"{len(data)} bytes are no {type_name.split('/')[-1]} in little-endian CDR (XCDR1)"
        raise BadInput(words) from None
    if sum(map(len, _layouts.values())) >= _CACHED:
        _layouts.clear()
    if len(found.items) <= _LARGEST:
        _layouts.setdefault(key, []).insert(0, found)
    return found


def _layout(members: Iterable[Field], data: bytes) -> Layout:
    def size_at(at: int) -> int:
        (size,) = _SIZE.unpack_from(data, at)
        if size > len(data):
            raise ValueError
        return int(size)

    items = _items(members, size_at)
    fixed = _struct(item for item in items if item.fixed)
    words = fixed.unpack_from(data)
    texts = [word for word in words[1:] if isinstance(word, bytes)]
    ended = not any(text[-1:] > b"\x00" for text in texts)
    if not ended or not data.startswith(HEAD[:2]) or items[-1].end > len(data):
        raise ValueError
    numbers = _struct(item for item in items if not item.fixed)
    return Layout(items, fixed, words, tuple(text[:-1].decode() for text in texts), numbers)
