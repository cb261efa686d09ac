"""Which trials may be flown at once, and how: from trials to lanes and back to metrics."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.controllers import CONTROLLERS, build_controller
from flexslew_control.controllers.controller import Controller
from flexslew_control.linear_form import LawForm, LinearForm, linear_form
from flexslew_control.plan import Plan
from flexslew_lab.metrics.course import Course
from flexslew_lab.metrics.efforts import Efforts
from flexslew_lab.metrics.epoch import merged
from flexslew_lab.metrics.from_bag import manoeuvre_of
from flexslew_lab.metrics.joint_errors import JointErrors
from flexslew_lab.metrics.metric import Ending, Flight, Manoeuvre
from flexslew_lab.metrics.settling import Settling, settling_band
from flexslew_lab.metrics.takeovers import Takeovers
from flexslew_lab.metrics.tip_deflection import TipDeflection
from flexslew_lab.studies.cases import Case, case_trial
from flexslew_lab.studies.flight import Flown, Plans, columns_of, leaves_nothing, plan_key
from flexslew_lab.studies.lane_loop import (
    Aim,
    Counted,
    Matrices,
    Schedule,
    Sizes,
    lane_loop,
)
from flexslew_lab.studies.lane_observers import beginning
from flexslew_lab.studies.study import Study
from flexslew_lab.trial.trial import Trial, law_of, plant_of
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.bench.actuator import ActuatorSettings
from flexslew_plant.bench.disturbances import TimedDisturbance, disturbance_effort
from flexslew_plant.bench.wire import stamp_of
from flexslew_plant.errors import FlexslewError
from flexslew_plant.settings import plain
from flexslew_plant.testbeds import initial_state
from flexslew_plant.testbeds.lanes import LANES, LaneKernel, lane_kernel
from flexslew_plant.testbeds.model import Model

_FAR = 1e6  # a state beyond it is for the ordinary bench to judge
_PER_LANE = ("kp", "ki", "kd")  # gains that each lane may have for itself
_COLLOCATED = ("pd_feedforward", "collocated_pid")  # the laws whose gains may
_KEPT = 32  # laws on a plan that are kept


class Passenger(NamedTuple):
    """A trial that may fly in a lane."""

    case: Case
    trial: Trial
    plan: Plan
    model: Model
    kernel: LaneKernel
    steps: int  # of the kernel per tick
    alike: str  # trials with the same text may fly at once


class _Prepared(NamedTuple):
    """What a group has in common."""

    form: LinearForm
    schedule: Schedule


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
            passenger = self._passenger(case)
            if passenger is None:
                others.append(case)
            else:
                groups.setdefault(passenger.alike, []).append(passenger)
        if others:
            yield [], others
        for group in groups.values():
            for first in range(0, len(group), LANES):
                yield self._flown(group[first : first + LANES])

    def _passenger(self, case: Case) -> Passenger | None:
        try:
            trial = case_trial(self.study, case)
            if not _simple(trial):
                return None
            kernel, plan = lane_kernel(trial.testbed), self.plans.of(trial)
            if kernel is None or plan is None or not _linear(trial):
                return None
        except FlexslewError:
            return None  # the bench says why
        model = trial.testbed.model()
        return Passenger(
            case,
            trial,
            plan,
            model,
            kernel,
            kernel.steps(model.packed, trial.period),
            _alike(trial, model, kernel.steps(model.packed, trial.period)),
        )

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
        aim, goal = _aim(first, form)
        lanes = [group[min(k, len(group) - 1)] for k in range(LANES)]  # the last one fills up
        packed = np.array([lane.model.packed for lane in lanes]).T
        x = np.array([initial_state(lane.trial.testbed) for lane in lanes]).T.ravel()
        counted = _nothing_yet(m)
        lane_loop(first.kernel, sizes, observer.observe)(
            first.kernel.constants(np.ascontiguousarray(packed)),
            first.trial.period,
            first.steps,
            x,
            schedule,
            Matrices(*(np.ascontiguousarray(getattr(form, name)) for name in Matrices._fields)),
            aim,
            _gains(lanes, form),
            form.integral,
            form.unwinding,
            _errors(lanes, sizes.outputs, len(schedule.time)),
            observer.constants,
            observer.z,
            observer.memory,
            len(group),
            counted,
        )
        results, lost = [], []
        state = x.reshape(-1, LANES)
        for k, passenger in enumerate(group):
            if not (np.abs(state[:, k]) < _FAR).all():
                lost.append(passenger.case)
                continue
            metrics = _metrics(passenger, k, counted, state, schedule, goal)
            results.append(Flown(passenger.case.number, metrics, None, "ok", "", "lanes"))
        return results, lost

    def _prepare(self, passenger: Passenger) -> _Prepared | None:
        """Return what is common to all like this one; None if its law is not linear."""
        if passenger.alike in self._prepared:
            return self._prepared[passenger.alike]
        trial, plan = passenger.trial, passenger.plan
        controller = _controller(trial)
        if controller.adopt(plan):
            return None
        ticks = round(trial.duration / trial.period)
        form = linear_form(controller.estimator, controller.law, plan, ticks)
        if form is None:
            return None
        while len(self._prepared) >= _KEPT:
            self._prepared.pop(next(iter(self._prepared)))
        made = _Prepared(form, _schedule(passenger, form.law, ticks))
        self._prepared[passenger.alike] = made
        return made


def _simple(trial: Trial) -> bool:
    """Return whether motors, sensors, schedule and metrics are such as lanes know."""
    if trial.metrics:
        return False
    s = trial.sensors
    channels = (s.joint_position, s.joint_velocity, s.tip_deflection, s.root_curvature)
    pushed = all(entry.disturbance is not None for entry in trial.schedule)
    exact = all(channel.quantisation == 0.0 for channel in channels)
    return trial.actuator == ActuatorSettings() and exact and pushed and not trial.allow_faults


def _linear(trial: Trial) -> bool:
    """Return whether the law may be linear; linear_form has the last word."""
    law, own = law_of(trial.active, trial.controllers[trial.active] or {})
    if law == "output_feedback":
        return own.get("mode") == "tracking_b"
    return law in CONTROLLERS


def _alike(trial: Trial, model: Model, steps: int) -> str:
    """Return everything that trials in lanes beside each other must share, as text."""
    law, own = law_of(trial.active, trial.controllers[trial.active] or {})
    if law in _COLLOCATED:
        own = {key: value for key, value in own.items() if key not in _PER_LANE}
    shared = [
        law,
        own,
        plan_key(trial),
        trial.period,
        trial.duration,
        list(trial.testbed.effort_limit),
        plain(trial.schedule),
        [trial.testbed.kind, model.modes, steps],
        model.appendages.tip.tolist(),
        [bool(channel.noise or channel.bias) for channel in _read_channels(trial)],
    ]
    if law not in _COLLOCATED and not leaves_nothing(own.get("model"), trial.testbed):
        shared.append(plain(trial.testbed))  # in which the law believes
    return json.dumps(shared, sort_keys=True)


def _controller(trial: Trial) -> Controller:
    law, own = law_of(trial.active, trial.controllers[trial.active] or {})
    return build_controller(trial.active, law, own, plant_of(trial), trial.name)


def _read_channels(trial: Trial) -> tuple[Any, Any, Any]:
    s = trial.sensors
    return s.joint_position, s.joint_velocity, s.tip_deflection


def _schedule(passenger: Passenger, form: LawForm, ticks: int) -> Schedule:
    trial, plan = passenger.trial, passenger.plan
    stamps = (stamp_of(k * trial.period) for k in range(ticks + 1))
    time = np.array([stamp.sec + stamp.nanosec * 1e-9 for stamp in stamps])
    return Schedule(
        time,
        time >= plan.start + plan.duration - 1e-9,
        time >= plan.start - 1e-9,
        *_joint_references(plan, ticks),
        np.ascontiguousarray(form.demand),
        np.ascontiguousarray(form.integrand),
        _disturbances(trial, passenger.model, ticks),
    )


def _joint_references(plan: Plan, ticks: int) -> tuple[Matrix, Matrix]:
    """Return what the plan wants of the joints and of their rates, each (ticks, joints)."""
    rows = [plan.reference(k) for k in range(ticks)]
    return np.array([r.position for r in rows]), np.array([r.velocity for r in rows])


def _disturbances(trial: Trial, model: Model, ticks: int) -> Matrix:
    total = np.zeros((ticks, model.joints))
    for entry in trial.schedule:
        start = round(entry.at / trial.period)
        end = ticks if entry.until is None else round(entry.until / trial.period)
        end = max(end, start + 1)
        timed = TimedDisturbance(entry.disturbance or {}, start, end)
        for k in range(start, min(end, ticks)):
            total[k] += disturbance_effort(timed, k, model.joint_names, trial.period)
    return total


def _aim(passenger: Passenger, form: LawForm) -> tuple[Aim, Manoeuvre]:
    goal = manoeuvre_of(passenger.plan.position, passenger.plan.start, passenger.plan.duration)
    assert goal.goal is not None
    return (
        Aim(
            np.ascontiguousarray(goal.goal),
            np.sign(goal.way),
            settling_band(goal.way),
            np.array(passenger.trial.testbed.effort_limit, dtype=np.float64),
            np.minimum(form.limit, np.finfo(float).max),
            np.ascontiguousarray(passenger.model.appendages.tip, dtype=np.float64),
        ),
        goal,
    )


def _gains(lanes: list[Passenger], form: LawForm) -> Vector:
    """Return kp, ki and kd of every lane, flat."""
    law, _ = law_of(lanes[0].trial.active, lanes[0].trial.controllers[lanes[0].trial.active] or {})
    if law not in _COLLOCATED:
        return np.repeat(np.concatenate((form.kp, form.ki, form.kd)), LANES)
    found: dict[str, Vector] = {}
    columns = []
    for lane in lanes:
        own = lane.trial.controllers[lane.trial.active] or {}
        key = repr({name: own.get(name) for name in _PER_LANE})
        if key not in found:
            built: Any = _controller(lane.trial).law
            gains = getattr(built, "deviation", built)
            none = np.zeros(gains.kp.size)
            found[key] = np.concatenate((gains.kp, getattr(gains, "ki", none), gains.kd))
        columns.append(found[key])
    return np.ascontiguousarray(np.array(columns).T).ravel()


def _errors(lanes: list[Passenger], outputs: int, readings: int) -> Matrix:
    """Return bias and noise of what the law reads, (readings or 1, outputs LANES)."""
    m, tips = lanes[0].model.joints, len(lanes[0].model.appendages.names)
    widths = (m, m, tips, tips)
    sensors = lanes[0].trial.sensors
    channels = ("joint_position", "joint_velocity", "tip_deflection", "root_curvature")
    noisy = any(getattr(sensors, name).noise for name in channels[:3])
    error = np.zeros((readings if noisy else 1, outputs, LANES))
    for k, lane in enumerate(lanes):
        if k > 0 and lane is lanes[k - 1]:  # it only fills up
            error[:, :, k] = error[:, :, k - 1]
            continue
        each = [getattr(lane.trial.sensors, name) for name in channels]
        drawn = [w if channel.noise else 0 for w, channel in zip(widths, each, strict=True)]
        noise = np.zeros((0, 0))
        if noisy:
            rng = np.random.default_rng([lane.trial.seed, 0])  # as Bench.reset, epoch 0
            noise = rng.standard_normal((readings, sum(drawn)))
        at, column = 0, 0
        for width, channel, count in zip(widths, each, drawn, strict=True):
            read = min(width, outputs - at)
            if read > 0:
                error[:, at : at + read, k] = channel.bias
                if count:
                    own = noise[:, column : column + read]
                    error[:, at : at + read, k] += channel.noise * own
            at, column = at + width, column + count
    return error.reshape(len(error), outputs * LANES)


def _nothing_yet(m: int) -> Counted:
    none = np.zeros(LANES)
    each = np.zeros(m * LANES)
    return Counted(
        none.copy(),
        none.copy(),
        each.copy(),
        each.copy(),
        np.full(m * LANES, -np.inf),
        none.copy(),
        each.copy(),
        each.copy(),
        none.copy(),
    )


def _metrics(
    passenger: Passenger, k: int, c: Counted, x: Matrix, schedule: Schedule, aim: Manoeuvre
) -> dict[str, float | None]:
    """Return the metrics of a lane, by the rule for all runs."""
    time, settings = schedule.time, passenger.trial.testbed
    limit = np.array(settings.effort_limit)
    flight = Flight(passenger.model.joint_names, aim, limit, settings)
    tip, errors, settling = TipDeflection(flight), JointErrors(flight), Settling(flight)
    efforts, course = Efforts(flight), Course(flight)
    ended = bool(schedule.over.any())
    tip.peak = float(c.peak_tip[k])
    settling.outside, settling.beyond = c.outside[k::LANES], c.beyond[k::LANES]
    assert aim.goal is not None
    errors.final = x[: limit.size, k] - aim.goal
    if ended:
        tip.residual = float(c.residual_tip[k])
        errors.residual, errors.terminal = c.residual[k::LANES], float(c.terminal[k])
    efforts.peak, efforts.square_sum = c.peak_effort[k::LANES], c.square_sum[k::LANES]
    efforts.integral, efforts.saturated = float(efforts.square_sum.sum()), float(c.saturated[k])
    course.ticks = 0, len(time) - 1
    efforts.times = course.times = float(time[0]), float(time[-1])
    settling.last_time = float(time[-1])
    measured = (tip, errors, settling, efforts, Takeovers(flight), course)
    return columns_of(merged(measured, Ending([], [], True)))
