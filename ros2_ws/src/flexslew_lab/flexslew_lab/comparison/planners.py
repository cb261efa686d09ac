"""The same manoeuvre by every method, on benches that are not what the planner believes."""

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from operator import itemgetter
from typing import Any

import numpy as np

from flexslew_control.planners import PLANNERS, Variant, planner_of
from flexslew_lab.comparison.comparison import (
    CARRIED,
    NO_VALUE,
    STIFFNESS,
    Candidate,
    CandidateResult,
    Comparison,
    Description,
    Entries,
    TableColumn,
    other_benches,
)
from flexslew_lab.comparison.flights import largest_tip
from flexslew_lab.comparison.page import PlotMetric, motion, robustness
from flexslew_lab.comparison.quantities import ComparisonMetric
from flexslew_lab.comparison.slew import (
    SlewComparison,
    duration_of,
    slew_comparison,
    tip_of,
    worst_residual,
)
from flexslew_lab.run.flight_log import FlightLog
from flexslew_lab.trial.trial import SavedPlan, Trial, plan_section_of, set_up
from flexslew_plant.arrays import Matrix
from flexslew_plant.bench.bench import Truth
from flexslew_plant.counted import count_text
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import plain
from flexslew_plant.testbeds.model import Model

ERRORS = (-0.2, -0.1, 0.0, 0.1, 0.2)  # of the stiffness, relative [-]
PAYLOAD_ERRORS = (-0.2, 0.2)  # of what the testbed carries, relative [-]
_ERROR_NAMES = {STIFFNESS: "stiffness", CARRIED: "payload"}
_OBSERVATION_TIME = 40.0  # at least, after the longest slew [s]
_BOUND = "No rigid body could do it in less than {:.3f} s with these drives. "
_WORDS = (
    "Tip: the largest deflection after the end of the slew, for errors of the stiffness and of the "
    "payload; the other columns are for the bench without errors. Overshoot: the part of the "
    "commanded move by which a joint goes beyond its goal. A step has no end: what is left is "
    "measured from the end of the longest slew on."
)


def planners(trial: Trial, source: str, errors: Sequence[float] = ERRORS) -> Description:
    """Return the comparison of every method on the manoeuvre of a trial.

    Args:
        trial: the bench, the active controller, and in `plan` the manoeuvre.
        source: its file, for messages.
        errors: relative errors of the stiffness [-].

    Raises:
        BadInput: if the trial has no manoeuvre, its controllers cannot be built, or an error is
            not allowed.
    """
    section = plan_section_of(trial, source)
    if section is None:
        raise BadInput("plan: is missing; add the manoeuvre to compare", source)
    if not errors or min(errors) <= -1.0:
        raise BadInput("one or more, each above -1", key="errors", value=list(errors))
    trial = replace(trial, plan=section)
    set_up(trial, source)[0].close()  # refused before all planning
    return Description(
        trial,
        source,
        [_candidate(trial, method, variant) for method, variant in _variants(trial)],
        other_benches(trial.testbed, errors, PAYLOAD_ERRORS, lambda t, by: t.scaled(payload=by)),
        True,
        _metrics,
        _curves,
        lambda entries: _view(trial, entries, errors),
        rest=_OBSERVATION_TIME,
        distinct=True,
    )


def _variants(trial: Trial) -> list[tuple[str, Variant]]:
    """Return the methods and their variants, the trial's own first, bare references last.

    A trial with a variant in its plan has that one first, then the method with its defaults.
    """
    assert not isinstance(trial.plan, SavedPlan | None)
    trial_planner, default_variant = planner_of(trial.plan), Variant("", {})
    others = [entry for entry in PLANNERS.values() if entry.slews and entry is not trial_planner]
    others.sort(key=lambda entry: not entry.feedforward)
    methods = {trial.plan.method: trial_planner} | {entry.name: entry for entry in others}
    found = [
        (name, variant)
        for name, entry in methods.items()
        for variant in (default_variant, *entry.variants)
    ]
    given = plain(trial.plan)
    matching_variants = [
        v for v in trial_planner.variants if _plain_keys(v) == {k: given.get(k) for k in v.keys}
    ]
    if not matching_variants:
        return found
    defaults = {item.name: item.default for item in fields(trial_planner.settings)}
    bare = Variant("", {key: defaults[key] for key in matching_variants[0].keys})
    rest = [
        c
        for c in found
        if c
        not in ((trial_planner.name, default_variant), (trial_planner.name, matching_variants[0]))
    ]
    return [(trial_planner.name, matching_variants[0]), (trial_planner.name, bare), *rest]


