"""Recorded answers compared with those of a controller here, field by field, tick by tick."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from flexslew_lab.replay.logged_controllers import Key

FIELDS = (
    *("reference_position", "reference_velocity", "reference_orientation", "feedforward"),
    *("estimate_position", "estimate_velocity", "estimate_orientation", "estimate_disturbance"),
    "covariance_diagonal",
    *("innovation", "nis", "term_names", "terms", "effort"),
)
_LATER = frozenset({"reference_orientation", "estimate_orientation"})  # older logs have none
_PATIENCE = 5000  # ticks until what has no counterpart will have none
_BINS = 2048  # of a curve of differences


class Divergence(NamedTuple):
    """The first number that is another one."""

    epoch: int
    tick: int
    field: str  # with its place, for example effort[0]
    recorded: Any
    ours: Any


class Row(NamedTuple):
    """One field over the whole log."""

    field: str
    compared: int  # ticks
    different: int  # ticks
    first_tick: int | None
    largest: float  # |difference|, in the unit of the field
    relative: float  # of the field's largest magnitude [-]


class _Envelope:
    """The largest value of each bucket of ticks; a longer log has wider buckets."""

    def __init__(self, period: float) -> None:
        self._period, self._width = period, 1
        self._values = np.zeros(_BINS)
        self._used = 0

    def add(self, tick: int, value: float) -> None:
        """Take the value of a tick."""
        while tick // self._width >= _BINS:
            half = self._values.reshape(-1, 2).max(axis=1)
            self._values = np.concatenate((half, np.zeros(_BINS // 2)))
            self._width *= 2
        bucket = tick // self._width
        self._values[bucket] = max(self._values[bucket], value)
        self._used = max(self._used, bucket + 1)

    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Return time [s] and value."""
        time = np.arange(self._used) * self._width * self._period
        return time, self._values[: self._used]


class AnswerField:
    """One field while it is compared.

    Args:
        name: of the field.
        period: one tick [s].
        allowed: largest |difference| that counts as equal, in the unit of the field.
    """

    def __init__(self, name: str, period: float, allowed: float = 0.0) -> None:
        self.name, self.curve, self._allowed = name, _Envelope(period), allowed
        self.ticks, self.different = 0, 0
        self.first: int | None = None
        self.largest, self.magnitude = 0.0, 0.0

    def add(self, tick: int, recorded: Any, computed: Any) -> tuple[str, Any, Any] | None:
        """Compare one tick; return place and values of the first difference."""
        self.ticks += 1
        if self.name == "term_names":
            wrong = None if list(recorded) == list(computed) else (self.name, recorded, computed)
            difference = float(wrong is not None)
        else:
            place = "" if np.ndim(recorded) == 0 else "[{}]"
            wrong, difference = self._numbers(
                np.atleast_1d(recorded), np.atleast_1d(computed), self.name + place
            )
        self.curve.add(tick, difference)
        self.largest = max(self.largest, difference)
        if wrong is not None:
            self.different += 1
            self.first = tick if self.first is None else self.first
        return wrong

    def _numbers(
        self, recorded: np.ndarray, computed: np.ndarray, place: str
    ) -> tuple[tuple[str, Any, Any] | None, float]:
        self.magnitude = max(self.magnitude, float(np.abs(recorded).max(initial=0.0)))
        if recorded.shape != computed.shape:
            return (f"{self.name} (length)", recorded.size, computed.size), float("inf")
        if recorded.tobytes() == computed.tobytes():
            return None, 0.0
        other = (recorded != computed) & ~(np.isnan(recorded) & np.isnan(computed))
        if not other.any():
            return None, 0.0
        gap = np.abs(recorded - computed)
        largest = float(gap[other].max()) if np.isfinite(gap[other]).all() else float("inf")
        other &= ~(gap <= self._allowed)
        if not other.any():
            return None, largest
        k = int(np.argmax(other))
        return (place.format(k), float(recorded[k]), float(computed[k])), largest

    def row(self) -> Row:
        """Return the sum of it."""
        relative = self.largest / (self.magnitude or 1.0)
        return Row(self.name, self.ticks, self.different, self.first, self.largest, relative)


class AnswerComparison:
    """Pairs answers of the log with those of here; topics may lie in any order in a bag.

    Args:
        period: one tick [s].
        fields: names of what is compared of an answer, which also has its `effort`.
        allowed: largest |difference| by field that counts as equal; none: only equal numbers do.
    """

    def __init__(
        self,
        period: float,
        fields: Sequence[str] = FIELDS,
        allowed: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        self.period = period
        self.rows = {name: AnswerField(name, period, allowed.get(name, 0.0)) for name in fields}
        self.ticks, self.only_recorded, self.only_ours = 0, 0, 0
        self.first: Divergence | None = None
        self._recorded: dict[Key, dict[str, Any]] = {}
        self._computed: dict[Key, dict[str, Any]] = {}
        self._done: Key = (-1, -1)

    def recorded(self, key: Key, outputs: dict[str, Any]) -> None:
        """Take an answer of the log; one of a repeated question counts once."""
        if key > self._done:
            self._recorded[key] = outputs
            self._match(key)

    def ours(self, key: Key, outputs: dict[str, Any]) -> None:
        """Take an answer of the controller here."""
        if key > self._done:
            self._computed[key] = outputs
            self._match(key)

    def finish(self) -> None:
        """Count what has no counterpart."""
        for key in list(self._recorded):
            self._note_recorded_only(key)
        self.only_ours += len(self._computed)
        self._computed.clear()

    def _match(self, key: Key) -> None:
        if key not in self._recorded or key not in self._computed:
            if len(self._recorded) > _PATIENCE:
                self._note_recorded_only(next(iter(self._recorded)))
            if len(self._computed) > _PATIENCE:
                del self._computed[next(iter(self._computed))]
                self.only_ours += 1
            return
        self._done = key
        self.ticks += 1
        recorded, computed = self._recorded.pop(key), self._computed.pop(key)
        for name in self.rows:
            if name in _LATER and len(recorded[name]) < len(computed[name]):
                continue
            wrong = self.rows[name].add(key[1], recorded[name], computed[name])
            if wrong is not None:
                place = _term(recorded, wrong[0]) if name == "terms" else wrong[0]
                self._note(Divergence(*key, place, *wrong[1:]))

    def _note_recorded_only(self, key: Key) -> None:
        effort = self._recorded.pop(key)["effort"]
        self.only_recorded += 1
        self._note(Divergence(*key, "effort", effort.tolist(), None))

    def _note(self, divergence: Divergence) -> None:
        if self.first is None or divergence[:2] < self.first[:2]:
            self.first = divergence


def _term(outputs: dict[str, Any], place: str) -> str:
    """Return `terms[2]` with the name of the summand, for example `terms.proportional[0]`."""
    names, count = outputs["term_names"], len(outputs["terms"])
    if not place.endswith("]") or not len(names) or count % len(names):
        return place
    number, joint = divmod(int(place[6:-1]), count // len(names))
    return f"terms.{names[number]}[{joint}]"
