"""Trials flown at once: from trials to a batch and back to metrics."""

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.controllers.controller import Controller
from flexslew_control.controllers.linear_form import (
    KalmanForm,
    LinearForm,
    LinearObserver,
    OnModelForm,
    SmallMotionForm,
)
from flexslew_control.law import Reference
from flexslew_control.plan import Plan
from flexslew_control.plans.plan_file import plan_hash
from flexslew_lab.metrics.metric import ReferenceManoeuvre
from flexslew_lab.studies.batch.batch_metrics import BatchMetrics, needs_truth
from flexslew_lab.studies.batch.benches.batch_faults import is_supported
from flexslew_lab.studies.batch.benches.judge import SENSOR_ERROR
from flexslew_lab.studies.batch.groups.batch_laws import is_large, kind_of, size_of
from flexslew_lab.studies.batch.groups.batch_trial import (
    BatchBuilder,
    BatchTrial,
    controller_of,
    law_entry,
)
from flexslew_lab.studies.batch.groups.charge import Charge
from flexslew_lab.studies.batch.inputs import (
    PlanTable,
    gains_of,
    schedule_of,
    tabulate_hold,
    tabulate_plan,
    target_of,
)
from flexslew_lab.studies.batch.laws.watch import Watch, watch_of
from flexslew_lab.studies.batch.legs import BatchFlight, FlightMode, LawSegment
from flexslew_lab.studies.batch.loop import Schedule
from flexslew_lab.studies.batch.recorded import TICKS, RecordedMetrics, stamp_columns
from flexslew_lab.studies.batch.tolerance import TOLERANCE, relative_difference
from flexslew_lab.studies.cases import Case
from flexslew_lab.studies.flight import FlightResult, PlanCache
from flexslew_lab.studies.study import Study
from flexslew_lab.studies.ways import Way
from flexslew_lab.trial.trial import Trial
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import FlexslewError
from flexslew_plant.testbeds import Testbed
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH
from flexslew_plant.testbeds.model import Model

_OFFSET = 1e-14  # beginning of a twin: above the rounding of a tick, far below any metric
FAR = 1e6  # a state beyond it is for the ordinary bench to judge
_KEPT = 32  # laws on a plan that are kept
_MAX_SIZE = 40_000_000  # for the numbers of their observers
_REASONS = {1.0: Way.EDGE, SENSOR_ERROR: Way.MONITORED}


class ForBench(NamedTuple):
    """A trial that only the bench can fly."""

    case: Case
    way: Way  # the reason


class _Gains(NamedTuple):
    """The gains of a member, and the testbed for which they were found."""

    testbed: Testbed
    found: Vector | Way  # kp, ki and kd


class _Prepared(NamedTuple):
    """What a group has in common."""

    segments: tuple[LawSegment, ...]
    schedule: Schedule
    target: Vector  # rows `tip` and `goal`, then the displacement
    goal: ReferenceManoeuvre
    kind: Hashable  # laws for which it is equal may fly side by side
    references: list[Reference]  # of every tick


class ReadyTrial(NamedTuple):
    """A trial that may fly in a batch, with its law and its gains: kp, ki and kd."""

    member: BatchTrial
    law: _Prepared
    gains: Vector

    @property
    def group(self) -> Hashable:
        """What is equal for trials that may fly side by side."""
        return self.member.together, self.law.kind

    @property
    def recorded(self) -> bool:
        """Whether the truth of its flight is recorded for its metrics."""
        return needs_truth(self.member.trial) and not self.member.happens.charge.failure


def batch_flight(
    ready: Sequence[ReadyTrial], offset: float = 0.0, stepped: bool = False
) -> BatchFlight:
    """Return the flight of a group.

    Args:
        ready: its trials, at most BATCH_WIDTH, which may fly side by side.
        offset: added to all states in which they begin.
        stepped: see FlightMode.
    """
    prepared, last = ready[0].law, ready[-1]  # which fills up
    all_members = [*ready, *(last for _ in range(BATCH_WIDTH - len(ready)))]
    return BatchFlight(
        [one.member for one in all_members],
        [one.law.segments for one in all_members],
        np.array([one.gains for one in all_members]),
        prepared.schedule,
        prepared.target,
        len(ready),
        FlightMode(ready[0].recorded, offset, stepped),
    )


