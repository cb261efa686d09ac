"""Trials side by side, tick by tick, with actions from outside added to the efforts of their law.

They are those that `fleet` flies to their ends; the flights and their metrics are the same.
"""

from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import typed

from flexslew_lab.studies.batch.batch_metrics import BatchMetrics
from flexslew_lab.studies.batch.fleet import FAR, BatchRunner, ReadyTrial, batch_flight
from flexslew_lab.studies.batch.groups.rows import Rows
from flexslew_lab.studies.batch.legs import BatchFlight
from flexslew_lab.studies.batch.recorded import TICKS, RecordedMetrics, stamp_columns
from flexslew_lab.studies.batch.stepped_loop import RunningTerms, StepArrays, StepGroup
from flexslew_lab.studies.cases import Case
from flexslew_lab.studies.ways import Way
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH

_NONE = np.empty((0, 0, 0))

Metrics = dict[str, float | None]


class RunningTerm(NamedTuple):
    """A term of a running score: weight / (1 + value / half)."""

    metric: str  # one of RUNNING
    weight: float
    half: float


# metrics that only grow during a flight: where their parts stand, and whether they are added up
RUNNING: Mapping[str, tuple[Callable[[Rows], tuple[int, int]], bool]] = {
    "residual_tip_deflection": (lambda rows: (rows.residual_tip, rows.residual), False),
    "peak_tip_deflection": (lambda rows: (rows.peak_tip, rows.terminal), False),
    "residual_attitude_error": (lambda rows: (rows.residual, rows.limit_excess), False),
    "peak_effort": (lambda rows: (rows.peak_effort, rows.square_sum), False),
    "control_effort": (lambda rows: (rows.square_sum, rows.saturated), True),
    "saturated_time": (lambda rows: (rows.saturated, rows.tip_rate), True),
}


class _Group(NamedTuple):
    """A group of members, and what its metrics need."""

    ready: list[ReadyTrial]
    places: list[int]
    flight: BatchFlight
    stepped: StepGroup
    start: Any  # joint positions, (joints, BATCH_WIDTH)
    recorded: list[RecordedMetrics]  # of each member; none: the loop counts


