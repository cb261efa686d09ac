"""Trials flown at once: from trials to lanes and back to metrics."""

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.controllers.controller import Controller
from flexslew_control.law import Reference
from flexslew_control.linear_form import (
    KalmanForm,
    LinearForm,
    LinearObserver,
    OnModelForm,
    SmallMotionForm,
)
from flexslew_control.plan import Plan
from flexslew_control.plan_file import plan_hash
from flexslew_lab.metrics import METRICS
from flexslew_lab.metrics.metric import FlownManoeuvre
from flexslew_lab.studies.cases import Case
from flexslew_lab.studies.flight import Flown, Plans
from flexslew_lab.studies.lanes.benches.judge import DISTRUSTED
from flexslew_lab.studies.lanes.benches.lane_faults import is_known
from flexslew_lab.studies.lanes.groups.charge import Charge
from flexslew_lab.studies.lanes.groups.lane_laws import is_large, kind_of, size_of
from flexslew_lab.studies.lanes.groups.lane_trial import (
    LaneIntake,
    LaneTrial,
    controller_of,
    law_entry,
)
from flexslew_lab.studies.lanes.inputs import (
    LaneCourse,
    aim_of,
    course_of,
    gains_of,
    resting_course,
    schedule_of,
)
from flexslew_lab.studies.lanes.lane_metrics import COUNTED, LaneMetrics
from flexslew_lab.studies.lanes.laws.watch import Watch, watch_of
from flexslew_lab.studies.lanes.legs import LaneFlight, Leg
from flexslew_lab.studies.lanes.loop import Schedule
from flexslew_lab.studies.lanes.recorded import TICKS, RecordedMetrics, stamps_of
from flexslew_lab.studies.lanes.tolerance import TOLERANCE, apart
from flexslew_lab.studies.study import Study
from flexslew_lab.studies.ways import Way
from flexslew_lab.trial.trial import Trial
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import FlexslewError
from flexslew_plant.testbeds import Testbed
from flexslew_plant.testbeds.compiled.lanes import LANES
from flexslew_plant.testbeds.contract import Pointing
from flexslew_plant.testbeds.model import Model

_MOVED = 1e-14  # beginning of a twin: above the rounding of a tick, far below any metric
_FAR = 1e6  # a state beyond it is for the ordinary bench to judge
_KEPT = 32  # laws on a plan that are kept
_ROOM = 40_000_000  # for the numbers of their observers
_DOUBTS = {1.0: Way.EDGE, DISTRUSTED: Way.JUDGED}


class ForBench(NamedTuple):
    """A trial that only the bench can fly."""

    case: Case
    way: Way  # the reason


class _Gains(NamedTuple):
    """The gains of a lane, and the testbed for which they were found."""

    testbed: Testbed
    found: Vector | Way  # kp, ki and kd


class _Prepared(NamedTuple):
    """What a group has in common."""

    legs: tuple[Leg, ...]
    schedule: Schedule
    aim: Vector  # rows `tip` and `goal`, then the displacement
    goal: FlownManoeuvre
    kind: Hashable  # laws for which it is equal may fly side by side


class _Ready(NamedTuple):
    """A trial that may fly in a lane, with its law and its gains: kp, ki and kd."""

    lane: LaneTrial
    law: _Prepared
    gains: Vector


class _SideBySide(NamedTuple):
    """A group that was flown."""

    metrics: Callable[[int], dict[str, float | None] | None]  # of a lane; None: one raises
    far: Vector  # largest state of every lane at the end
    doubt: Vector  # of every lane, see LaneFlight.in_doubt
    quantised: bool  # readings or motors are

    def way(self, lane: int) -> Way:
        """Return LANES, or why the bench has to fly this lane's trial."""
        if not self.far[lane] < _FAR:
            return Way.FAR
        return _DOUBTS.get(self.doubt[lane], Way.LANES)

    def agrees(self, lane: int, metrics: Mapping[str, float | None]) -> bool:
        """Return whether its metrics are these."""
        own = self.metrics(lane) if self.way(lane) is not Way.FAR else None
        return own is not None and all(
            apart(own.get(name), value) <= TOLERANCE for name, value in metrics.items()
        )