class _SideBySide(NamedTuple):
    """A group that was flown."""

    metrics: Callable[[int], dict[str, float | None] | None]  # of a member; None: one raises
    far: Vector  # largest state of every member at the end
    doubt: Vector  # of every member, see BatchFlight.fallback_codes
    quantised: bool  # readings or motors are

    def way(self, member: int) -> Way:
        """Return BATCH, or why the bench has to fly this member's trial."""
        if not self.far[member] < FAR:
            return Way.FAR
        return _REASONS.get(self.doubt[member], Way.BATCH)

    def agrees(self, member: int, metrics: Mapping[str, float | None]) -> bool:
        """Return whether its metrics are these."""
        values = self.metrics(member) if self.way(member) is not Way.FAR else None
        return values is not None and all(
            relative_difference(values.get(name), value) <= TOLERANCE
            for name, value in metrics.items()
        )


@dataclass
class BatchRunner:
    """Flies trials of a study many at once; gives back those that only the bench can fly.

    Args:
        study: that the trials are of.
        plans: made already.
    """

    study: Study
    plans: PlanCache
    _prepared: dict[Hashable, _Prepared | Way] = field(init=False, default_factory=dict)
    _gains: dict[Hashable, _Gains] = field(init=False, default_factory=dict)
    _trial_source: BatchBuilder = field(init=False)
    _large: dict[int, Hashable] = field(init=False, default_factory=dict)  # law, by variant
    _last_reference: tuple[Hashable, Any] = field(init=False, default=(None, None))  # the newest

    def __post_init__(self) -> None:
        """Prepare to take cases."""
        self._trial_source = BatchBuilder(self.study)

    def fly(self, cases: Sequence[Case]) -> Iterator[tuple[list[FlightResult], list[ForBench]]]:
        """Yield results, and cases that have to be flown one by one."""
        groups: dict[Hashable, list[ReadyTrial]] = {}
        others = []
        for case, ready in self.all_ready(cases):
            if isinstance(ready, Way):
                others.append(ForBench(case, ready))
                continue
            key = ready.group
            group = groups.setdefault(key, [])
            group.append(ready)
            if len(group) == BATCH_WIDTH:
                yield self._simulate_group(groups.pop(key))
        for group in groups.values():
            yield self._simulate_group(group)
        if others:
            yield [], others

    def all_ready(self, cases: Sequence[Case]) -> Iterator[tuple[Case, ReadyTrial | Way]]:
        """Yield cases that are ready to fly, a group's worth looked at together."""
        for first in range(0, len(cases), BATCH_WIDTH):
            some = cases[first : first + BATCH_WIDTH]
            for case, member in zip(some, self._trial_source.batch_trials(some), strict=True):
                yield case, self._ready(member)

    def _ready(self, member: BatchTrial | Way) -> ReadyTrial | Way:
        """Return a trial with its law and gains; a way where only the bench can fly it."""
        if isinstance(member, Way):
            return member
        if not all(is_supported(timed.fault) for timed in member.happens.faults):
            return Way.FAULT
        law = self._prepare(member)
        if isinstance(law, Way):
            return law
        gains = self._gains_of(member, law)
        return gains if isinstance(gains, Way) else ReadyTrial(member, law, gains)

    def _simulate_group(
        self, ready: Sequence[ReadyTrial]
    ) -> tuple[list[FlightResult], list[ForBench]]:
        found, results, lost = self._side_by_side(ready), list[FlightResult](), list[ForBench]()
        # between quanta a loop is cut: what differs by rounding may grow there
        second_run = self._side_by_side(ready, _OFFSET) if found.quantised else None
        for k, one in enumerate(ready):
            case, way = one.member.case, found.way(k)
            metrics = found.metrics(k) if way is Way.BATCH else None
            if metrics is None:
                lost.append(ForBench(case, Way.METRICS if way is Way.BATCH else way))
            elif second_run is not None and not second_run.agrees(k, metrics):
                lost.append(ForBench(case, Way.ROUNDING))
            else:
                failure = one.member.happens.charge.failure
                outcome = "failed" if failure else "ok", failure
                results.append(FlightResult(case.number, metrics, None, *outcome, Way.BATCH))
        return results, lost

    def _side_by_side(self, ready: Sequence[ReadyTrial], offset: float = 0.0) -> _SideBySide:
        """Fly a group.

        Args:
            ready: its trials.
            offset: added to all states in which they begin.
        """
        group, prepared = [one.member for one in ready], ready[0].law
        first, recorded = group[0], ready[0].recorded
        flight = batch_flight(ready, offset)
        states = first.model.positions + first.model.coordinates
        start = flight.w[: first.model.joints * BATCH_WIDTH].reshape(-1, BATCH_WIDTH).copy()
        measured: Callable[[int], dict[str, float | None] | None]
        if recorded:
            measured = self._recorded(group, prepared, flight)
        elif first.happens.charge.failure:  # there is nothing to measure
            for cut in flight.intervals(len(prepared.schedule.time)):
                flight.fly(*cut)
            measured = _no_metrics
        else:
            for cut in flight.intervals(len(prepared.schedule.time)):
                flight.fly(*cut)
            target = prepared.goal
            found = BatchMetrics(group, flight.rows, prepared.schedule, target, start)
            measured = found.metrics(flight.w).__getitem__
        far = np.abs(flight.w[: states * BATCH_WIDTH].reshape(-1, BATCH_WIDTH)).max(
            axis=0
        )  # NaN, where it is
        return _SideBySide(measured, far, flight.fallback_codes(), flight.quantised)

    def _recorded(
        self, group: Sequence[BatchTrial], prepared: _Prepared, flight: BatchFlight
    ) -> Callable[[int], dict[str, float | None] | None]:
        """Fly a group that is measured from its truth; return what gives the metrics of each."""
        model, period = group[0].model, group[0].trial.period
        source = self.study.source
        found = [RecordedMetrics(member, prepared.goal, source) for member in group]
        record = np.empty((BATCH_WIDTH, TICKS, model.positions + model.coordinates + model.joints))
        for first, last in flight.intervals(TICKS):
            flight.fly(first, last, record)
            times = stamp_columns(first, last, period)
            for one, truth in zip(found, record, strict=False):
                one.add(times, truth[: last - first])
        return lambda k: found[k].metrics()

    def _prepare(self, member: BatchTrial) -> _Prepared | Way:
        """Return what is common to all like this one, or why the bench has to fly them."""
        if member.law not in self._prepared:
            self._prepared[member.law] = self._made(member)
            while len(self._prepared) > _KEPT or (
                len(self._prepared) > 1 and sum(map(_size, self._prepared.values())) > _MAX_SIZE
            ):
                self._prepared.pop(next(iter(self._prepared)))
        return self._prepared[member.law]

    def _gains_of(self, member: BatchTrial, prepared: _Prepared) -> Vector | Way:
        """Return kp, ki and kd of a member; a way where the bench refuses its gains."""
        trial, law = member.trial, prepared.segments[0].form.law
        entry = law_entry(trial, trial.active)
        if len(prepared.segments) > 1 or not entry.batch_gains:
            return law.gains
        values = trial.controllers[trial.active] or {}
        key = member.law, repr([values.get(name) for name in entry.batch_gains])
        known, checked = self._gains.get(key), entry.checked or member.model.leading is not None
        if known is None or (checked and known.testbed != trial.testbed):
            if len(self._gains) >= _KEPT:
                self._gains.clear()
            controller = _allowed(trial, trial.active, "attitude")  # no filter has a part in them
            found = Way.NOT_ALLOWED if controller is None else gains_of(controller)
            known = self._gains[key] = _Gains(trial.testbed, found)
        return known.found

    def _member_reference(self, member: BatchTrial, plan: Plan | None) -> PlanTable:
        """Return a trial's plan tick by tick, or its rest where it has none."""
        trial = member.trial
        ticks = round(trial.duration / trial.period)
        rest_position = np.zeros(member.model.joints) if member.hold is None else member.hold
        key = (rest_position.tobytes() if plan is None else plan_hash(plan)), ticks
        if key != self._last_reference[0]:
            made = (
                tabulate_plan(plan, ticks)
                if plan
                else tabulate_hold(rest_position, trial.period, ticks)
            )
            self._last_reference = key, made
        reference: PlanTable = self._last_reference[1]
        return reference

    def _made(self, member: BatchTrial) -> _Prepared | Way:
        trial, variant = member.trial, member.case.variant
        if self._large.get(variant, member.law) != member.law:
            return Way.ALONG  # to make it takes as long as a flight of the bench
        try:
            plan = self.plans.of(trial, member.request)
        except FlexslewError:
            return Way.NOT_ALLOWED
        reference = self._member_reference(member, plan)
        segments, nonzero_rest = list[LawSegment](), member.hold is not None and member.hold.any()
        for first, name in member.happens.charge.segments:
            controller = _allowed(trial, name)
            if controller is None or (plan and controller.adopt(plan)) or controller.reason:
                return Way.NOT_ALLOWED
            if nonzero_rest and hasattr(controller.estimator, "expect"):
                return Way.NO_PLAN  # it expects a rest at zero first
            form = form_of(trial, controller, reference.references)
            if isinstance(form, Way):
                return form
            watch = watch_of(controller.monitor, form.observer)
            way = _way_of_segment(controller, form, watch, member.happens.charge)
            if way is not Way.BATCH:
                return way
            segments.append(LawSegment(first, name, form, controller.handover_ticks, watch))
        if len({_filter_of(segment.form) for segment in segments}) > 1:
            return Way.SWITCH
        if any(is_large(segment.form) for segment in segments):
            self._large[variant] = member.law
        target, goal = target_of(member, plan)
        kinds = tuple(
            (segment.first, segment.transition_ticks, segment.watch, kind_of(segment.form))
            for segment in segments
        )
        separate = plan is None and member.model.attitude is None  # each may hold its own position
        reference_key = len(reference.references) if separate else self._last_reference[0]
        kind = kinds, reference_key, target.tobytes()
        schedule = schedule_of(reference)
        return _Prepared(tuple(segments), schedule, target, goal, kind, reference.references)


