"""The same manoeuvre by every law, also on benches that are not what the laws believe."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from flexslew_control.controllers import CONTROLLERS, PD_FEEDFORWARD, PlanVariant
from flexslew_control.planners import planner_of
from flexslew_lab.comparison.comparison import (
    CARRIED,
    NO_VALUE,
    STIFFNESS,
    Candidate,
    CandidateFlight,
    CandidateResult,
    Comparison,
    Description,
    Entries,
    TableColumn,
    other_benches,
)
from flexslew_lab.comparison.flights import largest_tip
from flexslew_lab.comparison.page import PlotMetric, motion, robustness
from flexslew_lab.comparison.quantities import ComparisonMetric, quantities
from flexslew_lab.run.flight_log import FlightLog
from flexslew_lab.trial.trial import SavedPlan, Trial, law_of, plan_section_of
from flexslew_plant.arrays import Matrix
from flexslew_plant.bench.bench import Truth
from flexslew_plant.counted import count_text
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import Testbed
from flexslew_plant.testbeds.contract import Pointing, ScalableInertia

ERRORS = (-0.2, -0.1, 0.1, 0.2)  # of stiffness and inertia, relative [-]
NO_FEEDBACK = "no feedback"
_BARE = {"law": PD_FEEDFORWARD.name, "kp": [0.0], "kd": [0.0]}
_ERROR_NAMES = {STIFFNESS: "stiffness", CARRIED: "inertia"}


def laws(trial: Trial, source: str, errors: Sequence[float] = ERRORS) -> Description:
    """Return the comparison of every law on the manoeuvre of a trial.

    Each law is designed for the trial's testbed, with the trial's settings where it has some, and
    flown alone, without the schedule's switches, on that testbed and on others.

    Args:
        trial: the bench and the manoeuvre.
        source: its file, for messages.
        errors: of stiffness and of inertia, relative [-].

    Raises:
        BadInput: an error is not allowed.
    """
    if min(errors, default=0.0) <= -1.0:
        raise BadInput("each above -1", key="errors", value=list(errors))
    schedule = tuple(entry for entry in trial.schedule if entry.switch is None)
    trial = replace(trial, fallback=(), schedule=schedule, plan=plan_section_of(trial, source))
    return Description(
        trial,
        source,
        _candidates(trial),
        other_benches(trial.testbed, (0.0, *errors), errors, _scale_load),
        False,
        _metrics,
        _curves,
        lambda entries: _view(trial, entries),
    )


def _scale_load(testbed: Testbed, factor: float) -> Testbed:
    """Return a testbed with another mass and inertia of what carries the appendages."""
    if isinstance(testbed, ScalableInertia):
        return testbed.heavier(factor)
    return testbed.scaled(payload=factor)


def _candidates(trial: Trial) -> list[Candidate]:
    """Return the laws to try: the trial's own, the one in charge first, then all others."""
    names = [trial.active, *(name for name in trial.controllers if name != trial.active)]
    requested = [(name, dict(trial.controllers[name] or {})) for name in names]
    used = {law_of(name, values)[0] for name, values in requested}
    requested += [
        (law, dict(entry.compared))
        for law, entry in CONTROLLERS.items()
        if law not in used and entry.from_file is None
    ]
    requested.append((NO_FEEDBACK, _BARE))
    assert not isinstance(trial.plan, SavedPlan)
    method = "" if trial.plan is None else trial.plan.method
    law_keys = None if trial.plan is None else planner_of(trial.plan).by_law
    found = []
    for name, values in requested:
        law, _ = law_of(name, values)
        one_plan = law_keys is None or law not in CONTROLLERS
        for more, keys in (PlanVariant("", {}),) if one_plan else CONTROLLERS[law].plans:
            called = f"{name}, {more}" if more else name
            active = called.replace(" ", "_").replace(",", "")
            controllers = {active: {**values, "law": law}}
            found.append(
                Candidate(called, method, {**(law_keys or {}), **keys}, controllers, active)
            )
    return found


def _left_out(trial: Trial) -> str:
    """Return one line on the laws that have no design in the trial; empty without any."""
    used = {law_of(name, values or {})[0] for name, values in trial.controllers.items()}
    left = [n for n, entry in CONTROLLERS.items() if n not in used and entry.from_file is not None]
    words = "{0} is left out: the trial has no design for it; set controllers.{0}.file"
    return "; ".join(words.format(name) for name in left)


def _metrics(seen: FlightLog, end: float) -> dict[str, Any]:
    """Return what every flight is measured by; it is watched from the start."""
    return seen.metrics()


