"""Records of other benches: files of many formats, with columns chosen by name."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from flexslew_lab.identification.files import read_columns
from flexslew_lab.identification.files.columns import Columns, FileClock, require_times
from flexslew_lab.identification.records.clocks import Effort, clock_notes, record_on_clocks
from flexslew_lab.identification.records.rate_check import rate_notes
from flexslew_lab.identification.records.record import Output, Quantity, Record
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput

_AT_LIMIT = (0.01, 0.5)  # part of the samples at the largest value that suggests a drive's limit
_MIN_SAMPLES = 5  # samples
_CLOCK = FileClock()


class RecordWithNotes(NamedTuple):
    """A record, and notes about its gaps and clocks."""

    record: Record
    words: tuple[str, ...]


def external_record(
    path: Path,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    period: float | None = None,
    past: bool = False,
    clock: FileClock = _CLOCK,
) -> RecordWithNotes:
    """Return a record of a file of measurements or a bag, at the times of its samples.

    An input `torque_1` or `/effort.data[0]` is held until its next value; where a sample is
    missing, it is unknown. The name behind a `=` gives an output's quantity, `position.JOINT` or
    `rate.JOINT` (`/joint_states.position[0]=position.hub`) or `acc.PLACE`; any other name is a
    deflection.

    Args:
        path: of the file, see `files.READERS`, or the folder of the bag.
        inputs: columns of efforts, each `column` or `column=joint`.
        outputs: columns of sensors, each `column` or `column=name`.
        period: of the ticks [s]; None: the median of the first input's.
        past: an effort is stamped when it ends, not when it begins.
        clock: how times are read; `period` is also that between samples of a file without times.

    Raises:
        BadInput: if a column is missing or has less than two samples, a clock does not advance, or
            too many efforts are unknown.
    """
    requested = [_named(text) for text in (*inputs, *outputs)]
    if period is not None and not 0.0 < period < np.inf:
        raise BadInput("a number of seconds above 0", key="--period", value=period)
    columns = read_columns(
        path, [name for name, _ in requested], clock._replace(period=clock.period or period)
    )
    require_times(columns)
    split = len(inputs)
    words = [*columns.notes, *_clock_notes(columns)]
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
    joints = {label: columns.series[name] for name, label in requested[split:]}
    words += rate_notes(joints)
    return RecordWithNotes(record.active_channels(), tuple(words))


def _clock_notes(columns: Columns) -> list[str]:
    """Return the notes on every clock, once for all columns that share it."""
    clocks: dict[bytes, list[str]] = {}
    for name, (t, _) in columns.series.items():
        clocks.setdefault(t.tobytes(), []).append(name)
    return [
        note
        for names in clocks.values()
        for note in clock_notes(", ".join(names), columns.series[names[0]][0])
    ]


def _limited(name: str, values: Vector) -> list[str]:
    """Return a warning that the drive of an effort seems to have been at its limit; else none."""
    size = np.abs(values)
    at_limit = size >= size.max() * (1.0 - 1e-9)
    share = float(at_limit.mean())
    # a few are the top of any signal; more than the most are a signal of two values
    if at_limit.sum() < _MIN_SAMPLES or not _AT_LIMIT[0] < share < _AT_LIMIT[1]:
        return []
    return [
        f"{name}: at its largest value, {size.max():.4g}, in {share:.0%} of the samples; if that "
        "is the drive's limit, the column must hold the effort applied, not the demanded one"
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
    if kind == "acc":
        return Output(label, "m/s^2", Quantity.ACCELERATION)
    return Output(label, "m", Quantity.DEFLECTION)
