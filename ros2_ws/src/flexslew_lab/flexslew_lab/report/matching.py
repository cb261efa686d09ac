"""Rows of two topics that belong together: those of one epoch and tick."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexslew_plant.arrays import Matrix


class Waiting:
    """Rows by epoch and tick that wait for those of another topic."""

    def __init__(self) -> None:
        self._parts: list[tuple[NDArray[np.uint64], Matrix]] = []  # of one width each

    def add(self, keys: NDArray[np.uint64], rows: Matrix) -> None:
        """Take rows, newer than those before."""
        if self._parts and self._parts[-1][1].shape[1] == rows.shape[1]:
            before = self._parts.pop()
            keys = np.concatenate((before[0], keys))
            rows = np.concatenate((before[1], rows))
        self._parts.append((keys, rows))

    def matched(self, other: "Waiting") -> list[tuple[Matrix, Matrix]]:
        """Return rows of both with equal keys, in order; forget what will find no counterpart."""
        found = []
        for keys, rows in self._parts:
            for other_keys, other_rows in other._parts:
                _, indices, other_indices = np.intersect1d(keys, other_keys, return_indices=True)
                if indices.size:
                    found.append((rows[indices], other_rows[other_indices]))
        if self._parts and other._parts:
            last = min(self._last, other._last)
            self._discard_old(last)
            other._discard_old(last)
        return found

    @property
    def _last(self) -> int:
        return max(int(keys.max(initial=0)) for keys, _ in self._parts)

    def _discard_old(self, last: int) -> None:
        kept = [(keys, rows, keys > np.uint64(last)) for keys, rows in self._parts]
        self._parts = [(k[recent], r[recent]) for k, r, recent in kept if recent.any()]


def keys_of(columns: Mapping[str, Any]) -> NDArray[np.uint64]:
    """Return epoch and tick as one number that rises, (rows,)."""
    keys = (columns["epoch"].astype(np.uint64) << np.uint64(40)) + columns["tick"].astype(np.uint64)
    return np.asarray(keys)
