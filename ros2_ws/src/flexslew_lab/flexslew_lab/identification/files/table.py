"""Columns of a file by name: which column holds the times, their unit, and entries of matrices."""

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from flexslew_lab.identification.files.columns import UNITS, Choose, Columns, FileClock
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.near_names import spelling_hint

_TIME = ("time", "t", "stamp")  # names of a column of times
# such a name with a unit: `time [ms]`, `t_ns`, `Time (s)`
_WITH_UNIT = re.compile(r"(?:time|t|stamp|timestamp)[\s_]*[\[(]?(s|ms|us|µs|ns)?[\])]?", re.I)
_ENTRY = re.compile(r"(?P<name>.*)\[(?P<index>\d{1,6})\]")
_MOST_NAMES = 40  # in a message

Arrays: TypeAlias = Mapping[str, NDArray[Any]]
TableReader: TypeAlias = Callable[[Path, Choose], Arrays]


def table_columns(read: TableReader, path: Path, names: list[str], clock: FileClock) -> Columns:
    """Return columns of a file in which all share one clock.

    A name is that of a column, or `name[index]` for a column of a matrix.

    Args:
        read: reader of the format; returns the arrays that it is asked for.
        path: of the file.
        names: of the columns.
        clock: how times are read.

    Raises:
        BadInput: if the file cannot be read, a column is missing, or there are no times.
    """
    chosen: list[str | None] = []

    def choose(available: tuple[str, ...]) -> tuple[str, ...]:
        found = _listed(available)
        time = _time_name(available, clock)
        if time is None and clock.period is None:
            raise BadInput(
                f"no column of times; call it {', '.join(_TIME)}, name it by --time, or give "
                f"--period; the header is: {found}",
                path,
            )
        chosen.append(time)
        wanted = [] if time is None else [time]
        for name in names:
            array = _array_name(name, available)
            if array is None:
                hint = spelling_hint(name, list(available))
                raise BadInput(f"no column {name}; {hint}the header is: {found}", path)
            wanted.append(array)
        return tuple(dict.fromkeys(wanted))

    arrays = read(path, choose)
    (time,) = chosen
    values = {name: _vector(path, name, arrays) for name in names}
    rows = {name: len(one) for name, one in values.items()}
    if time is None:
        assert clock.period is not None
        t = clock.period * np.arange(max(rows.values()), dtype=np.float64)
    else:
        t = _seconds(path, time, _vector(path, time, arrays), clock)
    for name, count in rows.items():
        if count != len(t):
            raise BadInput(f"{name} has {count} values and the times {len(t)}", path)
    numbers = {name: one.astype(np.float64) for name, one in values.items()}
    return Columns({name: (t, one) for name, one in numbers.items()}, str(path))


def _listed(names: tuple[str, ...]) -> str:
    more = f"; and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return "; ".join(f"{name:.60}" for name in names[:_MOST_NAMES]) + more


def _time_name(available: tuple[str, ...], clock: FileClock) -> str | None:
    """Return the name of the column of times; None: there is none.

    Raises:
        BadInput: if the one that was named is missing.
    """
    if clock.column is not None:
        if clock.column not in available:
            hint = spelling_hint(clock.column, list(available))
            raise BadInput(
                f"no such column; {hint}the header is: {_listed(available)}",
                key="--time",
                value=clock.column,
            )
        return clock.column
    exact = [name for name in _TIME if name in available]
    near = [name for name in available if _WITH_UNIT.fullmatch(name)]
    return next(iter(exact + near), None)


def _seconds(path: Path, name: str, times: NDArray[Any], clock: FileClock) -> Vector:
    """Return times in seconds, those of a calendar from the first one."""
    if times.dtype.kind in "mM":
        if clock.unit is not None:
            raise BadInput(f"{name} holds times with a unit; leave out --time-unit", path)
        return np.asarray((times - times[:1]) / np.timedelta64(1, "s"), dtype=np.float64)
    match = _WITH_UNIT.fullmatch(name)
    named = (match[1] or "s").lower().replace("µ", "u") if match else "s"
    factor = UNITS[clock.unit or named]
    if factor == 1.0:
        return np.asarray(times, dtype=np.float64)
    return np.asarray((times - times[:1]) * factor, dtype=np.float64)


def _array_name(name: str, available: tuple[str, ...]) -> str | None:
    if name in available:
        return name
    match = _ENTRY.fullmatch(name)
    return match["name"] if match and match["name"] in available else None


def _vector(path: Path, name: str, arrays: Arrays) -> NDArray[Any]:
    """Return a column of numbers or times.

    Raises:
        BadInput: if it is none.
    """
    if (array := arrays.get(name)) is not None:
        column = array.ravel() if array.size == max(array.shape, default=1) else array
        if column.ndim == 1 and column.dtype.kind in "biufmM":
            return column
        if column.ndim == 2 and min(column.shape) > 0:
            count = min(column.shape)
            raise BadInput(f"{name} has {count} columns; write {name}[0] to {name}[{count - 1}]",
                           path)  # fmt: skip
        raise BadInput(f"{name} is no column of real numbers", path)
    match = _ENTRY.fullmatch(name)
    assert match is not None
    matrix, index = arrays[match["name"]], int(match["index"])
    if matrix.ndim != 2 or matrix.dtype.kind not in "biuf":
        raise BadInput(f"{match['name']} is no matrix of real numbers", path)
    matrix = matrix if matrix.shape[0] >= matrix.shape[1] else matrix.T
    if index >= matrix.shape[1]:
        raise BadInput(f"{name}: {match['name']} has {matrix.shape[1]} columns", path)
    return np.asarray(matrix[:, index])
