"""A comparison: candidates that fly one manoeuvre on a trial's bench and on others."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.plan import Plan
from flexslew_lab.comparison.flights import CaseOutcome, ComparisonJob, FlightCase, PlanCase
from flexslew_lab.comparison.quantities import ComparisonMetric
from flexslew_lab.report.panels import Group
from flexslew_lab.run.flight_log import FlightLog
from flexslew_lab.run.pool import Executor, InThisProcess, Pool
from flexslew_lab.short_values import in_columns
from flexslew_lab.trial.trial import Trial, trial_text
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.bench.bench import Truth
from flexslew_plant.errors import BadInput
from flexslew_plant.notebook_table import in_notebook
from flexslew_plant.settings import plain
from flexslew_plant.testbeds import Testbed
from flexslew_plant.yaml_data import yaml_text

STIFFNESS, CARRIED = "stiffness", "carried"  # what a bench may have otherwise
_MOTION = ("start", "duration", "position", "velocity", "effort", "state", "gains")  # of a plan


class Candidate(NamedTuple):
    """A variant of the trial."""

    name: str
    method: str  # of its plan; empty: it has none
    keys: Mapping[str, Any]  # of the plan's section, in addition to the manoeuvre
    controllers: dict[str, dict[str, Any]]
    active: str


class OtherBench(NamedTuple):
    """A testbed that may not be what planner and law believe."""

    stiffness: float  # error [-]
    carried: float  # error of the payload, or of mass and inertia of what carries appendages [-]
    testbed: Testbed


def other_benches(
    testbed: Testbed,
    stiffness: Sequence[float],
    carried: Sequence[float],
    load: Callable[[Testbed, float], Testbed],
) -> list[OtherBench]:
    """Return testbeds with errors of the stiffness, then of what is carried, where it can change.

    Args:
        testbed: the trial's testbed.
        stiffness: relative errors [-].
        carried: relative errors, each with the smallest error of the stiffness [-].
        load: returns a testbed that carries, or is, that many times as heavy.
    """
    least = min(stiffness, key=abs)
    nominal = testbed.scaled(stiffness=1.0 + least)
    stiffness_cases = [OtherBench(e, 0.0, testbed.scaled(stiffness=1.0 + e)) for e in stiffness]
    try:
        return stiffness_cases + [OtherBench(least, e, load(nominal, 1.0 + e)) for e in carried]
    except BadInput:  # it is fixed
        return stiffness_cases


@dataclass(frozen=True)
class CandidateFlight:
    """What a candidate did on one bench; see FlightOutcome."""

    stiffness: float  # errors as of OtherBench [-]
    carried: float
    metrics: Mapping[str, Any]
    lost: str
    time: Vector
    curves: Matrix


@dataclass(frozen=True)
class CandidateResult:
    """A candidate with its plan and its flights, or why there are none."""

    name: str
    plan: Plan | None
    refused: str
    flights: tuple[CandidateFlight, ...] = ()

    @property
    def nominal(self) -> CandidateFlight:
        """The flight with the smallest errors."""
        return min(self.flights, key=lambda f: (abs(f.stiffness), abs(f.carried)))

    def by(self, kind: str) -> tuple[CandidateFlight, ...]:
        """Return the flights with errors of one kind alone, the nominal one among them."""
        other = CARRIED if kind == STIFFNESS else STIFFNESS
        matching = (f for f in self.flights if getattr(f, other) == getattr(self.nominal, other))
        return tuple(sorted(matching, key=lambda flight: float(getattr(flight, kind))))


Entries = tuple[CandidateResult, ...]


NO_VALUE = "-"  # of a cell


class TableColumn(NamedTuple):
    """A column of a table."""

    title: str
    cell: Callable[[CandidateResult], str | float]


@dataclass(frozen=True, repr=False)
class Comparison:
    """What was found, as tables and pages show it."""

    word: str  # what a candidate is
    title: str
    about: str  # goal and testbed
    words: str  # how the table is read
    note: str
    entries: Entries
    numbers: Callable[[CandidateResult], dict[str, Any]]  # of one that flew, by key
    short: Sequence[TableColumn]  # for a terminal
    columns: Sequence[TableColumn]
    criteria: Sequence[ComparisonMetric]  # by which candidates are ranked
    groups: Sequence[Group]

    def __repr__(self) -> str:
        """Return one line: the candidates that flew."""
        names = ", ".join(entry.name for entry in self.simulated_entries)
        return f"<Comparison by {self.word}: {names or 'nothing'} flown of {len(self.entries)}>"

    def _repr_html_(self) -> str:
        """Return the numbers of those that flew, for notebooks."""
        columns = self.filled(self.short)
        rows = ((name, *cells) for name, cells in self.table(columns))
        return in_notebook(repr(self), [self.word, *(c.title for c in columns)], rows)

    @property
    def simulated_entries(self) -> Entries:
        """The candidates that could be flown."""
        return tuple(entry for entry in self.entries if entry.flights)

    def rows(self) -> list[dict[str, Any]]:
        """Return the numbers as plain data, one row per candidate."""
        return [
            {self.word: entry.name, "refused": entry.refused}
            | (self.numbers(entry) if entry.flights else {})
            for entry in self.entries
        ]

    def table(self, columns: Sequence[TableColumn]) -> list[tuple[str, list[str]]]:
        """Return name and cells of each candidate that flew, a column in one format."""
        rows = in_columns(([c.cell(e) for c in columns] for e in self.simulated_entries), 3)
        return [(e.name, row) for e, row in zip(self.simulated_entries, rows, strict=True)]

    def filled(self, columns: Sequence[TableColumn]) -> tuple[TableColumn, ...]:
        """Return the columns in which any candidate has a value."""
        return tuple(
            c for c in columns if any(c.cell(entry) != NO_VALUE for entry in self.simulated_entries)
        )


@dataclass(frozen=True)
class Description:
    """What is compared, and by what.

    Args:
        trial: a trial with the section of the manoeuvre as its plan, or with none.
        source: its file, for messages.
        candidates: variants of it.
        benches: benches that each flies on, with a plan for the trial's own.
        redesigned: see ComparisonJob, as for `metrics` and `curves`.
        metrics: returns the numbers of a flight.
        curves: returns the curves of a flight over time.
        view: returns the comparison of the entries.
        rest: least time of a flight after the longest plan [s]; None: the trial's duration counts.
        distinct: whether variants of a method with one plan are one candidate.
    """

    trial: Trial
    source: str
    candidates: Sequence[Candidate]
    benches: Sequence[OtherBench]
    redesigned: bool
    metrics: Callable[[FlightLog, float], dict[str, Any]]
    curves: Callable[[FlightLog, Sequence[Truth]], Matrix]
    view: Callable[[Entries], Comparison]
    rest: float | None = None
    distinct: bool = False


_CandidatePairs = list[tuple[Candidate, CandidateResult]]


def compare_candidates(
    description: Description,
    progress: Callable[[int, int], None] = lambda done, last: None,
    workers: int = 1,
) -> Comparison:
    """Return what every candidate does with the manoeuvre.

    Args:
        description: what is compared.
        progress: called with the plans and flights done and their number, at most that many at
            first.
        workers: processes that plan and fly; 1: this one.
    """
    job = ComparisonJob(
        trial_text(description.trial),
        description.source,
        description.trial.trust,
        description.redesigned,
        description.metrics,
        description.curves,
    )
    with closing(InThisProcess(job) if workers == 1 else Pool(job, workers)) as executor:
        work = _Work(executor, progress)
        pairs = _make_plans(description, work)
        if description.distinct:
            pairs = _distinct(pairs)
        return description.view(tuple(_simulate(description, pairs, work)))


@dataclass
class _Work:
    """The executor of plans and flights, and how many are done."""

    executor: Executor[PlanCase | FlightCase, CaseOutcome]
    progress: Callable[[int, int], None]
    done: int = 0

    def outcomes(
        self, cases: Sequence[PlanCase | FlightCase], later: int = 0
    ) -> dict[int, CaseOutcome]:
        """Return the outcomes by number.

        Args:
            cases: to be done.
            later: how many come after them, at most.
        """
        made: dict[int, CaseOutcome] = {}
        last = self.done + len(cases) + later
        for some in self.executor.fly(iter(cases)):
            for outcome in some:
                made[outcome.number] = outcome
                self.done += 1
                self.progress(self.done, last)
        return made


def _make_plans(description: Description, work: _Work) -> _CandidatePairs:
    """Return the candidates with their plans, or why they have none; a plan is made once."""
    if description.trial.plan is None:
        return [(c, CandidateResult(c.name, None, "")) for c in description.candidates]
    keys = [yaml_text([c.method, plain(dict(c.keys))]) for c in description.candidates]
    first_indices = {key: keys.index(key) for key in keys}
    cases = [PlanCase(k, *description.candidates[k][1:3]) for k in first_indices.values()]
    made = work.outcomes(cases, len(description.candidates) * len(description.benches))
    found = [made[first_indices[key]] for key in keys]
    return [
        (c, CandidateResult(c.name, outcome.plan, outcome.refused))
        for c, outcome in zip(description.candidates, found, strict=True)
    ]


def _distinct(pairs: _CandidatePairs) -> _CandidatePairs:
    """Leave out variants with the same plan as an earlier one of their method."""
    kept: _CandidatePairs = []
    for candidate, entry in pairs:
        others = (e.plan for c, e in kept if c.method == candidate.method)
        if not any(_same_motion(entry.plan, other) for other in others):
            kept.append((candidate, entry))
    return kept


def _same_motion(one: Plan | None, other: Plan | None) -> bool:
    return (
        one is not None
        and other is not None
        and all(np.array_equal(getattr(one, key), getattr(other, key)) for key in _MOTION)
    )


def _simulate(
    description: Description, pairs: _CandidatePairs, work: _Work
) -> list[CandidateResult]:
    """Return the entries with their flights; one that is refused on a bench has none."""
    latest_end = max((e.plan.end for _, e in pairs if e.plan is not None), default=0.0)
    duration, benches = description.trial.duration, description.benches
    if description.rest is not None:
        duration = max(duration, latest_end + description.rest)
    sections = [plain(bench.testbed) for bench in benches]
    cases = [
        FlightCase(
            k * len(benches) + b, c.controllers, c.active, entry.plan, section, duration, latest_end
        )
        for k, (c, entry) in enumerate(pairs)
        if not entry.refused
        for b, section in enumerate(sections)
    ]
    made = work.outcomes(cases)
    entries = []
    for k, (_, entry) in enumerate(pairs):
        if not entry.refused:
            outcomes = [made[k * len(benches) + b] for b in range(len(benches))]
            reason = next((o.refused for o in outcomes if o.refused), "")
            flights = tuple(
                CandidateFlight(bench.stiffness, bench.carried, *outcome.flight)
                for bench, outcome in zip(benches, outcomes, strict=True)
                if outcome.flight is not None and not reason
            )
            entry = replace(entry, refused=reason, flights=flights)
        entries.append(entry)
    return entries
