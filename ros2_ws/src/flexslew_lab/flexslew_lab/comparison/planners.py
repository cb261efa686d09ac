"""The same manoeuvre by every method, on benches that are not what the planner believes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from flexslew_control.plan import Plan
from flexslew_control.planners import PLANNERS, Variant, make_plan, other_method, planner_of
from flexslew_control.planners.minimax.limit_curve import LimitCurve, limit_curve
from flexslew_control.planners.slew import slew_of
from flexslew_control.planners.trajectories import rigid_duration
from flexslew_lab.comparison.flight import PlanFlight, flown
from flexslew_lab.trial.trial import (
    SavedPlan,
    Trial,
    feedback_of,
    law_in_charge,
    plan_section_of,
    plant_of,
)
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput, PlanFailed, without_source
from flexslew_plant.settings import plain
from flexslew_plant.testbeds import initial_positions

ERRORS = (-0.2, -0.1, 0.0, 0.1, 0.2)  # of the stiffness, relative [-]
PAYLOADS = (-0.2, 0.2)  # of what the testbed carries, relative [-]
_WATCHED = 40.0  # at least, after the longest slew [s]


@dataclass(frozen=True)
class ComparedPlan:
    """One method: its plan and its flights, or why there are none."""

    name: str
    plan: Plan | None
    refused: str
    flights: tuple[PlanFlight, ...] = ()

    @property
    def by_stiffness(self) -> tuple[PlanFlight, ...]:
        """The flights with errors of the stiffness alone."""
        return tuple(flight for flight in self.flights if flight.payload == 0.0)

    @property
    def by_payload(self) -> tuple[PlanFlight, ...]:
        """The flights with errors of the payload alone, the nominal one among them."""
        middle = self.nominal.error
        return tuple(
            sorted((f for f in self.flights if f.error == middle), key=lambda f: f.payload)
        )

    @property
    def nominal(self) -> PlanFlight:
        """The flight with the smallest error."""
        return min(self.by_stiffness, key=lambda flight: abs(flight.error))

    @property
    def worst_residual(self) -> float:
        """Largest residual tip deflection over all errors of the stiffness [m]."""
        return max(flight.residual_tip for flight in self.by_stiffness)


@dataclass(frozen=True)
class Comparison:
    """Every method on the manoeuvre of a trial."""

    trial: Trial
    joint_names: tuple[str, ...]
    joint_units: tuple[str, ...]
    lower_bound: float  # of the duration, for a rigid body under the limits [s]
    entries: tuple[ComparedPlan, ...]
    limit: LimitCurve | None = None  # of a linear plant

    @property
    def other_durations(self) -> tuple[str, ...]:
        """The methods that fly at another duration than the trial's own."""
        own = self.flown[0].plan if self.flown else None
        return tuple(
            entry.name
            for entry in self.flown
            if own is not None
            and entry.plan is not None
            and abs(entry.plan.duration - own.duration) > 1e-9
        )

    @property
    def best_found(self) -> tuple[Vector, Vector]:
        """Durations and the least worst residual of any method that takes no longer [s, m]."""
        made = [
            (e.plan.duration, e.worst_residual) for e in self.flown if e.plan and e.plan.duration
        ]
        rows = np.array(sorted(made)).reshape(-1, 2)
        return rows[:, 0], np.minimum.accumulate(rows[:, 1])

    @property
    def flown(self) -> tuple[ComparedPlan, ...]:
        """The methods that have a plan."""
        return tuple(entry for entry in self.entries if entry.flights)

    def rows(self) -> list[dict[str, Any]]:
        """Return the numbers as plain data, one row per method."""
        out: list[dict[str, Any]] = []
        least = None if self.limit is None else self.limit.least_time
        for entry in self.entries:
            row: dict[str, Any] = {"method": entry.name, "refused": entry.refused}
            if entry.plan is not None and entry.flights:
                nominal = entry.nominal
                row |= {
                    "duration": entry.plan.duration,
                    "same_duration": entry.name not in self.other_durations,
                    "over_lower_bound": entry.plan.duration / self.lower_bound,
                    "over_least_time": least and entry.plan.duration / least,
                    "settling_time": nominal.settling_time,
                    "residual_tip": nominal.residual_tip,
                    "residual_joint": nominal.residual_joint,
                    "peak_position": dict(
                        zip(self.joint_names, nominal.peak_position.tolist(), strict=True)
                    ),
                    "overshoot": {
                        name: value if value == value else None  # NaN: nowhere to go
                        for name, value in zip(
                            self.joint_names, nominal.overshoot.tolist(), strict=True
                        )
                    },
                    "worst_residual_tip": entry.worst_residual,
                    "residual_tip_by_error": {
                        f"{f.error:+g}": f.residual_tip for f in entry.by_stiffness
                    },
                    "residual_tip_by_payload": {
                        f"{f.payload:+g}": f.residual_tip for f in entry.by_payload
                    },
                    "peak_effort": nominal.peak_effort.tolist(),
                    "effort": nominal.effort,
                }
            out.append(row)
        return out


