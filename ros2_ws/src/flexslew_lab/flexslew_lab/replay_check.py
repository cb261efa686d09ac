"""Recorded measurements into a controller: is every number that it says the recorded one?"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.controller import Answer, Controller
from flexslew_lab.bag_reader import BagReader
from flexslew_lab.cdr import decode
from flexslew_lab.crew import Crew, Key, logged_laws
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement

FIELDS = (
    *("reference_position", "reference_velocity", "feedforward"),
    *("estimate_position", "estimate_velocity", "estimate_disturbance", "covariance_diagonal"),
    *("innovation", "nis", "term_names", "terms", "effort"),
)
_PATIENCE = 5000  # ticks until what has no counterpart will have none
_BUCKETS = 2048  # of a curve of differences


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


class Check(NamedTuple):
    """A controller beside its log."""

    controller: str
    law: str
    ok: bool  # no number is another one, no recorded answer is missing
    ticks: int  # compared
    only_recorded: int  # ticks that only the log answers
    only_ours: int  # ticks that only the controller here answers: the other one was not heard
    first_divergence: Divergence | None
    rows: tuple[Row, ...]
    curves: dict[str, tuple[np.ndarray, np.ndarray]]  # field: time [s], largest |difference|


def check(
    bag: Path,
    controller: str,
    law: str | None = None,
    settings: Mapping[str, Any] | None = None,
    progress: Callable[[int, int], None] = lambda tick, last: None,
) -> Check:
    """Return how a controller answers the measurements of a log, field by field.

    Args:
        bag: the bag's folder or file.
        controller: its name in the log.
        law: that stands in for the recorded one, with its own defaults.
        settings: that replace the recorded ones key by key.
        progress: called with the tick and the last tick.

    Raises:
        BadInput: the controller is not in the log, or the law cannot be built.
    """
    reader = BagReader(bag)
    laws = logged_laws(reader)
    if controller not in laws:
        raise BadInput(f"{reader.path}: no controller {controller}; it has {', '.join(laws)}")
    recorded_law, values = laws[controller]
    own = {} if law is not None and law != recorded_law else values
    chosen = law or recorded_law, {**own, **(settings or {})}
    crew = Crew(reader, only=controller, replaced={controller: chosen})
    pairs = _Pairs(float(reader.overview.testbed.period))
    last = reader.overview.counts.get("/measurement", 0)
    for topic, kind, _, _, data in reader.messages(("/measurement", "/controller_state")):
        message = decode(kind, data)
        key = int(message.epoch), int(message.tick)
        if topic == "/controller_state":
            if message.controller == controller:
                pairs.recorded(key, {name: getattr(message, name) for name in FIELDS})
            continue
        crew.adopt_until(key)
        answer = _observe(crew.controllers[controller], message, pairs.period)
        if answer is not None:
            pairs.ours(key, _outputs(answer))
        if message.tick % 1000 == 0:
            progress(int(message.tick), last)
    pairs.finish()
    if not pairs.ticks and not pairs.only_recorded:
        raise BadInput(f"{reader.path}: {controller} has not answered in this log")
    ok = pairs.first is None
    rows = tuple(pairs.rows[name].row() for name in FIELDS)
    curves = {name: pairs.rows[name].curve.points() for name in FIELDS if pairs.rows[name].ticks}
    return Check(
        controller, chosen[0], ok, pairs.ticks, pairs.only_recorded, pairs.only_ours,
        pairs.first, rows, curves,
    )  # fmt: skip


def difference_figure(result: Check) -> Any:
    """Return the largest difference of every field over time, a plotly figure."""
    import plotly.graph_objects as go

    figure = go.Figure()
    for name, (time, value) in result.curves.items():
        if value.any():
            figure.add_scatter(x=time, y=np.where(value > 0.0, value, np.nan), name=name)
    if not figure.data:
        figure.add_annotation(text="no difference", showarrow=False, xref="paper", yref="paper")
    figure.update_layout(
        title_text=f"{result.controller} ({result.law}): |recorded - here|",
        xaxis_title="time [s]",
        yaxis={"type": "log", "title": "unit of the field", "exponentformat": "power"},
        template="plotly_white",
    )
    return figure


def _observe(controller: Controller, m: Any, period: float) -> Answer | None:
    return controller.observe(
        Measurement(
            int(m.tick),
            int(m.epoch),
            int(m.tick) * period,
            m.controller,
            m.joint_position,
            m.joint_velocity,
            m.tip_deflection,
            m.root_curvature,
            m.applied_effort,
        )
    )


def _outputs(answer: Answer) -> dict[str, Any]:
    """Return what the controller's node would publish on controller_state."""
    command, reference, estimate, terms = answer
    return {
        "reference_position": reference.position,
        "reference_velocity": reference.velocity,
        "feedforward": reference.effort,
        "estimate_position": estimate.position,
        "estimate_velocity": estimate.velocity,
        "estimate_disturbance": estimate.disturbance,
        "covariance_diagonal": np.diagonal(estimate.covariance),
        "innovation": estimate.innovation,
        "nis": estimate.nis,
        "effort": command.effort,
        "term_names": list(terms),
        "terms": np.concatenate([*terms.values(), np.zeros(0)]),
    }


