"""What a bench has done so far, tick by tick, for charts: arrays that grow and forget."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexslew_lab.log.bag_columns import pad_columns
from flexslew_plant.arrays import Matrix, Vector

LIMIT = 200_000  # ticks that are kept at most; then the older half goes


class Track:
    """Rows of one topic in the order of their ticks."""

    def __init__(self) -> None:
        self._size = 0
        self._columns: dict[str, Any] = {}  # with room at their end
        self._time = np.zeros(256)

    def add(self, time: Vector, columns: Mapping[str, Matrix]) -> None:
        """Take rows: times (n,) [s] that rise, and columns (n, width) by name."""
        if not len(time):
            return
        if self._size and time[0] <= self._time[self._size - 1]:
            self.clear()  # the bench was reset
        self._resize(len(time))
        end = self._size + len(time)
        self._time[self._size : end] = time
        for name, rows in columns.items():
            stored = self._columns.setdefault(name, np.full((len(self._time), 0), np.nan))
            width = max(stored.shape[1], rows.shape[1])
            stored = self._columns[name] = pad_columns(stored, width)
            stored[self._size : end] = pad_columns(rows, width)
        self._size = end

    def clear(self) -> None:
        """Forget everything."""
        self._size = 0
        self._columns = {}

    @property
    def time(self) -> Vector:
        """Simulated times, (rows,) [s]."""
        return self._time[: self._size]

    def column(self, name: str) -> Matrix:
        """Return the rows of a column, (rows, width); no width where it never came."""
        found = self._columns.get(name)
        return np.zeros((self._size, 0)) if found is None else found[: self._size]

    def _resize(self, more: int) -> None:
        if self._size + more > LIMIT and self._size > LIMIT // 2:
            kept = slice(self._size - LIMIT // 2, self._size)
            self._size = LIMIT // 2
            for name, rows in self._columns.items():
                rows[: self._size] = rows[kept].copy()
                self._columns[name] = rows
            self._time[: self._size] = self._time[kept].copy()
        need = self._size + more
        if need <= len(self._time):
            return
        extra = max(need, 2 * len(self._time)) - len(self._time)
        self._time = np.concatenate((self._time, np.zeros(extra)))
        for name, rows in self._columns.items():
            self._columns[name] = np.vstack((rows, np.full((extra, rows.shape[1]), np.nan)))


class Curve(NamedTuple):
    """One line of a chart."""

    label: str
    time: Vector  # rising [s]
    value: Vector
    dashed: bool = False
    color: int | None = None  # number of its colour; None: that of its place in the chart


def curve_segment(curve: Curve, start: float, end: float) -> Curve:
    """Return the part of a curve between two times [s], cut on the line where it crosses them."""
    first = max(int(np.searchsorted(curve.time, start)) - 1, 0)
    last = int(np.searchsorted(curve.time, end, side="right")) + 1
    time, value = curve.time[first:last], curve.value[first:last]
    if not len(time):
        return curve._replace(time=time, value=value)
    edges = [edge for edge in (start, end) if time[0] < edge < time[-1]]
    inner_times = time[(time >= start) & (time <= end)]
    cut = np.unique(np.concatenate((inner_times, edges)))
    return curve._replace(time=cut, value=np.interp(cut, time, value))


def reduce_samples(
    curves: list[Curve], start: float, end: float, bins: int = 300
) -> tuple[Vector, list[Vector]]:
    """Return curves on one time axis, the smallest and the largest value of each bucket kept.

    The axis runs from start to end, even where the curves have no points.

    Args:
        curves: that share a chart.
        start: of the axis [s].
        end: of the axis [s].
        bins: that the axis is divided into where there are more points than that.
    """
    parts = [curve_segment(curve, start, end) for curve in curves]
    if all(len(part.time) <= 2 * bins for part in parts):
        axis = np.unique(np.concatenate([[start, end], *(part.time for part in parts)]))
        return axis, [_on_axis(part, axis) for part in parts]
    edges = np.linspace(start, end, bins + 1)
    width = edges[1] - edges[0]
    bin_times = np.column_stack((edges[:-1] + width / 4, edges[:-1] + 3 * width / 4)).ravel()
    axis = np.concatenate(([start], bin_times, [end]))
    return axis, [_bin_extrema(part, edges) for part in parts]


def _on_axis(curve: Curve, axis: Vector) -> Vector:
    row = np.full(len(axis), np.nan)
    row[np.searchsorted(axis, curve.time)] = curve.value
    return row


def _bin_extrema(curve: Curve, edges: Vector) -> Vector:
    """Return two values of each bucket in the order in which the curve goes, NaN where empty.

    One more stands on either side, for the first and the last edge.
    """
    out = np.full((len(edges) - 1, 2), np.nan)
    bounds: NDArray[np.intp] = np.searchsorted(curve.time, edges)
    filled = np.flatnonzero(np.diff(bounds) > 0)
    if not len(filled):
        return np.full(out.size + 2, np.nan)
    part, starts = curve.value[: bounds[-1]], bounds[filled]
    low, high = np.fmin.reduceat(part, starts), np.fmax.reduceat(part, starts)
    increasing = part[bounds[filled + 1] - 1] >= part[starts]
    out[filled] = np.where(
        increasing[:, None], np.column_stack((low, high)), np.column_stack((high, low))
    )
    ends = np.where(np.isin(edges[[0, -1]], curve.time), curve.value[[0, -1]], np.nan)
    return np.concatenate((ends[:1], out.ravel(), ends[1:]))
