"""Records of other benches: a CSV file, or any rosbag2, with columns chosen by name."""

import csv
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flexslew_lab.identification.clocks import Effort, clock_notes, record_on_clocks
from flexslew_lab.identification.record import Output, Quantity, Record
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput

_TIME = ("time", "t", "stamp")  # names of a CSV's column of times [s]
_AT_LIMIT = (0.01, 0.5)  # part of the samples at the largest value that looks like a drive's limit
_FEW = 5  # samples
# fields that hold the effort of the tick before their stamp
_PAST_EFFORTS = {("flexslew_msgs/msg/Measurement", "applied_effort")}
_INDEX = re.compile(r"^(?P<field>.*?)\[(?P<index>\d+)\]$")


class Columns(NamedTuple):
    """Series of one clock each, by name."""

    series: dict[str, tuple[Vector, Vector]]  # times [s] and values
    source: str
    past: frozenset[str] = frozenset()  # whose values held until their stamp, not from it on


class Repaired(NamedTuple):
    """A record, and notes about its gaps and clocks."""

    record: Record
    words: tuple[str, ...]


def foreign_record(
    path: Path,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    period: float | None = None,
    past: bool = False,
) -> Repaired:
    """Return a record of a CSV file or a bag, at the times of its samples.

    An input `torque_1` or `/effort.data[0]` is held until its next value; where a sample is
    missing, it is unknown. The name behind a `=` gives an output's quantity, `position.JOINT` or
    `rate.JOINT` (`/joint_states.position[0]=position.hub`); any other name is a deflection.

    Args:
        path: of the file, or the folder of the bag.
        inputs: columns of efforts, each `column` or `column=joint`.
        outputs: columns of sensors, each `column` or `column=name`.
        period: of the ticks [s]; None: the median of the first input's.
        past: an effort is stamped when it ends, not when it begins.

    Raises:
        BadInput: if a column is missing or has less than two samples, a clock does not advance, or
            too many efforts are unknown.
    """
    requested = [_named(text) for text in (*inputs, *outputs)]
    columns = (read_csv if path.suffix == ".csv" else read_bag)(
        path, [name for name, _ in requested]
    )
    for name, (t, _) in columns.series.items():
        if len(t) < 2 or not np.isfinite(t).all():
            raise BadInput(f"{path}: {name}: two samples and more are needed, at finite times")
        _check_order(path, name, t)
    if period is not None and not 0.0 < period < np.inf:
        raise BadInput("a number of seconds above 0", key="--period", value=period)
    split = len(inputs)
    words = [line for name, _ in requested for line in clock_notes(name, columns.series[name][0])]
    for name, _ in requested[:split]:
        words += _limited(name, columns.series[name][1])
    record = record_on_clocks(
        [
            Effort(label, *columns.series[name], past or name in columns.past)
            for name, label in requested[:split]
        ],
        [(_output(label), *columns.series[name]) for name, label in requested[split:]],
        period,
        str(path),
    )
    return Repaired(record.moved(), tuple(words))


def _limited(name: str, values: Vector) -> list[str]:
    """Return, in words, that an effort looks as if its drive had been at its limit."""
    size = np.abs(values)
    there = size >= size.max() * (1.0 - 1e-9)
    share = float(there.mean())
    # a few are the top of any signal; more than the most are a signal of two values
    if there.sum() < _FEW or not _AT_LIMIT[0] < share < _AT_LIMIT[1]:
        return []
    return [
        f"{name}: at its largest value, {size.max():.4g}, in {share:.0%} of the samples; if that "
        "is the drive's limit, the column must hold the effort applied, not the one asked for"
    ]


def _named(text: str) -> tuple[str, str]:
    column, _, label = text.partition("=")
    return column, label or column


def _output(label: str) -> Output:
    kind, _, joint = label.partition(".")
    if kind == "position":
        return Output(label, "rad", Quantity.JOINT_POSITION, joint)
    if kind == "rate":
        return Output(label, "rad/s", Quantity.JOINT_RATE, joint)
    return Output(label, "m", Quantity.DEFLECTION)


def _check_order(path: Path, name: str, t: Vector) -> None:
    """Refuse a clock that does not advance."""
    steps = np.diff(t)
    if (steps <= 0.0).any():
        at = float(t[int(np.argmax(steps <= 0.0))])
        raise BadInput(f"{path}: {name}: the time steps back at {at:.6g} s")


