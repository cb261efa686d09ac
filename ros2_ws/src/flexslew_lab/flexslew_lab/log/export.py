"""A bag as tables: Parquet or CSV, one per topic, with units."""

import json
import re
from collections.abc import Collection, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from flexslew_lab.log.bag_columns import ColumnBlock
from flexslew_lab.log.bag_reader import BagReader, Overview
from flexslew_lab.log.column_names import column_name
from flexslew_lab.log.files.whole_file import write_whole
from flexslew_lab.log.messages.schemas import type_hash
from flexslew_lab.log.truth_columns import coordinate_of, unit_of_tip
from flexslew_plant.errors import BadInput
from flexslew_plant.message_types import fields, leaves
from flexslew_plant.own_code import Trust

MAX_COLUMNS = 64  # longer sequences stay one column: a list in Parquet, JSON in CSV
ROWS, BYTES = 16_384, 1 << 24  # of a row group, which ends at the first of them
_UNIT = re.compile(r"\[([^\]]+)\]")


class ExportResult(NamedTuple):
    """What was written, and which topics have no table."""

    files: dict[str, Path]  # by topic
    rows: dict[str, int]
    skipped: dict[str, str]  # topic -> why


class _Column(NamedTuple):
    name: str
    source: str  # field, dots joined
    place: int | None  # into a sequence; None: the whole
    width: int  # -1: a number; else the longest sequence
    type: pa.DataType
    unit: str


def export_log(
    path: Path,
    out: Path,
    kind: Literal["parquet", "csv"] = "parquet",
    topics: Collection[str] | None = None,
) -> ExportResult:
    """Return the files that were written: `<out>/<topic>.<kind>`, one per topic.

    Columns: `time` [s] of the simulation, `log_time` [ns], then the fields; entries of a sequence
    are named after joints, modes and appendages (`position.mode_1`), those of a craft's state after
    its coordinates, all else `name_k`. Units and
    meanings stand in the metadata of the Arrow fields; for CSV in `<out>/columns.json`.

    Args:
        path: the bag's folder or file.
        out: a folder, made if missing.
        kind: parquet or csv.
        topics: absolute names; default: all that fit into a table.

    Raises:
        BadInput: the bag cannot be read, or a topic is not in it.

    """
    if kind not in ("parquet", "csv"):
        raise BadInput(f"export: {kind!r} is not known; choose parquet or csv")
    bag = BagReader(path)
    overview = bag.overview
    unknown = [t for t in topics or () if t not in overview.counts]
    if unknown:
        available = ", ".join(sorted(overview.counts))
        raise BadInput(f"no topic {unknown[0]}; it has {available}", bag.path)
    requested = list(topics or sorted(overview.counts))
    skipped = {t: why for t in requested if (why := _reject_reason(overview.types[t]))}
    requested = [t for t in requested if t not in skipped]
    widths = _widths(bag, requested)
    out.mkdir(parents=True, exist_ok=True)
    columns = {t: _columns(overview, t, widths[t], kind, bag.trust) for t in requested}
    files = {t: out / f"{_file_name(t)}.{kind}" for t in requested}
    if len({*files.values()}) < len(files):
        raise BadInput("two topics would be written to one file", bag.path)
    rows = dict.fromkeys(requested, 0)
    with ExitStack() as stack:
        sinks = {}
        for topic in requested:
            schema = _schema(overview, topic, columns[topic])
            sinks[topic] = stack.enter_context(_sink(files[topic], schema, kind)), schema
        for topic, blocks in _batches(bag, requested):
            sink, schema = sinks[topic]
            table = _table(blocks, columns[topic], schema, kind)
            rows[topic] += table.num_rows
            sink.write_table(table)
    if kind == "csv":
        column_table = {
            str(files[t].name): {c.name: {"unit": c.unit, "field": c.source} for c in columns[t]}
            for t in requested
        }
        write_whole(out / "columns.json", json.dumps(column_table, indent=1))
    return ExportResult(files, rows, skipped)


def _file_name(topic: str) -> str:
    """Return a topic as the name of a file, which is in no other folder for any topic."""
    return re.sub(r"[^A-Za-z0-9_]", "_", topic.strip("/"))[:100]


def units_of(type_name: str, name: str) -> tuple[str, ...]:
    """Return the units in the comment of a field: one, or one for each part of a sequence."""
    comments = {field.name: field.comment for field in fields(type_name)}
    return tuple(_UNIT.findall(comments.get(name, "")))


def _reject_reason(type_name: str) -> str:
    """Return why the type does not fit into a table; empty where it does."""
    try:
        leaves(type_name)
    except BadInput as error:
        return str(error.why)
    return ""


def _widths(bag: BagReader, topics: Collection[str]) -> dict[str, dict[str, tuple[int, str]]]:
    """Return the longest length (-1 of a number) and kind of every field that occurs."""
    widths: dict[str, dict[str, tuple[int, str]]] = {topic: {} for topic in topics}
    for block in bag.blocks(topics):
        known = widths[block.topic]
        for name, column in block.columns.items():
            width = column.shape[1] if column.ndim == 2 else -1
            kind = column.dtype.str if column.dtype.kind not in "OU" else "text"
            before = known.get(name, (width, kind))
            known[name] = max(width, before[0]), before[1]
    return widths


