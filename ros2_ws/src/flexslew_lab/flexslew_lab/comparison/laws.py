"""The same manoeuvre by every law, also on benches that are not what the laws believe."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.controllers import CONTROLLERS, PD_FEEDFORWARD, PlanVariant
from flexslew_control.plan import Plan
from flexslew_control.planners import make_plan, plan_settings, planner_of
from flexslew_lab.comparison.flight import SHOWN, TruthLog
from flexslew_lab.comparison.quantities import ComparedQuantity, quantities
from flexslew_lab.run.in_process import Observer, fly
from flexslew_lab.run.metrics_observer import MetricsObserver
from flexslew_lab.trial.trial import (
    SavedPlan,
    Trial,
    bench_settings,
    build_controllers,
    feedback_of,
    follow,
    law_in_charge,
    law_of,
    plan_section_of,
    plant_of,
)
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.bench.bench import Bench, Truth
from flexslew_plant.errors import BadInput, PlanFailed, without_source
from flexslew_plant.events import Event
from flexslew_plant.settings import plain
from flexslew_plant.testbeds import Testbed
from flexslew_plant.testbeds.contract import ScalableInertia
from flexslew_plant.testbeds.spacecraft.motions import Pointing

ERRORS = (-0.2, -0.1, 0.1, 0.2)  # of stiffness and inertia, relative [-]
ALONE = "no feedback"
_BARE = {"law": PD_FEEDFORWARD.name, "kp": [0.0], "kd": [0.0]}


@dataclass(frozen=True)
class LawFlight:
    """What one law did on one bench."""

    stiffness: float  # error of the stiffness [-]
    inertia: float  # error of mass and inertia of what carries the appendages [-]
    metrics: dict[str, Any]
    lost: str  # why the flight could not be flown to its end; empty: it was
    time: Vector  # (samples,) [s]
    error: Matrix  # joint positions, or place and turn from the goal: see LawComparison.errors
    tip: Vector  # the largest appendage's deflection, with its sign, (samples,) [m]
    applied: Vector  # norm of all efforts, (samples,)

    @property
    def nominal(self) -> bool:
        """The bench is as the law believes."""
        return self.stiffness == self.inertia == 0.0


@dataclass(frozen=True)
class ComparedLaw:
    """One law and its flights, or why there are none."""

    name: str
    refused: str
    flights: tuple[LawFlight, ...] = ()

    @property
    def nominal(self) -> LawFlight:
        """The flight on the nominal bench."""
        return next(flight for flight in self.flights if flight.nominal)


@dataclass(frozen=True)
class LawComparison:
    """Every law on the manoeuvre of a trial."""

    trial: Trial
    errors: tuple[tuple[str, str], ...]  # name and unit of the columns of LawFlight.error
    entries: tuple[ComparedLaw, ...]

    @property
    def flown(self) -> tuple[ComparedLaw, ...]:
        """The laws that could be flown."""
        return tuple(entry for entry in self.entries if entry.flights)

    @property
    def quantities(self) -> tuple[ComparedQuantity, ...]:
        """What they are compared by: what any of them has."""
        nominal = [entry.nominal.metrics for entry in self.flown]
        requested = quantities(nominal[0]) if nominal else ()
        return tuple(q for q in requested if any(q.of(m) is not None for m in nominal))

    def rows(self) -> list[dict[str, Any]]:
        """Return the numbers as plain data, one row per law."""
        out: list[dict[str, Any]] = []
        for entry in self.entries:
            row: dict[str, Any] = {"law": entry.name, "refused": entry.refused}
            if entry.flights:
                row |= self._numbers(entry.nominal)
                for kind in ("stiffness", "inertia"):
                    row[f"by_{kind}"] = {
                        f"{getattr(f, kind):+g}": self._numbers(f)
                        for f in entry.flights
                        if getattr(f, kind)
                    }
            out.append(row)
        return out

    def _numbers(self, flight: LawFlight) -> dict[str, Any]:
        found: dict[str, Any] = {q.key: q.of(flight.metrics) for q in self.quantities}
        return found | ({"lost": flight.lost} if flight.lost else {})


def compared_laws(
    trial: Trial,
    source: str,
    progress: Callable[[int, int], None] = lambda done, last: None,
    errors: Sequence[float] = ERRORS,
) -> LawComparison:
    """Return what every law does with the manoeuvre of a trial.

    Each law is designed for the trial's testbed, with the trial's settings where it has some, and
    flown alone, without the schedule's switches, on that testbed and on others.

    Args:
        trial: the bench and the manoeuvre.
        source: its file, for messages.
        progress: called with the flights done and their number.
        errors: of stiffness and of inertia, relative [-].

    Raises:
        BadInput: an error is not allowed.
    """
    if min(errors, default=0.0) <= -1.0:
        raise BadInput("each above -1", key="errors", value=list(errors))
    schedule = tuple(entry for entry in trial.schedule if entry.switch is None)
    trial = replace(trial, fallback=(), schedule=schedule, plan=plan_section_of(trial, source))
    benches = _benches(trial, errors)
    candidates = _candidates(trial)
    last = len(candidates) * len(benches)
    entries: list[ComparedLaw] = []
    for k, candidate in enumerate(candidates):
        try:
            plan = _plan(trial, source, candidate.plan)
            flights = []
            for bench in benches:
                flights.append(_flight(trial, source, candidate, plan, bench))
                progress(k * len(benches) + len(flights), last)
            entries.append(ComparedLaw(candidate.name, "", tuple(flights)))
        except (BadInput, PlanFailed) as refused:
            words = without_source(refused)
            entries.append(ComparedLaw(candidate.name, words))
            progress((k + 1) * len(benches), last)
    return LawComparison(trial, _error_names(trial), tuple(entries))


class _Candidate(NamedTuple):
    """A law to try."""

    name: str
    values: dict[str, Any]  # its section of the trial
    plan: dict[str, Any]  # keys of the plan that it wants otherwise


class _OtherBench(NamedTuple):
    """A bench that may not be what the law believes."""

    stiffness: float  # error [-]
    inertia: float  # error [-]
    testbed: Testbed


def _benches(trial: Trial, errors: Sequence[float]) -> list[_OtherBench]:
    """Return the trial's testbed, then those with errors of stiffness and of inertia."""
    stiffer = [_OtherBench(e, 0.0, trial.testbed.scaled(stiffness=1.0 + e)) for e in errors]
    try:
        heavier = [_OtherBench(0.0, e, _heavier(trial.testbed, 1.0 + e)) for e in errors]
    except BadInput:  # its payload is fixed
        heavier = []
    return [_OtherBench(0.0, 0.0, trial.testbed), *stiffer, *heavier]