@dataclass
class Lanes:
    """Flies trials of a study many at once; gives back those that only the bench can fly.

    Args:
        study: that the trials are of.
        plans: made already.
    """

    study: Study
    plans: Plans
    _prepared: dict[Hashable, _Prepared | Way] = field(init=False, default_factory=dict)
    _gains: dict[Hashable, _Gains] = field(init=False, default_factory=dict)
    _intake: LaneIntake = field(init=False)
    _large: dict[int, Hashable] = field(init=False, default_factory=dict)  # law, by variant
    _course: tuple[Hashable, Any] = field(init=False, default=(None, None))  # the newest

    def __post_init__(self) -> None:
        """Prepare to take cases."""
        self._intake = LaneIntake(self.study)

    def fly(self, cases: Sequence[Case]) -> Iterator[tuple[list[Flown], list[ForBench]]]:
        """Yield results, and cases that have to be flown one by one."""
        groups: dict[Hashable, list[_Ready]] = {}
        others = []
        for case, ready in self._all_ready(cases):
            if isinstance(ready, Way):
                others.append(ForBench(case, ready))
                continue
            key = ready.lane.together, ready.law.kind
            group = groups.setdefault(key, [])
            group.append(ready)
            if len(group) == LANES:
                yield self._fly_ready(groups.pop(key))
        for group in groups.values():
            yield self._fly_ready(group)
        if others:
            yield [], others

    def _all_ready(self, cases: Sequence[Case]) -> Iterator[tuple[Case, _Ready | Way]]:
        """Yield cases that are ready to fly, a group's worth looked at together."""
        for first in range(0, len(cases), LANES):
            some = cases[first : first + LANES]
            for case, lane in zip(some, self._intake.lane_trials(some), strict=True):
                yield case, self._ready(lane)

    def _ready(self, lane: LaneTrial | Way) -> _Ready | Way:
        """Return a trial with its law and gains; a way where only the bench can fly it."""
        if isinstance(lane, Way):
            return lane
        if not all(is_known(timed.fault) for timed in lane.happens.faults):
            return Way.FAULT
        law = self._prepare(lane)
        if isinstance(law, Way):
            return law
        gains = self._gains_of(lane, law)
        return gains if isinstance(gains, Way) else _Ready(lane, law, gains)

    def _fly_ready(self, ready: Sequence[_Ready]) -> tuple[list[Flown], list[ForBench]]:
        found, results, lost = self._side_by_side(ready), list[Flown](), list[ForBench]()
        # between quanta a loop is cut: what differs by rounding may grow there
        twin = self._side_by_side(ready, _MOVED) if found.quantised else None
        for k, one in enumerate(ready):
            case, way = one.lane.case, found.way(k)
            metrics = found.metrics(k) if way is Way.LANES else None
            if metrics is None:
                lost.append(ForBench(case, Way.METRICS if way is Way.LANES else way))
            elif twin is not None and not twin.agrees(k, metrics):
                lost.append(ForBench(case, Way.ROUNDING))
            else:
                failure = one.lane.happens.charge.failure
                became = "failed" if failure else "ok", failure
                results.append(Flown(case.number, metrics, None, *became, Way.LANES))
        return results, lost

    def _side_by_side(self, ready: Sequence[_Ready], moved: float = 0.0) -> _SideBySide:
        """Fly a group.

        Args:
            ready: its trials.
            moved: added to all states in which they begin.
        """
        group, prepared = [one.lane for one in ready], ready[0].law
        first, last = group[0], ready[-1]  # which fills up
        all_lanes = [*ready, *(last for _ in range(LANES - len(ready)))]
        counted = METRICS.keys() <= COUNTED and not first.trial.metrics
        recorded = isinstance(first.trial.testbed, Pointing) or not counted
        recorded = recorded and not first.happens.charge.failure
        flight = LaneFlight(
            [one.lane for one in all_lanes],
            [one.law.legs for one in all_lanes],
            np.array([one.gains for one in all_lanes]),
            prepared.schedule,
            prepared.aim,
            len(group),
            recorded,
            moved,
        )
        states = first.model.positions + first.model.coordinates
        start = flight.w[: first.model.joints * LANES].reshape(-1, LANES).copy()
        measured: Callable[[int], dict[str, float | None] | None]
        if recorded:
            measured = self._recorded(group, prepared, flight)
        elif first.happens.charge.failure:  # there is nothing to measure
            for cut in flight.cuts(len(prepared.schedule.time)):
                flight.fly(*cut)
            measured = _nothing
        else:
            for cut in flight.cuts(len(prepared.schedule.time)):
                flight.fly(*cut)
            aim = prepared.goal
            found = LaneMetrics(group, flight.rows, prepared.schedule, aim, start)
            measured = found.metrics(flight.w).__getitem__
        far = np.abs(flight.w[: states * LANES].reshape(-1, LANES)).max(axis=0)  # NaN, where it is
        return _SideBySide(measured, far, flight.in_doubt(), flight.quantised)

    def _recorded(
        self, group: Sequence[LaneTrial], prepared: _Prepared, flight: LaneFlight
    ) -> Callable[[int], dict[str, float | None] | None]:
        """Fly a group that is measured from its truth; return what gives the metrics of each."""
        model, period = group[0].model, group[0].trial.period
        source = self.study.source
        found = [RecordedMetrics(lane, prepared.goal, source) for lane in group]
        record = np.empty((LANES, TICKS, model.positions + model.coordinates + model.joints))
        for first, last in flight.cuts(TICKS):
            flight.fly(first, last, record)
            stamps = stamps_of(first, last, period)
            for one, truth in zip(found, record, strict=False):
                one.add(stamps, truth[: last - first])
        return lambda k: found[k].metrics()

    def _prepare(self, lane: LaneTrial) -> _Prepared | Way:
        """Return what is common to all like this one, or why the bench has to fly them."""
        if lane.law not in self._prepared:
            self._prepared[lane.law] = self._made(lane)
            while len(self._prepared) > _KEPT or (
                len(self._prepared) > 1 and sum(map(_size, self._prepared.values())) > _ROOM
            ):
                self._prepared.pop(next(iter(self._prepared)))
        return self._prepared[lane.law]

    def _gains_of(self, lane: LaneTrial, prepared: _Prepared) -> Vector | Way:
        """Return kp, ki and kd of a lane; a way where the bench refuses its gains."""
        trial, law = lane.trial, prepared.legs[0].form.law
        entry = law_entry(trial, trial.active)
        if len(prepared.legs) > 1 or not entry.lane_gains:
            return law.gains
        own = trial.controllers[trial.active] or {}
        key = lane.law, repr([own.get(name) for name in entry.lane_gains])
        known, checked = self._gains.get(key), entry.checked or lane.model.leading is not None
        if known is None or (checked and known.testbed != trial.testbed):
            if len(self._gains) >= _KEPT:
                self._gains.clear()
            controller = _allowed(trial, trial.active, "attitude")  # no filter has a part in them
            found = Way.NOT_ALLOWED if controller is None else gains_of(controller)
            known = self._gains[key] = _Gains(trial.testbed, found)
        return known.found

    def _followed(self, lane: LaneTrial, plan: Plan | None) -> LaneCourse:
        """Return a trial's plan tick by tick, or its rest where it has none."""
        trial = lane.trial
        ticks = round(trial.duration / trial.period)
        hold = np.zeros(lane.model.joints) if lane.hold is None else lane.hold
        key = (hold.tobytes() if plan is None else plan_hash(plan)), ticks
        if key != self._course[0]:
            made = course_of(plan, ticks) if plan else resting_course(hold, trial.period, ticks)
            self._course = key, made
        course: LaneCourse = self._course[1]
        return course

    def _made(self, lane: LaneTrial) -> _Prepared | Way:
        trial, variant = lane.trial, lane.case.variant
        if self._large.get(variant, lane.law) != lane.law:
            return Way.ALONG  # to make it takes as long as a flight of the bench
        try:
            plan = self.plans.of(trial, lane.asked)
        except FlexslewError:
            return Way.NOT_ALLOWED
        course = self._followed(lane, plan)
        legs, holds = list[Leg](), lane.hold is not None and lane.hold.any()
        for first, name in lane.happens.charge.legs:
            controller = _allowed(trial, name)
            if controller is None or (plan and controller.adopt(plan)) or controller.reason:
                return Way.NOT_ALLOWED
            if holds and hasattr(controller.estimator, "expect"):
                return Way.NO_PLAN  # it expects a rest at zero first
            form = form_of(trial, controller, course.references)
            if isinstance(form, Way):
                return form
            watch = watch_of(controller.monitor, form.observer)
            way = _way_of_leg(controller, form, watch, lane.happens.charge)
            if way is not Way.LANES:
                return way
            legs.append(Leg(first, name, form, controller.handover_ticks, watch))
        if len({_filter_of(leg.form) for leg in legs}) > 1:
            return Way.SWITCH
        if any(is_large(leg.form) for leg in legs):
            self._large[variant] = lane.law
        aim, goal = aim_of(lane, plan)
        kinds = tuple((leg.first, leg.blended, leg.watch, kind_of(leg.form)) for leg in legs)
        apart = plan is None and lane.model.attitude is None  # each may hold its own position
        follows = len(course.references) if apart else self._course[0]
        kind = kinds, follows, aim.tobytes()
        return _Prepared(tuple(legs), schedule_of(course), aim, goal, kind)