def _plain_keys(variant: Variant) -> dict[str, Any]:
    """Return the keys of a variant as a section holds them as plain data."""
    return {k: list(v) if isinstance(v, tuple) else v for k, v in variant.keys.items()}


def _candidate(trial: Trial, method: str, variant: Variant) -> Candidate:
    """Return a method with what it needs to plan the trial's manoeuvre in the same time."""
    assert not isinstance(trial.plan, SavedPlan | None)
    given = planner_of(trial.plan)
    requested = given if method == trial.plan.method else PLANNERS[method]
    keys: dict[str, Any] = dict(variant.keys)
    duration = plain(trial.plan).get("duration")
    if duration and requested.takes_duration and given.takes_duration:
        keys["duration"] = duration * variant.duration_factor
    if requested is not given:
        keys |= requested.compared
    name = f"{method}, {variant.name}" if variant.name else method
    return Candidate(name, method, keys, trial.controllers, trial.active)


def _metrics(seen: FlightLog, end: float) -> dict[str, Any]:
    """Return what a slew is compared by; a step's end is that of the longest slew.

    Returns:
        `settling_time` of the slowest joint, from the start of the plan [s] (None: never);
        `residual_tip` [m] and `residual_joint` [rad or m], the largest after the end; by joint
        `peak_position`, farthest from the start, and `overshoot`, a fraction of the distance (None:
        nowhere to go); `peak_effort`; `effort`, the integral of the sum of squared efforts over the
        run.

    Raises:
        BadInput: the bench was lost.
    """
    plan = seen.plan
    assert plan is not None
    if seen.bench.failure:
        raise BadInput(seen.bench.failure)
    measured = seen.metrics(end)
    settling_times = measured["settling_time"].values()
    position = _joints(seen.bench.model, seen.truth_log)
    peak_index = np.abs(position - position[0]).argmax(axis=0)[None]
    peak = np.take_along_axis(position, peak_index, axis=0)[0]
    return {
        "settling_time": None if None in settling_times else max(settling_times),
        "residual_tip": measured["residual_tip_deflection"],
        "residual_joint": max(measured["residual_attitude_error"].values()),
        "peak_position": dict(zip(plan.joint_names, peak.tolist(), strict=True)),
        "overshoot": measured["overshoot"],
        "peak_effort": [*measured["peak_effort"].values()],
        "effort": measured["control_effort"],
    }


def _joints(model: Model, truths: Sequence[Truth]) -> Matrix:
    """Return where the joints are, (ticks, joints) [rad or m]."""
    states = [np.concatenate((truth.position, truth.velocity)) for truth in truths]
    return model.joint_states(np.array(states))[0]


def _curves(seen: FlightLog, truths: Sequence[Truth]) -> Matrix:
    """Return joints, the largest tip deflection, and efforts."""
    position = _joints(seen.bench.model, truths)
    applied = [truth.applied_effort for truth in truths]
    return np.column_stack((position, largest_tip(truths), applied))