def _heavier(testbed: Testbed, factor: float) -> Testbed:
    """Return a testbed with another mass and inertia of what carries the appendages."""
    if isinstance(testbed, ScalableInertia):
        return testbed.heavier(factor)
    return testbed.scaled(payload=factor)


def _candidates(trial: Trial) -> list[_Candidate]:
    """Return the laws to try: the trial's own, the one in charge first, then all others."""
    names = [trial.active, *(name for name in trial.controllers if name != trial.active)]
    requested = [(name, dict(trial.controllers[name] or {})) for name in names]
    used = {law_of(name, values)[0] for name, values in requested}
    requested += [(law, dict(CONTROLLERS[law].compared)) for law in CONTROLLERS if law not in used]
    requested.append((ALONE, _BARE))
    assert not isinstance(trial.plan, SavedPlan)
    usual = None if trial.plan is None else planner_of(trial.plan).by_law
    found = []
    for name, values in requested:
        law, _ = law_of(name, values)
        own = {**values, "law": law}
        plans = CONTROLLERS[law].plans if law in CONTROLLERS else (PlanVariant("", {}),)
        if usual is None:
            found.append(_Candidate(name, own, {}))
        else:
            for more, keys in plans:
                called = f"{name}, {more}" if more else name
                found.append(_Candidate(called, own, {**usual, **keys}))
    return found