def _size(prepared: _Prepared | Way) -> int:
    """Return how many numbers its observers hold."""
    if isinstance(prepared, Way):
        return 0
    return sum(size_of(segment.form) for segment in prepared.segments)


def _allowed(trial: Trial, name: str, *left_out: str) -> Controller | None:
    """Return a controller of a trial without some of its keys; None: its design is refused."""
    try:
        return controller_of(trial, name, *left_out)
    except FlexslewError:
        return None


def form_of(trial: Trial, controller: Controller, references: list[Reference]) -> LinearForm | Way:
    """Return a controller of a trial as matrices, or why batches do not fly it.

    Args:
        trial: that may fly in a batch.
        controller: of it.
        references: of every tick.
    """
    linear = law_entry(trial, controller.name).linear
    form = linear and linear(controller.estimator, controller.law, references)
    if form is None:
        return Way.SETTINGS
    way = _way_of_form(form, trial.testbed.model())
    return form if way is Way.BATCH else way


def _way_of_segment(
    controller: Controller, form: LinearForm, watch: Watch | None, charge: Charge
) -> Way:
    """Return BATCH, or why batches do not have the measurements of a trial's controller."""
    if controller.name in charge.without_estimate and not _can_restart(form):
        return Way.NAN
    single = not (charge.segments[1:] or charge.failure)
    if controller.monitor is not None and (watch is None or not single):
        return Way.MONITORED  # a filter of which batches know no innovations, or several
    return Way.BATCH


def _can_restart(form: LinearForm) -> bool:
    """Return whether batches can start its estimator again in flight."""
    found = form.observer.observer if isinstance(form.observer, OnModelForm) else form.observer
    known = not isinstance(found, SmallMotionForm)
    if isinstance(found, LinearObserver):
        known = found.state.ndim == 2  # else each tick has gains of its own
    return known and form.attitude is None and form.shared is None


def _no_metrics(member: int) -> dict[str, float | None]:
    """Return what there is to measure of a trial that fails."""
    return {}


def _filter_of(form: LinearForm) -> Hashable:
    """Return what is equal for laws that have the same filters of the attitude."""
    spacecraft = form.flexible.numbers if form.flexible is not None else ()
    return form.attitude and tuple(part.tobytes() for part in (*form.attitude, *spacecraft))


def _way_of_form(form: LinearForm, model: Model) -> Way:
    """Return BATCH where the law reads what batches measure: joints, and tips moved by modes."""
    if isinstance(form.observer, KalmanForm) and model.leading is not None:
        return Way.ATTITUDE  # its joints are no coordinates
    tips = form.shared is None and form.law.from_output.shape[-1] > 2 * model.joints
    return Way.BATCH if not tips or model.appendages.all_tips else Way.TIPS