def _view(trial: Trial, entries: Entries, errors: Sequence[float]) -> Comparison:
    found = slew_comparison(trial, entries, errors)
    named, simulated = found.named, found.flown
    plan = entries[0].plan
    goal = [] if plan is None else zip(plan.joint_names, plan.position[-1], strict=True)
    to = ", ".join(f"{name} {at:.4g} {dict(named)[name]}" for name, at in goal)
    curves = [*named, ("largest tip deflection", "m")]
    curves += [(f"effort on {name}", "N" if unit == "m" else "N m") for name, unit in named]
    plot_quantities = [
        PlotMetric(
            f"error of the {words}, residual tip deflection",
            "m",
            f"error of the {words} [%]",
            kind,
            tip_of,
        )
        for kind, words in _ERROR_NAMES.items()
    ]
    modes = count_text(trial.testbed.modes, "mode")
    effort_unit, joint_unit = _units(found)
    return Comparison(
        word="method",
        title=f"{trial.name}: every method",
        about=f"to {to} · {trial.testbed.kind}, {modes}, {trial.active} in charge",
        words=(_BOUND.format(found.lower_bound) if found.lower_bound else "") + _WORDS,
        note=found.durations(),
        entries=entries,
        numbers=found.numbers,
        short=_short(found),
        columns=_columns(found),
        criteria=[
            ComparisonMetric(key, title, unit, itemgetter(key))
            for key, title, unit in (
                ("residual_tip", "tip, after the end", "m"),
                ("residual_joint", "joints, after the end", joint_unit),
                ("settling_time", "joints settled after", "s"),
                ("effort", "effort", f"({effort_unit})² s"),
            )
        ],
        groups=[
            robustness(
                simulated,
                plot_quantities,
                "Residual tip deflection when the bench differs from the planner's model.",
                260,
            ),
            found.cost(),
            motion(simulated, curves),
        ],
    )


def _columns(found: SlewComparison) -> list[TableColumn]:
    """Return the columns of the page, those of each flight next to each other."""
    torque, joint = _units(found)
    names, bound = [name for name, _ in found.named], found.lower_bound

    def over(entry: CandidateResult) -> str:
        duration = duration_of(entry)
        return f"{duration / bound:.2f}" if bound > 0.0 and duration > 0.0 else NO_VALUE

    def tip(kind: str, k: int) -> Callable[[CandidateResult], float]:
        return lambda entry: tip_of(entry.by(kind)[k])

    tips = [
        TableColumn(f"tip, {words} {getattr(flight, kind):+.0%} [m]", tip(kind, k))
        for kind, words in _ERROR_NAMES.items()
        for k, flight in enumerate(found.flown[0].by(kind) if found.flown else ())
        if kind == STIFFNESS or flight.carried
    ]
    peaks = [(f"peak {n} [{unit}]", _cell("", "peak_position", n)) for n, unit in found.named]
    overshoot_columns = [
        (f"overshoot {name} [%]", _cell(".1%", "overshoot", name)) for name in names
    ]
    efforts = [
        (f"peak effort on {name} [{torque}]", _cell("", "peak_effort", k))
        for k, name in enumerate(names)
    ]
    return [
        TableColumn("duration [s]", lambda entry: _step_or(entry, ".3f")),
        TableColumn("over bound", over),
        TableColumn("settled [s]", _cell(".2f", "settling_time")),
        TableColumn(f"joint error [{joint}]", _cell(".2e", "residual_joint")),
        *tips,
        *(TableColumn(*column) for column in (*peaks, *overshoot_columns, *efforts)),
        TableColumn(f"effort [({torque})² s]", _cell("", "effort")),
    ]


def _units(found: SlewComparison) -> tuple[str, str]:
    """Return the units of efforts and of joints."""
    return ("N", "m") if all(unit == "m" for _, unit in found.named) else ("N m", "rad")


def _short(found: SlewComparison) -> list[TableColumn]:
    """Return the columns of a table that fits into a terminal of 80 characters."""
    return [
        TableColumn("time [s]", lambda entry: _step_or(entry, ".2f")),
        TableColumn("settled [s]", _cell(".1f", "settling_time")),
        TableColumn("tip [m]", _cell("", "residual_tip")),
        TableColumn("worst tip [m]", worst_residual),
        *(TableColumn(f"{n} over [%]", _cell(".1%", "overshoot", n)) for n, _ in found.named),
    ]


def _step_or(entry: CandidateResult, form: str) -> str:
    return format(duration_of(entry), form) if duration_of(entry) > 0.0 else "step"


def _cell(form: str, *path: str | int) -> Callable[[CandidateResult], str | float]:
    """Return what writes a number of the nominal flight; its unit stands in the title.

    Without a form it is that of its column.
    """

    def cell(entry: CandidateResult) -> str | float:
        value: Any = entry.nominal.metrics
        for key in path:
            value = value[key]
        if value is None:
            return NO_VALUE
        return format(value, form).rstrip("%") if form else float(value)

    return cell