def _term(outputs: dict[str, Any], place: str) -> str:
    """Return `terms[2]` with the name of the summand, for example `terms.proportional[0]`."""
    names, count = outputs["term_names"], len(outputs["terms"])
    if not place.endswith("]") or not len(names) or count % len(names):
        return place
    number, joint = divmod(int(place[6:-1]), count // len(names))
    return f"terms.{names[number]}[{joint}]"


class _Envelope:
    """The largest value of each bucket of ticks; a longer log has wider buckets."""

    def __init__(self, period: float) -> None:
        self._period, self._width = period, 1
        self._values = np.zeros(_BUCKETS)
        self._used = 0

    def add(self, tick: int, value: float) -> None:
        """Take the value of a tick."""
        while tick // self._width >= _BUCKETS:
            half = self._values.reshape(-1, 2).max(axis=1)
            self._values = np.concatenate((half, np.zeros(_BUCKETS // 2)))
            self._width *= 2
        bucket = tick // self._width
        self._values[bucket] = max(self._values[bucket], value)
        self._used = max(self._used, bucket + 1)

    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Return time [s] and value."""
        time = np.arange(self._used) * self._width * self._period
        return time, self._values[: self._used]


class _Field:
    """One field while it is compared."""

    def __init__(self, name: str, period: float) -> None:
        self.name, self.curve = name, _Envelope(period)
        self.ticks, self.different = 0, 0
        self.first: int | None = None
        self.largest, self.magnitude = 0.0, 0.0

    def add(self, tick: int, recorded: Any, ours: Any) -> tuple[str, Any, Any] | None:
        """Compare one tick; return place and values of the first difference."""
        self.ticks += 1
        if self.name == "term_names":
            wrong = None if list(recorded) == list(ours) else (self.name, recorded, ours)
            difference = float(wrong is not None)
        else:
            wrong, difference = self._numbers(np.atleast_1d(recorded), np.atleast_1d(ours))
        self.curve.add(tick, difference)
        if wrong is not None:
            self.different += 1
            self.first = tick if self.first is None else self.first
            self.largest = max(self.largest, difference)
        return wrong

    def _numbers(
        self, recorded: np.ndarray, ours: np.ndarray
    ) -> tuple[tuple[str, Any, Any] | None, float]:
        self.magnitude = max(self.magnitude, float(np.abs(recorded).max(initial=0.0)))
        if recorded.shape != ours.shape:
            return (f"{self.name} (length)", recorded.size, ours.size), float("inf")
        if recorded.tobytes() == ours.tobytes():
            return None, 0.0
        other = (recorded != ours) & ~(np.isnan(recorded) & np.isnan(ours))
        if not other.any():
            return None, 0.0
        k = int(np.argmax(other))
        place = f"{self.name}[{k}]" if self.name != "nis" else self.name
        gap = np.abs(recorded - ours)[other]
        largest = float(gap.max()) if np.isfinite(gap).all() else float("inf")
        return (place, float(recorded[k]), float(ours[k])), largest

    def row(self) -> Row:
        """Return the sum of it."""
        relative = self.largest / (self.magnitude or 1.0)
        return Row(self.name, self.ticks, self.different, self.first, self.largest, relative)


class _Pairs:
    """Brings answers of the log and of here together; topics may lie in any order in a bag."""

    def __init__(self, period: float) -> None:
        self.period = period
        self.rows = {name: _Field(name, period) for name in FIELDS}
        self.ticks, self.only_recorded, self.only_ours = 0, 0, 0
        self.first: Divergence | None = None
        self._recorded: dict[Key, dict[str, Any]] = {}
        self._ours: dict[Key, dict[str, Any]] = {}
        self._done: Key = (-1, -1)

    def recorded(self, key: Key, outputs: dict[str, Any]) -> None:
        """Take an answer of the log; one of a repeated question counts once."""
        if key > self._done:
            self._recorded[key] = outputs
            self._match(key)

    def ours(self, key: Key, outputs: dict[str, Any]) -> None:
        """Take an answer of the controller here."""
        if key > self._done:
            self._ours[key] = outputs
            self._match(key)

    def finish(self) -> None:
        """Count what has no counterpart."""
        for key in list(self._recorded):
            self._alone(key)
        self.only_ours += len(self._ours)
        self._ours.clear()

    def _match(self, key: Key) -> None:
        if key not in self._recorded or key not in self._ours:
            if len(self._recorded) > _PATIENCE:
                self._alone(next(iter(self._recorded)))
            if len(self._ours) > _PATIENCE:
                del self._ours[next(iter(self._ours))]
                self.only_ours += 1
            return
        self._done = key
        self.ticks += 1
        theirs, mine = self._recorded.pop(key), self._ours.pop(key)
        for name in FIELDS:
            wrong = self.rows[name].add(key[1], theirs[name], mine[name])
            if wrong is not None:
                place = _term(theirs, wrong[0]) if name == "terms" else wrong[0]
                self._note(Divergence(*key, place, *wrong[1:]))

    def _alone(self, key: Key) -> None:
        effort = self._recorded.pop(key)["effort"]
        self.only_recorded += 1
        self._note(Divergence(*key, "effort", effort.tolist(), None))

    def _note(self, divergence: Divergence) -> None:
        if self.first is None or divergence[:2] < self.first[:2]:
            self.first = divergence