def _plan(trial: Trial, source: str, changes: dict[str, Any]) -> Plan | None:
    """Return the trial's plan with some keys changed."""
    if trial.plan is None:
        return None
    settings = plan_settings({**plain(trial.plan), **changes}, f"{source}: plan")
    return make_plan(settings, plant_of(trial), feedback_of(trial), law=law_in_charge(trial))


def _flight(
    trial: Trial, source: str, candidate: _Candidate, plan: Plan | None, other: _OtherBench
) -> LawFlight:
    """Return the flight of a law, designed for the trial's testbed, on another bench.

    Raises:
        BadInput: there is no such law for this testbed, or it does not take the plan.
    """
    name = candidate.name.replace(" ", "_").replace(",", "")
    trial = replace(trial, controllers={name: candidate.values}, active=name)
    bench = Bench(bench_settings(replace(trial, testbed=other.testbed)))
    controllers = build_controllers(trial, bench, source)
    refused = follow(controllers, name, plan) or controllers[name].reason
    if refused is not None:
        raise BadInput(refused)
    observer = _Measured(MetricsObserver(bench, plan), TruthLog())
    fly(bench, controllers, observer)
    metrics = observer.metrics.result()
    return _shown(bench, metrics, observer.truth_log.truths, plan, other)


class _Measured(Observer):
    """Measures and keeps the truth."""

    def __init__(self, metrics: MetricsObserver, truth_log: TruthLog) -> None:
        self.metrics, self.truth_log = metrics, truth_log

    def truth(self, truth: Truth) -> None:
        """Take the state at a tick."""
        self.metrics.truth(truth)
        self.truth_log.truth(truth)

    def event(self, event: Event) -> None:
        """Take an event."""
        self.metrics.event(event)


def _shown(
    bench: Bench,
    metrics: dict[str, Any],
    truths: list[Truth],
    plan: Plan | None,
    other: _OtherBench,
) -> LawFlight:
    rows = np.unique(np.linspace(0, len(truths) - 1, SHOWN).astype(int))
    seen = [truths[row] for row in rows]
    # with a zero, so that there is one where nothing deflects
    tips = np.array([(*truth.tip_deflection, 0.0) for truth in seen])
    largest = np.abs(tips).argmax(axis=1)[:, None]
    q = np.array([truth.position for truth in seen])
    v = np.array([truth.velocity for truth in seen])
    if isinstance(bench.testbed, Pointing):
        names = bench.model.joint_names
        goal = {} if plan is None else dict(zip(names, plan.position[-1].tolist(), strict=True))
        m = bench.testbed.motions(q, v, goal)
        error = np.hstack((m.away, m.attitude))
    else:
        error = np.array([bench.model.joint_state(x)[0] for x in np.hstack((q, v))])
    return LawFlight(
        other.stiffness,
        other.inertia,
        metrics,
        bench.failure,
        np.array([truth.time for truth in seen]),
        error,
        np.take_along_axis(tips, largest, axis=1)[:, 0],
        np.linalg.norm([truth.applied_effort for truth in seen], axis=1),
    )


def _error_names(trial: Trial) -> tuple[tuple[str, str], ...]:
    """Return name and unit of the columns of LawFlight.error."""
    if isinstance(trial.testbed, Pointing):
        axes = ("x", "y", "z")
        return (
            *((f"platform, {axis}", "m") for axis in axes),
            *((f"platform, attitude about {axis}", "rad") for axis in axes),
        )
    model = trial.testbed.model()
    return tuple(zip(model.joint_names, model.joint_units, strict=True))