def read_csv(path: Path, names: list[str]) -> Columns:
    """Return columns of a CSV file with a header; the column of times is `time`, `t` or `stamp`.

    Raises:
        BadInput: it cannot be read, has no times, a column is missing, or an entry is no number.
    """
    try:
        with path.open(newline="") as file:
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise BadInput(f"{path}: cannot be read: {error}") from None
    while rows and not rows[-1]:  # blank lines at the end
        rows.pop()
    if len(rows) < 2:
        raise BadInput(f"{path}: holds no rows; a header and numbers are needed")
    header = [name.strip() for name in rows[0]]
    clock = next((name for name in _TIME if name in header), None)
    if clock is None:
        raise BadInput(f"{path}: no column of times; call it {', '.join(_TIME)}")
    columns: dict[str, Vector] = {}
    for name in (clock, *names):
        if name not in header:
            raise BadInput(f"{path}: no column {name}; there are {', '.join(header)}")
        place = header.index(name)
        try:
            columns[name] = np.array([float(row[place]) for row in rows[1:]])
        except (ValueError, IndexError):
            line = next(k for k, row in enumerate(rows[1:], 2) if not _number(row, place))
            raise BadInput(f"{path}: line {line}: {name}: give a number") from None
    return Columns({name: (columns[clock], columns[name]) for name in names}, str(path))


def _number(row: list[str], place: int) -> bool:
    try:
        float(row[place])
    except (ValueError, IndexError):
        return False
    return True


def read_bag(path: Path, names: list[str]) -> Columns:
    """Return series of a rosbag2 by `/topic.field[index]`, at the messages' stamps.

    A header's stamp is taken where there is one, else the time of recording.

    Raises:
        BadInput: it cannot be read, or there is no such topic, field or entry.
    """
    from rosbags.highlevel import AnyReader

    requested = [_place(path, name) for name in names]
    found: dict[str, tuple[list[float], list[float]]] = {name: ([], []) for name in names}
    past = set()
    try:
        with AnyReader([path]) as reader:
            topics = {place.topic for place in requested}
            connections = [c for c in reader.connections if c.topic in topics]
            there = {c.topic for c in reader.connections}
            for topic in topics - there:
                raise BadInput(f"{path}: no topic {topic}; there are {', '.join(sorted(there))}")
            for connection, stamp, raw in reader.messages(connections=connections):
                message = reader.deserialize(raw, connection.msgtype)
                at = _stamp(message, stamp)
                for name, place in zip(names, requested, strict=True):
                    if place.topic == connection.topic:
                        if (connection.msgtype, place.field) in _PAST_EFFORTS:
                            past.add(name)
                        found[name][0].append(at)
                        found[name][1].append(_entry(path, name, message, place))
    except BadInput:
        raise
    except Exception as error:  # corrupt bytes meet a parser that lets all its errors through
        raise BadInput(f"{path}: cannot be read: {error or type(error).__name__}") from None
    series = {name: (np.array(t), np.array(values)) for name, (t, values) in found.items()}
    for name, (t, _) in series.items():
        if t.size < 2:
            raise BadInput(f"{path}: {name}: {t.size} messages are no series")
    return Columns(series, str(path), frozenset(past))


class _Place(NamedTuple):
    topic: str
    field: str
    entry: int | None


def _place(path: Path, name: str) -> _Place:
    topic, _, field = name.partition(".")
    if not topic.startswith("/") or not field:
        raise BadInput(f"{path}: {name} is no column; write /topic.field or /topic.field[index]")
    match = _INDEX.match(field)
    return _Place(topic, match["field"] if match else field, int(match["index"]) if match else None)


def _stamp(message: Any, recorded: int) -> float:
    header = getattr(message, "header", None)
    if header is None:
        return recorded * 1e-9
    return float(header.stamp.sec + header.stamp.nanosec * 1e-9)


def _entry(path: Path, name: str, message: Any, place: _Place) -> float:
    value = message
    try:
        for part in place.field.split("."):
            value = getattr(value, part)
        return float(value if place.entry is None else value[place.entry])
    except (AttributeError, IndexError, TypeError, ValueError):
        raise BadInput(f"{path}: {name}: the message has no such number") from None