def _size(prepared: _Prepared | Way) -> int:
    """Return how many numbers its observers hold."""
    if isinstance(prepared, Way):
        return 0
    return sum(size_of(leg.form) for leg in prepared.legs)


def _allowed(trial: Trial, name: str, *left_out: str) -> Controller | None:
    """Return a controller of a trial without some of its keys; None: its design is refused."""
    try:
        return controller_of(trial, name, *left_out)
    except FlexslewError:
        return None


def form_of(trial: Trial, controller: Controller, references: list[Reference]) -> LinearForm | Way:
    """Return a controller of a trial as matrices, or why lanes do not fly it.

    Args:
        trial: that may fly in a lane.
        controller: of it.
        references: of every tick.
    """
    linear = law_entry(trial, controller.name).linear
    form = linear and linear(controller.estimator, controller.law, references)
    if form is None:
        return Way.SETTINGS
    way = _way_of_form(form, trial.testbed.model())
    return form if way is Way.LANES else way


def _way_of_leg(
    controller: Controller, form: LinearForm, watch: Watch | None, charge: Charge
) -> Way:
    """Return LANES, or why lanes do not have the measurements of a trial's controller."""
    if controller.name in charge.blinded and not _begins_anew(form):
        return Way.NAN
    alone = not (charge.legs[1:] or charge.failure)
    if controller.monitor is not None and (watch is None or not alone):
        return Way.JUDGED  # a filter of which lanes know no innovations, or several
    return Way.LANES


