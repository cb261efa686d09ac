"""The slew in a comparison of methods: its limits, its numbers, its columns."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexslew_control.planners.minimax.limit_curve import LimitCurve, limit_curve
from flexslew_control.planners.slew import slew_of
from flexslew_control.planners.trajectories import rigid_duration
from flexslew_lab.comparison.comparison import (
    CARRIED,
    STIFFNESS,
    CandidateFlight,
    CandidateResult,
    Entries,
)
from flexslew_lab.comparison.page import extend_range
from flexslew_lab.report.panels import Group, Mark, Panel, legend, style
from flexslew_lab.trial.trial import Trial, feedback_of, plant_of
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import initial_positions


@dataclass(frozen=True)
class SlewComparison:
    """The results of the entries on the manoeuvre.

    Args:
        trial: the trial.
        flown: the methods that have a plan.
        lower_bound: of the duration, for a rigid body under the limits [s]; 0: not known.
        limit: the convex optimum over the duration; None: the plant is not linear.
    """

    trial: Trial
    flown: Entries
    lower_bound: float
    limit: LimitCurve | None

    @property
    def named(self) -> list[tuple[str, str]]:
        """Names and units of the joints."""
        return list(self.trial.testbed.model().units_by_joint.items())

    @property
    def least_time(self) -> float | None:
        """The least time to rest of a linear plant [s]."""
        return None if self.limit is None else self.limit.least_time

    @property
    def other_durations(self) -> tuple[str, ...]:
        """The methods that fly at another duration than the trial's own."""
        trial_duration = duration_of(self.flown[0]) if self.flown else 0.0
        return tuple(e.name for e in self.flown if abs(duration_of(e) - trial_duration) > 1e-9)

    @property
    def best_found(self) -> tuple[Vector, Vector]:
        """Durations and the least worst residual of any method that takes no longer [s, m]."""
        made = [(duration_of(e), worst_residual(e)) for e in self.flown if duration_of(e)]
        rows = np.array(sorted(made)).reshape(-1, 2)
        return rows[:, 0], np.minimum.accumulate(rows[:, 1])

    def durations(self) -> str:
        """Return in words which methods take another time than the first, and the least times."""
        words = []
        if self.other_durations:
            others = ", ".join(self.other_durations)
            words.append(f"NOT AT {duration_of(self.flown[0]):g} s: {others}.")
        if self.least_time is not None:
            words.append(
                f"The nominal bench comes to rest in {self.least_time:.3f} s at least, a rigid "
                f"body in {self.lower_bound:.3f} s."
            )
        return " ".join(words)

    def numbers(self, entry: CandidateResult) -> dict[str, Any]:
        """Return the numbers of a method as plain data."""
        duration = duration_of(entry)
        return {
            "duration": duration,
            "same_duration": entry.name not in self.other_durations,
            "over_lower_bound": duration / self.lower_bound if self.lower_bound else None,
            "over_least_time": self.least_time and duration / self.least_time,
            **entry.nominal.metrics,
            "worst_residual_tip": worst_residual(entry),
            "residual_tip_by_error": {f"{f.stiffness:+g}": tip_of(f) for f in entry.by(STIFFNESS)},
            "residual_tip_by_payload": {f"{f.carried:+g}": tip_of(f) for f in entry.by(CARRIED)},
        }

    def cost(self) -> Group:
        """Return the worst residual against the duration, with the rigid-body lower bound."""
        panel = Panel("worst residual tip deflection", "m", log=True, height=280)
        panel.x_title = "duration [s]"
        largest_duration = 1.0
        for number, entry in enumerate(self.flown):
            if (duration := duration_of(entry)) <= 0.0:
                continue
            x, y = np.array([duration]), np.array([worst_residual(entry)])
            marker = {"size": 12, "color": style(number)["color"], "symbol": number}
            panel.line(x, y, entry.name, {}, mode="markers", marker=marker)
            extend_range(panel, y)
            largest_duration = max(largest_duration, duration)
        panel.x_range = (0.0, 1.06 * largest_duration)
        marks = []
        if self.lower_bound > 0.0:
            marks.append(("rigid-body lower bound", self.lower_bound, "#000"))
        if self.limit is None:
            (x, y), shape = self.best_found, "hv"  # it does for more time, too
            name = "best found, not a bound"
            words = "The line is the best that was found: no bound."
        else:
            x, y, shape = self.limit.duration, self.limit.residual, "vh"  # a bound for less, too
            name = "convex optimum, a bound"
            words = "No efforts on 60 pieces can be below the line."
            if self.least_time is not None:
                marks.append(("least time to rest, nominal", self.least_time, "#777"))
        if x.size > 1:
            panel.line(x, y, name, {"color": "#777", "dash": "dot", "shape": shape})
            extend_range(panel, y)
        return Group(
            "Cost in time",
            f"The worst residual over all errors of the stiffness against the duration. {words}",
            [panel],
            legend([entry.name for entry in self.flown]),
            tuple(Mark(label, at, at, color) for label, at, color in marks),
        )


def duration_of(entry: CandidateResult) -> float:
    """Return the duration of a method's plan; 0 for a step [s]."""
    assert entry.plan is not None
    return entry.plan.duration


def worst_residual(entry: CandidateResult) -> float:
    """Return the largest residual tip deflection over all errors of the stiffness [m]."""
    return max(map(tip_of, entry.by(STIFFNESS)))


def tip_of(flight: CandidateFlight) -> float:
    """Return the residual tip deflection [m]."""
    return float(flight.metrics["residual_tip"])


def slew_comparison(trial: Trial, entries: Entries, errors: Sequence[float]) -> SlewComparison:
    """Return the results of the entries on the manoeuvre; see SlewComparison."""
    plans = [entry.plan for entry in entries if entry.plan is not None]
    simulated = tuple(entry for entry in entries if entry.flights)
    model, initial = trial.testbed.model(), initial_positions(trial.testbed)
    if model.reading is not None:  # other joints and axes take part in its turn
        return SlewComparison(trial, simulated, 0.0, None)
    first = np.array([initial[name] for name in model.joint_names])
    most = np.array(trial.testbed.effort_limit)
    bound = max((rigid_duration(model, first, p.position[-1], most) for p in plans), default=0.0)
    largest_duration = max((plan.end for plan in plans), default=0.0)
    return SlewComparison(trial, simulated, bound, _limit(trial, errors, largest_duration))


def _limit(trial: Trial, errors: Sequence[float], largest_duration: float) -> LimitCurve | None:
    """Return the convex optimum over the duration; None: the plant is not linear."""
    try:
        slew = slew_of(trial.plan, plant_of(trial), feedback_of(trial))
    except (BadInput, AttributeError):  # no slew, or of a section without a goal
        return None
    if slew.effort_limit.size != slew.goal.size:
        return None
    return limit_curve(slew, (min(errors), max(errors)), largest_duration)
