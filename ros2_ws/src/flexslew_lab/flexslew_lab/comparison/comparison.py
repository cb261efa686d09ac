"""A comparison: candidates that fly one manoeuvre on a trial's bench and on others beside it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.plan import Plan
from flexslew_control.planners import other_method
from flexslew_lab.report.panels import Group
from flexslew_lab.run.flight_log import FlightLog
from flexslew_lab.run.in_process import fly
from flexslew_lab.trial.trial import SavedPlan, Trial, follow, plan_of_trial, set_up
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.bench.bench import Truth
from flexslew_plant.errors import BadInput, PlanFailed, without_source
from flexslew_plant.settings import plain, yaml_text
from flexslew_plant.testbeds import Testbed

STIFFNESS, CARRIED = "stiffness", "carried"  # what a bench may have otherwise
_SHOWN = 600  # samples of a curve
_MOTION = ("start", "duration", "position", "velocity", "effort", "state", "gains")  # of a plan


class Candidate(NamedTuple):
    """A variant of the trial."""

    name: str
    method: str  # of its plan; empty: it has none
    keys: Mapping[str, Any]  # of the plan's section, beside the manoeuvre
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
        testbed: the trial's.
        stiffness: errors, relative [-].
        carried: errors, relative, beside the smallest of the stiffness [-].
        load: returns a testbed that carries, or is, that many times as heavy.
    """
    least = min(stiffness, key=abs)
    nominal = testbed.scaled(stiffness=1.0 + least)
    stiffer = [OtherBench(e, 0.0, testbed.scaled(stiffness=1.0 + e)) for e in stiffness]
    try:
        return stiffer + [OtherBench(least, e, load(nominal, 1.0 + e)) for e in carried]
    except BadInput:  # it is fixed
        return stiffer


@dataclass(frozen=True)
class ComparedFlight:
    """What a candidate did on one bench."""

    stiffness: float  # errors as of OtherBench [-]
    carried: float
    metrics: Mapping[str, Any]
    lost: str  # why the flight could not be flown to its end; empty: it was
    time: Vector  # (samples,) [s]
    curves: Matrix  # (samples, curves of the description)


@dataclass(frozen=True)
class ComparedEntry:
    """A candidate with its plan and its flights, or why there are none."""

    name: str
    plan: Plan | None
    refused: str
    flights: tuple[ComparedFlight, ...] = ()

    @property
    def nominal(self) -> ComparedFlight:
        """The flight with the smallest errors."""
        return min(self.flights, key=lambda f: (abs(f.stiffness), abs(f.carried)))

    def by(self, kind: str) -> tuple[ComparedFlight, ...]:
        """Return the flights with errors of one kind alone, the nominal one among them."""
        other = CARRIED if kind == STIFFNESS else STIFFNESS
        alone = (f for f in self.flights if getattr(f, other) == getattr(self.nominal, other))
        return tuple(sorted(alone, key=lambda flight: float(getattr(flight, kind))))


Entries = tuple[ComparedEntry, ...]


class TableColumn(NamedTuple):
    """A column of a table."""

    title: str
    cell: Callable[[ComparedEntry], str]


@dataclass(frozen=True)
class Comparison:
    """What was found, as tables and pages show it."""

    word: str  # what a candidate is
    title: str
    about: str  # goal and testbed
    words: str  # how the table is read
    note: str
    entries: Entries
    numbers: Callable[[ComparedEntry], dict[str, Any]]  # of one that flew, by key
    short: Sequence[TableColumn]  # for a terminal
    columns: Sequence[TableColumn]
    groups: Sequence[Group]

    @property
    def flown(self) -> Entries:
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
        """Return name and cells of each candidate that flew."""
        return [(e.name, [column.cell(e) for column in columns]) for e in self.flown]