def _begins_anew(form: LinearForm) -> bool:
    """Return whether lanes can start its estimator again in flight."""
    found = form.observer.observer if isinstance(form.observer, OnModelForm) else form.observer
    known = not isinstance(found, SmallMotionForm)
    if isinstance(found, LinearObserver):
        known = found.state.ndim == 2  # else each tick has gains of its own
    return known and form.attitude is None and form.shared is None


def _nothing(lane: int) -> dict[str, float | None]:
    """Return what there is to measure of a trial that fails."""
    return {}


def _filter_of(form: LinearForm) -> Hashable:
    """Return what is equal for laws that have the same filters of the attitude."""
    craft = form.flexible.numbers if form.flexible is not None else ()
    return form.attitude and tuple(part.tobytes() for part in (*form.attitude, *craft))


def _way_of_form(form: LinearForm, model: Model) -> Way:
    """Return LANES where the law listens to what they read: joints, and tips moved by modes."""
    if isinstance(form.observer, KalmanForm) and model.leading is not None:
        return Way.ATTITUDE  # its joints are no coordinates
    sensors = model.appendages
    tips = form.shared is None and form.law.from_output.shape[-1] > 2 * model.joints
    exact = sensors.errors is None or not sensors.errors.any()
    known = not tips or (sensors.felt is None and sensors.body is None and exact)
    return Way.LANES if known else Way.TIPS
