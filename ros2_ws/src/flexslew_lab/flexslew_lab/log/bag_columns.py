"""Messages of one topic as arrays, without an object for each of them."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from flexslew_lab.log.files.mcap_scan import RawMessage
from flexslew_lab.log.files.read_limits import check_size
from flexslew_lab.log.messages.cdr_layout import Layout, gather, layout


class ColumnBlock(NamedTuple):
    """Messages of one topic that follow one another, as arrays.

    `columns` maps a field (nested names joined by dots) to one value per message, shape (messages,)
    or (messages, length); texts are objects.
    """

    topic: str
    stamp: np.ndarray  # log times, (messages,) [ns]
    columns: dict[str, Any]


def blocks_of(
    topic: str,
    kind: str,
    messages: list[RawMessage],
    layouts: dict[tuple[str, int], list[Layout]],
) -> Iterator[ColumnBlock]:
    """Yield the messages as blocks of one layout each, in order."""
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
            kind_of = _layout_of(kind, rows[0], layouts.setdefault((kind, size), []))
            places = list(kind_of.shape)
            same = (rows[:, places] == rows[0, places]).all(axis=1)
            n = len(rows) if same.all() else int(np.argmin(same))
            columns = {
                name: np.full(n, value) if isinstance(value, str) else _text_column(value, n)
                for name, value in gather(kind_of, rows[:n])
            }
            yield ColumnBlock(topic, stamps[:n], columns)
            rows, stamps = rows[n:], stamps[n:]
        start = stop


def _layout_of(kind: str, row: np.ndarray, known: list[Layout]) -> Layout:
    """Return the layout of a message, from those met before where one fits."""
    data = row.tobytes()
    for one in known:
        if all(data[i] == one.template[i] for i in one.shape):
            return one
    found = layout(kind, data)
    if len(known) < 64:
        known.append(found)
    return found


def _text_column(value: Any, n: int) -> np.ndarray:
    """Return a column as an array; a tuple of texts is repeated for every message."""
    if isinstance(value, tuple):
        column = np.empty((n, len(value)), dtype=object)
        column[:] = value
        return column
    return np.asarray(value)


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