def compared(
    trial: Trial,
    source: str,
    progress: Callable[[int, int], None] = lambda done, last: None,
    errors: Sequence[float] = ERRORS,
) -> Comparison:
    """Return what every method does with the manoeuvre of a trial.

    Args:
        trial: the bench, the controller in charge, and in `plan` the manoeuvre.
        source: its file, for messages.
        progress: called with the flights done and their number.
        errors: of the stiffness, relative [-].

    Raises:
        BadInput: the trial asks for no manoeuvre, or an error is not allowed.
    """
    section = plan_section_of(trial, source)
    if section is None:
        raise BadInput("plan: is missing; add the manoeuvre to compare", source)
    trial = replace(trial, plan=section)
    if not errors or min(errors) <= -1.0:
        raise BadInput("one or more, each above -1", key="errors", value=list(errors))
    candidates = _candidates(trial)
    entries = _distinct(
        [(method, _planned(trial, source, method, variant)) for method, variant in candidates]
    )
    plans = [entry.plan for entry in entries if entry.plan is not None]
    longest = max((plan.end for plan in plans), default=0.0)
    long_enough = replace(trial, duration=max(trial.duration, longest + _WATCHED))
    middle = min(errors, key=abs)
    payloads = PAYLOADS if _carries_payload(trial) else ()
    benches = [(error, 0.0) for error in errors] + [(middle, payload) for payload in payloads]
    last = len(plans) * len(benches)
    done = 0
    for k, entry in enumerate(entries):
        flights = []
        for error, payload in benches if entry.plan is not None else ():
            assert entry.plan is not None
            refused, flight = flown(long_enough, source, entry.plan, error, payload, longest)
            done += 1
            progress(done, last)
            if flight is None:
                entry = replace(entry, refused=refused)
                break
            flights.append(flight)
        entries[k] = replace(entry, flights=tuple(flights))
    model = trial.testbed.model()
    resting = initial_positions(trial.testbed)
    first = np.array([resting[name] for name in model.joint_names])
    limit = np.array(trial.testbed.effort_limit)
    bound = max(
        (rigid_duration(model, first, plan.position[-1], limit) for plan in plans), default=0.0
    )
    limits = _limit(trial, errors, longest)
    units = model.joint_units
    return Comparison(trial, model.joint_names, units, bound, tuple(entries), limits)


def _distinct(planned: Sequence[tuple[str, ComparedPlan]]) -> list[ComparedPlan]:
    """Return the entries without variants whose plan is that of an earlier one of their method."""
    kept: list[tuple[str, ComparedPlan]] = []
    for method, entry in planned:
        plan = entry.plan
        same = (
            other.plan
            for name, other in kept
            if name == method and other.plan is not None and plan is not None
        )
        if plan is None or not any(_same(plan, other) for other in same):
            kept.append((method, entry))
    return [entry for _, entry in kept]


def _same(one: Plan, other: Plan) -> bool:
    """Return whether two plans ask for the same motion."""
    parts = ("start", "duration", "position", "velocity", "effort", "state", "gains")
    return all(np.array_equal(getattr(one, key), getattr(other, key)) for key in parts)


def _limit(trial: Trial, errors: Sequence[float], longest: float) -> LimitCurve | None:
    """Return the convex optimum over the duration; None: the plant is not linear."""
    try:
        slew = slew_of(trial.plan, plant_of(trial), feedback_of(trial))
    except (BadInput, AttributeError):  # no slew, or of a section without a goal
        return None
    if slew.effort_limit.size != slew.goal.size:
        return None
    return limit_curve(slew, (min(errors), max(errors)), longest)


def _carries_payload(trial: Trial) -> bool:
    """Return whether the testbed's payload can change."""
    try:
        trial.testbed.scaled(payload=1.0 + PAYLOADS[0])
    except BadInput:
        return False
    return True


def _candidates(trial: Trial) -> list[tuple[str, Variant]]:
    """Return the methods and their variants, the trial's own first, bare references last.

    A trial that asks for a variant itself has that one first, then the method with its defaults.
    """
    assert not isinstance(trial.plan, SavedPlan | None)
    own, usual = planner_of(trial.plan), Variant("", {})
    others = [entry for entry in PLANNERS.values() if entry.slews and entry is not own]
    others.sort(key=lambda entry: not entry.feedforward)
    methods = {trial.plan.method: own} | {entry.name: entry for entry in others}
    found = [
        (name, variant) for name, entry in methods.items() for variant in (usual, *entry.variants)
    ]
    given = plain(trial.plan)
    asked = [v for v in own.variants if plain_keys(v) == {k: given.get(k) for k in v.keys}]
    if not asked:
        return found
    defaults = {item.name: item.default for item in fields(own.settings)}
    bare = Variant("", {key: defaults[key] for key in asked[0].keys})
    rest = [c for c in found if c not in ((own.name, usual), (own.name, asked[0]))]
    return [(own.name, asked[0]), (own.name, bare), *rest]


def plain_keys(variant: Variant) -> dict[str, Any]:
    """Return the keys of a variant as a section holds them as plain data."""
    return {k: list(v) if isinstance(v, tuple) else v for k, v in variant.keys.items()}


def _planned(trial: Trial, source: str, method: str, variant: Variant) -> ComparedPlan:
    """Return the method's plan for the trial's manoeuvre, or why it has none."""
    assert not isinstance(trial.plan, SavedPlan | None)
    name = f"{method}, {variant.name}" if variant.name else method
    given = planner_of(trial.plan)
    requested = given if method == trial.plan.method else PLANNERS[method]
    own: dict[str, Any] = dict(variant.keys)
    duration = plain(trial.plan).get("duration")
    if duration and requested.takes_duration and given.takes_duration:
        own["duration"] = duration * variant.longer
    if requested is not given:
        own |= requested.compared
    plant, feedback = plant_of(trial), feedback_of(trial)
    try:
        settings = other_method(trial.plan, method, f"{source}: plan", **own)
        plan = make_plan(settings, plant, feedback, law=law_in_charge(trial))
    except (BadInput, PlanFailed) as refused:
        return ComparedPlan(name, None, without_source(refused))
    return ComparedPlan(name, plan, "")
