"""Series of numbers in any rosbag2: MCAP and SQLite, with or without definitions of its types."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexslew_lab.identification.files.columns import Columns, FileClock
from flexslew_lab.log.messages.schemas import default_store
from flexslew_plant.errors import BadInput

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.typesys.store import Typestore

# fields that hold the effort of the tick before their stamp
_PAST_EFFORTS = {("flexslew_msgs/msg/Measurement", "applied_effort")}
_INDEX = re.compile(r"^(?P<field>.*?)\[(?P<index>\d+)\]$")
_HEADERS = FileClock()
_IDL = "=" * 80 + "\nIDL: "  # before each type of a definition in IDL


class _Place(NamedTuple):
    topic: str
    field: str
    entry: int | None


def read_bag(path: Path, names: list[str], clock: FileClock = _HEADERS) -> Columns:
    """Return series of a rosbag2 by `/topic.field[index]`, at the messages' stamps.

    The time is the header's stamp. Where there is none, the stamps of a series stand still, or
    `clock.recorded` is set, it is the time of recording. Only the types of these topics are looked
    at. Bags of Foxy to Humble hold no definitions; their types are those of ROS 2 Humble and of
    this project.

    Raises:
        BadInput: if it cannot be read, or there is no such topic, field or entry.
    """
    from rosbags.rosbag2 import Reader

    if clock.column is not None or clock.unit is not None:
        raise BadInput("stamps of a bag are in seconds; leave out --time and --time-unit", path)

    places = [_place(path, name) for name in names]
    rows: dict[str, list[tuple[float, float, float]]] = {name: [] for name in names}
    past = set()
    try:
        with Reader(path) as reader:
            known = sorted({c.topic for c in reader.connections})
            for place in places:
                if place.topic not in known:
                    raise BadInput(f"no topic {place.topic}; there are {', '.join(known)}", path)
            topics = {place.topic for place in places}
            connections = [c for c in reader.connections if c.topic in topics]
            types_by_id = {c.id: _store(c, path) for c in connections}
            for connection, recorded, raw in reader.messages(connections=connections):
                message = types_by_id[connection.id].deserialize_cdr(raw, connection.msgtype)
                stamp = _stamp(message)
                for name, place in zip(names, places, strict=True):
                    if place.topic != connection.topic:
                        continue
                    if (connection.msgtype, place.field) in _PAST_EFFORTS:
                        past.add(name)
                    value = _entry(path, name, message, place)
                    rows[name].append((stamp, recorded * 1e-9, value))
    except BadInput:
        raise
    except Exception as error:  # corrupt bytes meet a parser that lets all its errors through
        raise BadInput(f"cannot be read: {error or type(error).__name__}", path) from None
    series, still = {}, []
    for name, found in rows.items():
        if len(found) < 2:
            raise BadInput(f"{name}: {len(found)} messages are no series", path)
        stamp, recorded, values = np.array(found).T
        has_header = bool(np.isfinite(stamp).all())
        if has_header and not clock.recorded and not np.ptp(stamp):
            still.append(name)
        at_headers = has_header and not clock.recorded and name not in still
        series[name] = (stamp if at_headers else recorded, values)
    notes = (f"{', '.join(still)}: the stamps stand still; the times of recording count",)
    return Columns(series, str(path), frozenset(past), notes if still else ())


def _store(connection: "Connection", path: Path) -> "Typestore":
    """Return the types that a topic needs: those that the bag defines, else the usual ones.

    Raises:
        BadInput: if its definition cannot be read, or the type is unknown.
    """
    from rosbags.interfaces import MessageDefinitionFormat as Format
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    kind, definition = connection.msgtype, connection.msgdef
    if definition.format == Format.NONE:
        known = default_store()
        if kind not in known.fielddefs:
            words = (
                f"{connection.topic}: the type {kind} is unknown, and the bag does not define it"
            )
            raise BadInput(words, path)
        return known
    type_store = get_typestore(Stores.EMPTY)
    try:
        if definition.format == Format.MSG:
            type_store.register(get_types_from_msg(definition.data, kind))
        else:
            first, *parts = definition.data.split(_IDL)
            for text in (part.partition("\n")[2] for part in parts) if parts else (first,):
                type_store.register(get_types_from_idl(text))
    except Exception as error:  # a parser that is given anything at all
        words = f"{connection.topic}: the definition of {kind} cannot be read: {error}"
        raise BadInput(words, path) from None
    return type_store


def _place(path: Path, name: str) -> _Place:
    topic, _, field = name.partition(".")
    if not topic.startswith("/") or not field:
        raise BadInput(f"{path}: {name} is no column; write /topic.field or /topic.field[index]")
    match = _INDEX.match(field)
    return _Place(topic, match["field"] if match else field, int(match["index"]) if match else None)


def _stamp(message: Any) -> float:
    """Return the stamp of the header [s]; not a number where there is no header."""
    header = getattr(message, "header", None)
    if header is None:
        return float("nan")
    return float(header.stamp.sec + header.stamp.nanosec * 1e-9)


def _entry(path: Path, name: str, message: Any, place: _Place) -> float:
    value = message
    try:
        for part in place.field.split("."):
            value = getattr(value, part)
        return float(value if place.entry is None else value[place.entry])
    except (AttributeError, IndexError, TypeError, ValueError):
        raise BadInput(f"{path}: {name}: the message has no such number") from None