class SteppedBatch:
    """Trials at a tick.

    Their trials last a tick longer than the flights: the last tick is read, and nothing acts after.

    Args:
        runner: of the study that the trials are of.
        cases: the trials.
        span: effort of an action of one, as a share of the limit.
        terms: of the running score, of metrics of RUNNING.

    Raises:
        BadInput: batches do not fly a trial; the message gives the reason.
    """

    def __init__(
        self, runner: BatchRunner, cases: Sequence[Case], span: float, terms: Sequence[RunningTerm]
    ) -> None:
        self._span, self._source = span, runner.study.source
        together: dict[Hashable, list[tuple[int, ReadyTrial]]] = {}
        for place, (_, ready) in enumerate(runner.all_ready(cases)):
            if isinstance(ready, Way):
                words = f"a batch does not fly it ({ready.removeprefix('bench: ')})"
                raise BadInput(f"{words}; fly members one by one", self._source)
            if len(ready.law.segments) > 1 or ready.law.segments[0].form.shared is not None:
                words = "an action is added to the efforts of one law without an allocation"
                raise BadInput(f"a batch does not fly it: {words}", self._source)
            together.setdefault(ready.group, []).append((place, ready))
        self._groups = [
            self._made(some[first : first + BATCH_WIDTH])
            for some in together.values()
            for first in range(0, len(some), BATCH_WIDTH)
        ]
        by_loop: dict[Any, list[_Group]] = {}
        for group in self._groups:
            by_loop.setdefault(group.flight.parts[0], []).append(group)
        self._loops = [
            (step, typed.List([one.stepped for one in some]), _running(terms, some[0].flight.rows))
            for step, some in by_loop.items()
        ]
        self.ticks = len(self._groups[0].ready[0].law.schedule.time) - 2
        self.tick, self._begin = -1, 0

    @staticmethod
    def size_of(ready: ReadyTrial) -> int:
        """Return how many numbers the truth of a member has at a tick."""
        model = ready.member.model
        return model.positions + model.coordinates + model.joints

    def _made(self, some: Sequence[tuple[int, ReadyTrial]]) -> _Group:
        places, ready = [place for place, _ in some], [one for _, one in some]
        flight = batch_flight(ready, stepped=True)
        _, numbers, w, z, memory = flight.parts
        model, prepared, record = ready[0].member.model, ready[0].law, _NONE
        recorded = list[RecordedMetrics]()
        if ready[0].recorded:
            record = np.empty((BATCH_WIDTH, TICKS, self.size_of(ready[0])))
            recorded = [RecordedMetrics(r.member, prepared.goal, self._source) for r in ready]
        draws = _NONE if flight.instruments is None else flight.instruments.draw(1)
        efforts = np.array([reference.effort for reference in prepared.references])
        stepped = StepGroup(
            numbers, w, z, memory, flight.feedforward, efforts, record, draws,
            np.array(places), np.zeros(BATCH_WIDTH),
        )  # fmt: skip
        start = w[: model.joints * BATCH_WIDTH].reshape(-1, BATCH_WIDTH).copy()
        return _Group(ready, places, flight, stepped, start, recorded)

    def step(self, arrays: StepArrays) -> None:
        """Let the actions act for a tick, then write observations and rewards of the next one.

        The first step reads tick 0 and nothing acts; a reward is the growth of the running score.
        """
        self.tick += 1
        if self.tick > 0:
            for group in self._groups:
                if group.flight.instruments is not None:
                    group.stepped.draws[:] = group.flight.instruments.draw(1)
        for step, groups, running in self._loops:
            step(groups, self.tick, self._begin, self._span, running, arrays)
        if self.tick + 1 - self._begin == TICKS or self.tick == self.ticks:
            self._measure()

    def _measure(self) -> None:
        first, last = self._begin, self.tick + 1
        for group in self._groups:
            if group.recorded:
                times = stamp_columns(first, last, group.ready[0].member.trial.period)
                for one, truth in zip(group.recorded, group.stepped.record, strict=False):
                    one.add(times, truth[: last - first])
        self._begin = last

    def running_scores(self) -> Vector:
        """Return the running score of every member, shape (members,)."""
        found = np.empty(sum(len(group.places) for group in self._groups))
        for group in self._groups:
            found[group.places] = group.stepped.score[: len(group.places)]
        return found

    def positions(self, place: int) -> Vector:
        """Return the positions of a member at this tick, shape (positions,)."""
        group = next(one for one in self._groups if place in one.places)
        rows = group.flight.w[: group.ready[0].member.model.positions * BATCH_WIDTH]
        return rows.reshape(-1, BATCH_WIDTH)[:, group.places.index(place)].copy()

    def metrics(self) -> list[Metrics | None]:
        """Return the metrics of all members at the end; None: the state of one is lost."""
        found: list[Metrics | None] = [None] * sum(len(group.places) for group in self._groups)
        for group in self._groups:
            model = group.ready[0].member.model
            states = (model.positions + model.coordinates) * BATCH_WIDTH
            far = np.abs(group.flight.w[:states].reshape(-1, BATCH_WIDTH)).max(axis=0)
            for k, (place, metrics) in enumerate(zip(group.places, _metrics(group), strict=True)):
                found[place] = metrics if far[k] < FAR else None
        return found


def _metrics(group: _Group) -> list[Metrics | None]:
    if group.recorded:
        return [one.metrics() for one in group.recorded]
    prepared = group.ready[0].law
    schedule = prepared.schedule
    flown = schedule._replace(time=schedule.time[:-1], over=schedule.over[:-1])
    members = [one.member for one in group.ready]
    counted = BatchMetrics(members, group.flight.rows, flown, prepared.goal, group.start)
    return list(counted.metrics(group.flight.w))


def _running(terms: Sequence[RunningTerm], rows: Rows) -> RunningTerms:
    """Return the terms with the places of their values."""
    spans = [RUNNING[term.metric][0](rows) for term in terms]
    first = np.array([begin for begin, _ in spans], dtype=np.int64)
    ends = np.array([end for _, end in spans], dtype=np.int64)
    return RunningTerms(
        first,
        (ends - first) // BATCH_WIDTH,
        np.array([RUNNING[term.metric][1] for term in terms], dtype=np.int64),
        np.array([term.weight for term in terms], dtype=np.float64),
        np.array([term.half for term in terms], dtype=np.float64),
    )
