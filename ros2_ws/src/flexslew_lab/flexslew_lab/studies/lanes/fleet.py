"""Trials flown at once: from trials to lanes and back to metrics."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from flexslew_control.linear_form import LinearForm, linear_form
from flexslew_lab.metrics.course import Course
from flexslew_lab.metrics.efforts import Efforts
from flexslew_lab.metrics.epoch import merged
from flexslew_lab.metrics.joint_errors import JointErrors
from flexslew_lab.metrics.metric import Ending, Flight, Manoeuvre
from flexslew_lab.metrics.settling import Settling
from flexslew_lab.metrics.takeovers import Takeovers
from flexslew_lab.metrics.tip_deflection import TipDeflection
from flexslew_lab.studies.cases import Case
from flexslew_lab.studies.flight import Flown, Plans, columns_of
from flexslew_lab.studies.lanes.inputs import aim_of, errors_of, gains_of, schedule_of
from flexslew_lab.studies.lanes.loop import Matrices, Schedule, lane_loop
from flexslew_lab.studies.lanes.observers import beginning
from flexslew_lab.studies.lanes.passengers import (
    Passenger,
    controller_of,
    passenger_of,
)
from flexslew_lab.studies.lanes.rows import Rows, Sizes, of_lane, rows_of
from flexslew_lab.studies.study import Study
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import FlexslewError
from flexslew_plant.testbeds import initial_state
from flexslew_plant.testbeds.lanes import LANES, flat_zeros

_FAR = 1e6  # a state beyond it is for the ordinary bench to judge
_KEPT = 32  # laws on a plan that are kept


class _Prepared(NamedTuple):
    """What a group has in common."""

    form: LinearForm
    schedule: Schedule
    aim: Vector  # rows `tip` to `law_limit`
    goal: Manoeuvre


@dataclass
class Lanes:
    """Flies trials of a study many at once; gives back those that only the bench can fly.

    Args:
        study: whose trials they are.
        plans: made already.
    """

    study: Study
    plans: Plans
    _prepared: dict[str, _Prepared] = field(init=False, default_factory=dict)

    def fly(self, cases: Sequence[Case]) -> Iterator[tuple[list[Flown], list[Case]]]:
        """Yield results, and cases that have to be flown one by one."""
        groups: dict[str, list[Passenger]] = {}
        others: list[Case] = []
        for case in cases:
            passenger = passenger_of(self.study, case)
            if passenger is None:
                others.append(case)
            else:
                groups.setdefault(passenger.alike, []).append(passenger)
        if others:
            yield [], others
        for group in groups.values():
            for first in range(0, len(group), LANES):
                yield self._flown(group[first : first + LANES])

    def _flown(self, group: list[Passenger]) -> tuple[list[Flown], list[Case]]:
        first = group[0]
        prepared = self._prepare(first)
        if prepared is None:
            return [], [passenger.case for passenger in group]
        form, schedule = prepared.form.law, prepared.schedule
        model, m = first.model, first.model.joints
        states, outputs = form.from_state.shape[1], form.from_output.shape[1]
        sizes = Sizes(m, model.modes, states, outputs, len(model.appendages.names))
        observer = beginning(prepared.form)
        lanes = [group[min(k, len(group) - 1)] for k in range(LANES)]  # the last one fills up
        packed = np.array([lane.model.packed for lane in lanes]).T
        at_rest = np.array([initial_state(lane.trial.testbed) for lane in lanes]).T
        rows = rows_of(first.kernel.size, sizes)
        w = flat_zeros(rows.end)
        w[: first.kernel.size] = first.kernel.place(np.ascontiguousarray(packed))
        w[: at_rest.size] = at_rest.ravel()
        w[rows.kp : rows.tip] = gains_of(lanes, form)
        w[rows.tip : rows.residual_tip] = np.repeat(prepared.aim, LANES)
        w[rows.outside : rows.terminal] = -np.inf
        lane_loop(first.kernel, sizes, observer.observe)(
            w,
            first.trial.period,
            first.steps,
            schedule,
            Matrices(*(np.ascontiguousarray(getattr(form, name)) for name in Matrices._fields)),
            form.integral,
            form.unwinding,
            errors_of(lanes, sizes.outputs, len(schedule.time)),
            observer.constants,
            observer.z,
            observer.memory,
            len(group),
        )
        results, lost = [], []
        state = w[: at_rest.size].reshape(-1, LANES)
        for k, passenger in enumerate(group):
            if not (np.abs(state[:, k]) < _FAR).all():
                lost.append(passenger.case)
                continue
            metrics = _metrics(passenger, k, w, rows, schedule, prepared.goal)
            results.append(Flown(passenger.case.number, metrics, None, "ok", "", "lanes"))
        return results, lost

    def _prepare(self, passenger: Passenger) -> _Prepared | None:
        """Return what is common to all like this one; None if its law is not linear."""
        if passenger.alike in self._prepared:
            return self._prepared[passenger.alike]
        trial = passenger.trial
        try:
            plan = self.plans.of(trial, passenger.asked)
        except FlexslewError:
            return None  # the bench says why
        controller = controller_of(trial)
        if plan is None or controller.adopt(plan):
            return None
        ticks = round(trial.duration / trial.period)
        form = linear_form(controller.estimator, controller.law, plan, ticks)
        if form is None:
            return None
        while len(self._prepared) >= _KEPT:
            self._prepared.pop(next(iter(self._prepared)))
        schedule = schedule_of(passenger, plan, form.law, ticks)
        made = _Prepared(form, schedule, *aim_of(passenger, plan, form.law))
        self._prepared[passenger.alike] = made
        return made


def _metrics(
    passenger: Passenger, k: int, w: Vector, rows: Rows, schedule: Schedule, aim: Manoeuvre
) -> dict[str, float | None]:
    """Return the metrics of a lane, by the rule for all runs."""
    time, settings = schedule.time, passenger.trial.testbed
    limit = np.array(settings.effort_limit)
    flight = Flight(passenger.model.joint_names, aim, limit, settings)
    tip, errors, settling = TipDeflection(flight), JointErrors(flight), Settling(flight)
    efforts, course = Efforts(flight), Course(flight)
    m, ended = limit.size, bool(schedule.over.any())
    tip.peak = float(w[rows.peak_tip + k])
    settling.outside = of_lane(w, rows.outside, m, k)
    settling.beyond = of_lane(w, rows.beyond, m, k)
    assert aim.goal is not None
    errors.final = of_lane(w, 0, m, k) - aim.goal
    if ended:
        tip.residual = float(w[rows.residual_tip + k])
        errors.residual = of_lane(w, rows.residual, m, k)
        errors.terminal = float(w[rows.terminal + k])
    efforts.peak = of_lane(w, rows.peak_effort, m, k)
    efforts.square_sum = of_lane(w, rows.square_sum, m, k)
    efforts.integral = float(efforts.square_sum.sum())
    efforts.saturated = float(w[rows.saturated + k])
    course.ticks = 0, len(time) - 1
    efforts.times = course.times = float(time[0]), float(time[-1])
    settling.last_time = float(time[-1])
    measured = (tip, errors, settling, efforts, Takeovers(flight), course)
    return columns_of(merged(measured, Ending([], [], True)))
