"""Messages of one topic as arrays, without an object for each of them."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from flexslew_lab.log.files.mcap_scan import RawMessage
from flexslew_lab.log.files.read_limits import check_size
from flexslew_plant.errors import BadInput
from flexslew_plant.message_codec import Layout, layout_of
from flexslew_plant.message_types import leaves


class ColumnBlock(NamedTuple):
    """Messages of one topic that follow one another, as arrays.

    `columns` maps a field (nested names joined by dots) to one value per message, shape (messages,)
    or (messages, length); texts are objects.
    """

    topic: str
    stamp: np.ndarray  # log times, (messages,) [ns]
    columns: dict[str, Any]


def blocks_of(topic: str, kind: str, messages: list[RawMessage]) -> Iterator[ColumnBlock]:
    """Yield the messages as blocks of one layout each, in order.

    Raises:
        BadInput: a message is none of its kind, or the kind has sequences of nested types.
    """
    leaves(kind)
    start = 0
    while start < len(messages):
        size = len(messages[start].data)
        check_size("a message of every tick", size, topic)
        stop = next(
            (i for i in range(start, len(messages)) if len(messages[i].data) != size),
            len(messages),
        )
        rows = np.frombuffer(
            b"".join([m.data for m in messages[start:stop]]), dtype=np.uint8
        ).reshape(stop - start, size)
        stamps = np.array([m.stamp for m in messages[start:stop]], dtype=np.int64)
        while len(rows):
            layout = _layout_of(kind, rows[0].tobytes())
            fixed = [at for item in layout.items if item.fixed for at in range(item.at, item.end)]
            same = (rows[:, fixed] == rows[0, fixed]).all(axis=1)
            n = len(rows) if same.all() else int(np.argmin(same))
            columns = _columns(layout, rows[:n])
            yield ColumnBlock(topic, stamps[:n], columns)
            rows, stamps = rows[n:], stamps[n:]
        start = stop


def _layout_of(kind: str, data: bytes) -> Layout:
    layout = layout_of(kind, data)
    end = layout.items[-1].end
    if len(data) >= end + 4:  # more than padding
        raise BadInput(f"{len(data)} bytes are not a {kind}: its fields take {end}")
    return layout


def _columns(layout: Layout, rows: np.ndarray) -> dict[str, Any]:
    """Return the values of messages of one layout by field; texts are repeated for each message.

    Args:
        layout: of all of them.
        rows: their bytes, shape (messages, size), uint8.
    """
    found: dict[str, Any] = {}
    texts, count = iter(layout.texts), len(rows)
    for item in layout.items[1:]:
        if item.code == "[":
            found[item.name] = []  # of texts, or numbers take its place
        elif item.code == "s":
            text = next(texts)
            if item.name in found:
                found[item.name].append(text)
            else:
                found[item.name] = np.full(count, text)
        elif item.code != "#":
            block = np.ascontiguousarray(rows[:, item.at : item.end])
            values = block.view(f"<{item.code}") if item.length else np.zeros((count, 0))
            found[item.name] = values[:, 0] if item.length < 0 else values
    for name, entries in found.items():
        if isinstance(entries, list):
            found[name] = np.empty((count, len(entries)), dtype=object)
            found[name][:] = entries
    return found


def pad_columns(part: np.ndarray, width: int) -> np.ndarray:
    """Return the rows filled up to width, with NaN or empty texts."""
    if part.ndim == 1 or part.shape[1] == width:
        return part
    fill_value: Any = "" if part.dtype == object else np.nan
    padded = np.full(
        (len(part), width), fill_value, dtype=part.dtype if part.dtype == object else float
    )
    padded[:, : part.shape[1]] = part
    return padded