def _curves(seen: FlightLog, truths: Sequence[Truth]) -> Matrix:
    """Return joints, or place and turn from the goal, then tip and norm of all efforts."""
    q = np.array([truth.position for truth in truths])
    v = np.array([truth.velocity for truth in truths])
    model, testbed = seen.bench.model, seen.bench.testbed
    if isinstance(testbed, Pointing):
        end = None if seen.plan is None else seen.plan.position[-1].tolist()
        goal = {} if end is None else dict(zip(model.joint_names, end, strict=True))
        m = testbed.motions(q, v, goal)
        error = np.hstack((m.away, m.attitude))
    else:
        error = np.array([model.joint_state(x)[0] for x in np.hstack((q, v))])
    effort = np.linalg.norm([truth.applied_effort for truth in truths], axis=1)
    return np.column_stack((error, largest_tip(truths), effort))


def _curve_names(trial: Trial) -> list[tuple[str, str]]:
    """Return names and units of _curves."""
    named = list(trial.testbed.model().units_by_joint.items())
    if isinstance(trial.testbed, Pointing):
        named = [(f"platform, {axis}", "m") for axis in "xyz"]
        named += [(f"platform, attitude about {axis}", "rad") for axis in "xyz"]
    return [*named, ("largest tip deflection", "m"), ("norm of all efforts", "")]


def _view(trial: Trial, entries: Entries) -> Comparison:
    simulated = tuple(entry for entry in entries if entry.flights)
    nominal = [entry.nominal.metrics for entry in simulated]
    # what any of them has
    by = [
        q
        for q in (quantities(nominal[0]) if nominal else ())
        if any(q.of(metrics) is not None for metrics in nominal)
    ]
    plot_quantities = [q for q in by if q.drawn]
    short = [
        TableColumn(f"{q.title}{f' [{q.unit}]' if q.unit else ''}", partial(_nominal, q))
        for q in by
    ]
    worst = [TableColumn(f"{q.title}, worst", partial(_worst, q)) for q in plot_quantities]
    panels = [
        PlotMetric(
            f"{q.title} against {name}",
            q.unit,
            f"error of the {name} [%]",
            kind,
            partial(_number, q),
        )
        for q in plot_quantities
        for kind, name in _ERROR_NAMES.items()
    ]
    return Comparison(
        word="law",
        title=f"{trial.name}: every law",
        about=(
            f"{trial.testbed.kind}, {count_text(trial.testbed.modes, 'mode')}, {trial.duration:g} s"
        ),
        words="Every law is designed for the trial's testbed, with the trial's settings where it "
        "has some and its defaults otherwise, and flies the manoeuvre alone. Columns without a "
        "remark: on the nominal testbed. Worst: over all errors of stiffness and inertia.",
        note=_left_out(trial),
        entries=entries,
        numbers=lambda entry: _by_error(by, entry),
        short=short,
        columns=[*short, *worst],
        criteria=by,
        groups=[
            robustness(
                simulated,
                panels,
                "On benches whose stiffness, or whose carrier's mass and inertia, is not what "
                "every law was designed for. A law that does not hold the bench has no point "
                "there.",
                170,
            ),
            motion(simulated, _curve_names(trial)),
        ],
    )


def _by_error(by: Sequence[ComparisonMetric], entry: CandidateResult) -> dict[str, Any]:
    """Return the numbers of a law on the nominal bench, and on those with errors."""

    def numbers(flight: CandidateFlight) -> dict[str, Any]:
        found: dict[str, Any] = {q.key: q.of(flight.metrics) for q in by}
        return found | ({"lost": flight.lost} if flight.lost else {})

    return numbers(entry.nominal) | {
        f"by_{name}": {
            f"{getattr(f, kind):+g}": numbers(f) for f in entry.by(kind) if getattr(f, kind)
        }
        for kind, name in _ERROR_NAMES.items()
    }


def _nominal(quantity: ComparisonMetric, entry: CandidateResult) -> str | float:
    value = quantity.of(entry.nominal.metrics)
    return NO_VALUE if value is None else float(value)


def _worst(quantity: ComparisonMetric, entry: CandidateResult) -> str | float:
    values = [_number(quantity, flight) for flight in entry.flights]
    return max(values) if np.isfinite(values).all() else "lost"


def _number(quantity: ComparisonMetric, flight: CandidateFlight) -> float:
    """Return a quantity of a flight; NaN where the bench was lost."""
    value = None if flight.lost else quantity.of(flight.metrics)
    return float("nan") if value is None else value
