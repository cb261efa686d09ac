"""Lines thinned for the eye: of every few rows the smallest and the largest value."""

from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Matrix, Vector

BATCH = 8192  # rows that wait before they are thinned, or one bucket where that is more


class Trace(NamedTuple):
    """Columns over time; each column has times of its own. NaN rows are gaps."""

    time: Matrix  # (points, columns) [s]
    value: Matrix  # (points, columns)


class MinMaxSampler:
    """Keeps the smallest and the largest value of every `size` rows, column by column."""

    def __init__(self, size: int) -> None:
        self._size = max(size, 1)
        self._pending: list[tuple[Vector, Matrix]] = []
        self._rows = 0
        self._done: list[tuple[Matrix, Matrix]] = []

    def add(self, time: Vector, value: Matrix) -> None:
        """Take rows, (n,) and (n, columns); a new number of columns starts after a gap."""
        if self._pending and self._pending[-1][1].shape[1] != value.shape[1]:
            self._reduce(all_rows=True)
        self._pending.append((time, value))
        self._rows += len(time)
        if self._rows >= max(self._size, BATCH):
            self._reduce()

    def gap(self) -> None:
        """Break the lines here."""
        self._reduce(all_rows=True)
        if self._done:
            gap_row = np.full((1, self._done[-1][0].shape[1]), np.nan)
            self._done.append((gap_row, gap_row))

    def trace(self) -> Trace:
        """Return what was kept."""
        self._reduce(all_rows=True)
        if not self._done:
            return Trace(np.zeros((0, 0)), np.zeros((0, 0)))
        width = max(t.shape[1] for t, _ in self._done)
        padded = [[_padded(part, width) for part in pair] for pair in self._done]
        return Trace(*(np.concatenate([pair[k] for pair in padded]) for k in (0, 1)))

    def _reduce(self, all_rows: bool = False) -> None:
        if not self._rows:
            return
        time = np.concatenate([t for t, _ in self._pending])
        value = np.concatenate([v for _, v in self._pending])
        whole = len(time) // self._size * self._size
        if self._size == 1:
            self._done.append((_repeated(time, value), value.astype(float)))
        elif whole:
            self._done.append(_min_and_max(time[:whole], value[:whole], self._size))
        if all_rows and whole < len(time):
            self._done.append(_min_and_max(time[whole:], value[whole:], len(time) - whole))
            whole = len(time)
        self._pending = [(time[whole:], value[whole:])] if whole < len(time) else []
        self._rows = len(time) - whole


def _min_and_max(time: Vector, value: Matrix, size: int) -> tuple[Matrix, Matrix]:
    """Return the smallest and largest value of each bucket with their times, in order of time."""
    intervals = len(time) // size
    grid = value[: intervals * size].reshape(intervals, size, -1)
    indices = np.sort(np.stack((grid.argmin(axis=1), grid.argmax(axis=1)), axis=1), axis=1)
    values = np.take_along_axis(grid, indices, axis=1)
    times = time[: intervals * size].reshape(intervals, size)[
        np.arange(intervals)[:, None, None], indices
    ]
    columns = value.shape[1]
    return times.reshape(-1, columns), values.reshape(-1, columns).astype(float)


def _repeated(time: Vector, value: Matrix) -> Matrix:
    return np.repeat(time[:, None], value.shape[1], axis=1)


def _padded(part: Matrix, width: int) -> Matrix:
    if part.shape[1] == width:
        return part
    padding = np.full((len(part), width - part.shape[1]), np.nan)
    return np.hstack((part, padding))