@dataclass(frozen=True)
class Description:
    """What is compared, and by what.

    Args:
        trial: with the section of the manoeuvre as its plan, or with none.
        source: its file, for messages.
        candidates: variants of it.
        benches: that each flies on, with a plan for the trial's own.
        redesigned: whether the laws are designed for the bench that they fly on, not for the
            trial's own.
        metrics: returns what a flight is compared by; it is told when the manoeuvre ends, a step
            with the longest plan beside it [s].
        curves: returns what is drawn of some ticks of a flight over time, (ticks, curves).
        view: returns what the entries show.
        rest: how long a flight is watched after the longest plan, at least; None: the trial says
            when it ends [s].
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


def compared(
    described: Description, progress: Callable[[int, int], None] = lambda done, last: None
) -> Comparison:
    """Return what every candidate does with the manoeuvre.

    Args:
        described: what is compared.
        progress: called with the flights done and their number.
    """
    made: dict[str, Plan | str] = {}
    planned = [(c, _planned(described, c, made)) for c in described.candidates]
    if described.distinct:
        planned = _distinct(planned)
    longest = max((e.plan.end for _, e in planned if e.plan is not None), default=0.0)
    trial, count = described.trial, len(described.benches)
    if described.rest is not None:
        trial = replace(trial, duration=max(trial.duration, longest + described.rest))
    last, done = count * sum(not entry.refused for _, entry in planned), 0
    entries = []
    for candidate, entry in planned:
        if not entry.refused:
            flights = []
            variant = replace(trial, controllers=candidate.controllers, active=candidate.active)
            try:
                for bench in described.benches:
                    flights.append(_flight(described, variant, entry.plan, bench, longest))
                    progress(done + len(flights), last)
                entry = replace(entry, flights=tuple(flights))
            except BadInput as refused:
                entry = replace(entry, refused=without_source(refused))
                progress(done + count, last)
            done += count
        entries.append(entry)
    return described.view(tuple(entries))


def _planned(
    described: Description, candidate: Candidate, made: dict[str, Plan | str]
) -> ComparedEntry:
    """Return a candidate with its plan, or why it has none; a plan is made once."""
    trial = described.trial
    if trial.plan is None:
        return ComparedEntry(candidate.name, None, "")
    assert not isinstance(trial.plan, SavedPlan)
    place = f"{described.source}: plan"
    try:
        section = other_method(trial.plan, candidate.method, place, **candidate.keys)
    except BadInput as refused:
        return ComparedEntry(candidate.name, None, without_source(refused))
    key = yaml_text(plain(section))
    if key not in made:
        try:
            plan = plan_of_trial(replace(trial, plan=section))
            assert plan is not None
            made[key] = plan
        except (BadInput, PlanFailed) as refused:
            made[key] = without_source(refused)
    found = made[key]
    if isinstance(found, str):
        return ComparedEntry(candidate.name, None, found)
    return ComparedEntry(candidate.name, found, "")


def _distinct(
    planned: Sequence[tuple[Candidate, ComparedEntry]],
) -> list[tuple[Candidate, ComparedEntry]]:
    """Leave out variants whose plan is that of an earlier one of their method."""
    kept: list[tuple[Candidate, ComparedEntry]] = []
    for candidate, entry in planned:
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


def _flight(
    described: Description, trial: Trial, plan: Plan | None, other: OtherBench, longest: float
) -> ComparedFlight:
    """Return the flight of a candidate on another bench than it believes in.

    Raises:
        BadInput: there is no such law for this testbed, or it does not take the plan.
    """
    if described.redesigned:
        trial = replace(trial, testbed=other.testbed)
    bench, controllers = set_up(trial, described.source, other.testbed)
    refused = follow(controllers, trial.active, plan) or controllers[trial.active].reason
    if refused is not None:
        raise BadInput(refused)
    seen = FlightLog(bench, plan)
    fly(bench, controllers, seen)
    end = plan.end if plan is not None and plan.duration else longest
    shown = np.unique(np.linspace(0, len(seen.truths) - 1, _SHOWN).astype(int))
    some = [seen.truths[row] for row in shown]
    return ComparedFlight(
        other.stiffness,
        other.carried,
        described.metrics(seen, end),
        bench.failure,
        np.array([truth.time for truth in some]),
        described.curves(seen, some),
    )


def largest_tip(truths: Sequence[Truth]) -> Vector:
    """Return the largest appendage's deflection at each tick, with its sign, (ticks,) [m]."""
    # with a zero, so that there is one where nothing deflects
    tips = np.array([(*truth.tip_deflection, 0.0) for truth in truths])
    return np.take_along_axis(tips, np.abs(tips).argmax(axis=1)[:, None], axis=1)[:, 0]