def _columns(
    overview: Overview,
    topic: str,
    widths: dict[str, tuple[int, str]],
    kind: str,
    trust: Trust,
) -> list[_Column]:
    columns = []
    type_name = overview.types[topic]
    for name, (width, code) in widths.items():
        base = pa.string() if code == "text" else pa.from_numpy_dtype(np.dtype(code))
        units = units_of(type_name, name) if "." not in name else _stamp_unit(name)
        if width < 0:
            columns.append(_Column(name, name, None, -1, base, units[0] if units else ""))
        elif width > MAX_COLUMNS:
            whole = pa.string() if kind == "csv" else pa.list_(base)
            columns.append(_Column(name, name, None, width, whole, ", ".join(units)))
        else:
            columns += [
                _Column(
                    column_name(overview, topic, name, k, trust),
                    name,
                    k,
                    width,
                    base,
                    _unit(overview, topic, name, k, units, trust),
                )
                for k in range(width)
            ]
    return columns


def _stamp_unit(name: str) -> tuple[str, ...]:
    return {"sec": ("s",), "nanosec": ("ns",)}.get(name.rsplit(".", 1)[-1], ())


def _unit(
    overview: Overview, topic: str, field: str, k: int, units: tuple[str, ...], trust: Trust
) -> str:
    """Return the unit of the k-th value of a sequence, from the testbed or the comment."""
    if topic == "/truth" and (known := coordinate_of(overview, field, k, trust)):
        return known.unit
    of_tip = unit_of_tip(overview, k, trust) if field == "tip_deflection" else None
    return _unit_of_comment(overview, units, k) if of_tip is None else of_tip


def _unit_of_comment(overview: Overview, units: tuple[str, ...], k: int) -> str:
    """Return the unit of the k-th value of a sequence: joints first, then modes.

    Comments write `[rad or m]` for joints, `[rad or m], ... [m]` or `[rad/s, m/s]` where modes
    follow them.
    """
    if not units:
        return ""
    testbed = overview.testbed
    kinds = list(testbed.joint_units) if testbed is not None else []
    if len(units) == 1 and ", " in units[0]:
        units = (units[0].replace(", ", " or "), units[0].rsplit(", ", 1)[1])
    unit = units[0] if len(units) == 1 or k < len(kinds) else units[1]
    choices = unit.split(" or ")
    if len(choices) == 2 and k < len(kinds):
        return choices[1 if kinds[k] == "m" else 0]
    return unit


def _schema(overview: Overview, topic: str, columns: list[_Column]) -> pa.Schema:
    type_name = overview.types[topic]
    found = [
        pa.field("time", pa.float64(), metadata={"unit": "s", "meaning": "simulated time"}),
        pa.field(
            "log_time",
            pa.int64(),
            metadata={"unit": "ns", "meaning": "of the record, in the order of writing"},
        ),
    ]
    for c in columns:
        comments = {field.name: field.comment for field in fields(type_name)}
        description = comments.get(c.source.split(".")[0], "")
        found.append(pa.field(c.name, c.type, metadata={"unit": c.unit, "meaning": description}))
    names = {} if overview.testbed is None else {"joints": ",".join(overview.testbed.joint_names)}
    return pa.schema(
        found,
        metadata={"topic": topic, "type": type_name, "type_hash": type_hash(type_name), **names},
    )


def _sink(path: Path, schema: pa.Schema, kind: str) -> Any:
    """Return the writer of a table; a link at its path is replaced, never followed."""
    if path.is_symlink():
        path.unlink()
    if kind == "csv":
        return pyarrow.csv.CSVWriter(path, schema)
    return pyarrow.parquet.ParquetWriter(path, schema, compression="zstd")


def _batches(bag: BagReader, topics: Collection[str]) -> Iterator[tuple[str, list[ColumnBlock]]]:
    """Yield a topic and a batch of its blocks: about ROWS rows, or BYTES where rows are long."""
    waiting: dict[str, list[ColumnBlock]] = {topic: [] for topic in topics}
    rows, size = dict.fromkeys(topics, 0), dict.fromkeys(topics, 0)
    for block in bag.blocks(topics):
        topic = block.topic
        waiting[topic].append(block)
        rows[topic] += len(block.stamp)
        size[topic] += sum(column.nbytes for column in block.columns.values())
        if rows[topic] >= ROWS or size[topic] >= BYTES:
            yield topic, waiting[topic]
            waiting[topic], rows[topic], size[topic] = [], 0, 0
    for topic, blocks in waiting.items():
        if blocks:
            yield topic, blocks


def _table(
    blocks: list[ColumnBlock], columns: list[_Column], schema: pa.Schema, kind: str
) -> pa.Table:
    arrays = [
        pa.array(np.concatenate([_time(block) for block in blocks])),
        pa.array(np.concatenate([block.stamp for block in blocks])),
    ]
    for c in columns:
        parts = [_values(b.columns[c.source], c, kind) for b in blocks]
        arrays.append(pa.concat_arrays(parts))
    return pa.Table.from_arrays(arrays, schema=schema)


def _time(block: ColumnBlock) -> np.ndarray:
    """Return the simulated times of messages, (messages,) [s]: their stamps, else the log's."""
    for name in ("header.stamp", "stamp"):
        if f"{name}.sec" in block.columns:
            return np.asarray(
                block.columns[f"{name}.sec"] + block.columns[f"{name}.nanosec"] * 1e-9, dtype=float
            )
    return block.stamp * 1e-9


def _values(column: Any, c: _Column, kind: str) -> pa.Array:
    if c.width >= 0 and c.place is None:
        rows = [row.tolist() for row in column]
        if kind == "csv":
            return pa.array([json.dumps(row) for row in rows], type=c.type)
        return pa.array(rows, type=c.type)
    if c.place is not None:
        if c.place >= column.shape[1]:
            return pa.nulls(len(column), c.type)
        column = np.ascontiguousarray(column[:, c.place])
    return pa.array(column, type=c.type)
