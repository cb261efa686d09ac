"""Which trials may fly side by side in a batch."""

import json
from collections.abc import Hashable, Sequence
from dataclasses import replace
from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.controllers import CONTROLLERS, LawEntry, build_controller
from flexslew_control.controllers.controller import Controller
from flexslew_lab.studies.batch.groups.batch_kernels import BatchSteps, batch_steps
from flexslew_lab.studies.batch.groups.blindness import EstimateLoss, estimate_loss, find_invalid
from flexslew_lab.studies.batch.groups.charge import Charge, charge_of
from flexslew_lab.studies.cases import Case, case_trial
from flexslew_lab.studies.flight import has_every_key, plan_key, uses_testbed
from flexslew_lab.studies.study import Study
from flexslew_lab.studies.ways import Way
from flexslew_lab.trial.trial import Trial, law_of, plant_of
from flexslew_plant.arrays import Vector
from flexslew_plant.bench.divergence import integration_of
from flexslew_plant.bench.injections import injections_of, names_of
from flexslew_plant.bench.retarget import with_schedule
from flexslew_plant.bench.schedule import ScheduleEntry
from flexslew_plant.errors import FlexslewError
from flexslew_plant.faults import Names, Timed
from flexslew_plant.faults.actuators import CommandDelay
from flexslew_plant.faults.injection import Faults
from flexslew_plant.hardware.disturbances import TimedDisturbance
from flexslew_plant.hardware.friction import friction_of
from flexslew_plant.hardware.sensors import Sensors, exact_readings
from flexslew_plant.settings import plain
from flexslew_plant.testbeds import initial_state, models_of
from flexslew_plant.testbeds.compiled.batch_kernel import BatchKernel
from flexslew_plant.testbeds.instruments.packed_readers import are_packed
from flexslew_plant.testbeds.integration_error import COARSE
from flexslew_plant.testbeds.model import Model

# steps where a kernel's own differ by 5e-11: then they differ by 1e-13, too
_STEP_FACTOR = 4


class TrialEvents(NamedTuple):
    """What happens to a trial by its schedule."""

    charge: Charge
    disturbances: tuple[TimedDisturbance, ...]
    faults: tuple[Timed, ...]


class BatchTrial(NamedTuple):
    """A trial that may fly in a batch."""

    case: Case
    trial: Trial
    request: str  # its plan_key: a plan itself is large, and some have one of their own
    model: Model
    kernel: BatchKernel
    steps: int  # of the kernel per tick
    hold: Vector | None  # first measured positions, which are held where there is no plan
    happens: TrialEvents
    has_friction: bool  # its motors have friction
    law: Hashable  # trials for which it is equal have the same law, but for its batch_gains
    together: Hashable  # trials for which it is equal may fly at once, if their laws may


class _Common(NamedTuple):
    """What does not depend on the testbed, and what it was made from."""

    source: tuple[Any, ...]
    way: Way
    noisy: tuple[bool, ...]  # by channel that a law may read: whether it errs
    request: str = ""
    course: str = ""
    law: str = ""


class _Candidate(NamedTuple):
    """A trial that may fly in a batch, but for the way in which its testbed flies."""

    case: Case
    trial: Trial
    model: Model
    happens: TrialEvents
    common: _Common
    has_friction: bool


class BatchBuilder:
    """Turns cases of a study into member trials; keeps what many have in common."""

    def __init__(self, study: Study) -> None:
        self._study = study
        self._common: dict[int, _Common] = {}  # newest by variant
        self._events: dict[int, tuple[tuple[Any, ...], TrialEvents | Way]] = {}

    def batch_trials(self, cases: Sequence[Case]) -> list[BatchTrial | Way]:
        """Return cases ready for members; a way where only the bench can fly one."""
        turned = [(case, self._trial_of_case(case)) for case in cases]
        requested = [(case, *one) for case, one in turned if one is not None]
        models = models_of([trial.testbed for _, trial, _ in requested])
        found: dict[int, BatchTrial | Way] = {case.number: Way.NOT_ALLOWED for case in cases}
        flying = list[_Candidate]()
        for (case, trial, key), model in zip(requested, models, strict=True):
            candidate = self._candidate(case, trial, key, model)
            if isinstance(candidate, Way):
                found[case.number] = candidate
            else:
                flying.append(candidate)
        steps = batch_steps([one.model for one in flying], [one.trial.period for one in flying])
        for candidate, config in zip(flying, steps, strict=True):
            if config is not None:
                found[candidate.case.number] = _batch_trial(candidate, config)
        return [found[case.number] for case in cases]

    def _trial_of_case(self, case: Case) -> tuple[Trial, str] | None:
        """Return the trial of a case and its plan_key; None if it is refused."""
        try:
            return _with_target_changes(case_trial(self._study, case))
        except FlexslewError:
            return None

    def _candidate(
        self, case: Case, trial: Trial, requested: str, model: Model | FlexslewError
    ) -> _Candidate | Way:
        if isinstance(model, FlexslewError):
            return Way.NOT_ALLOWED
        try:
            events = self._trial_events(case.variant, trial, model)
            if isinstance(events, Way):
                return events
            common = self._common_parts(case.variant, trial, events.charge, requested)
            way = common.way if common.way is not Way.BATCH else way_of_testbed(model, trial.period)
            if way is not Way.BATCH:
                return way
            has_friction = friction_of(trial.actuator, model, trial.period) is not None
        except FlexslewError:
            return Way.NOT_ALLOWED
        return _Candidate(case, trial, model, events, common, has_friction)

    def _trial_events(self, variant: int, trial: Trial, model: Model) -> TrialEvents | Way:
        """Return what happens to a trial; that of the one before, if it is the same."""
        source: tuple[Any, ...] = (trial.schedule, trial.active, trial.fallback, trial.max_missed)
        source += (trial.duration, trial.period, trial.testbed.effort_limit)
        source += model.joint_names, model.appendages.names
        known = self._events.get(variant)
        if known is not None and known[0] == source:
            return known[1]
        fault_schedule = fault_schedule_of(trial, model)
        lost_estimates = _lost_estimates(trial, model, fault_schedule.faults)
        charge = (
            lost_estimates
            if isinstance(lost_estimates, Way)
            else charge_of(trial, fault_schedule.faults, lost_estimates)
        )
        found = charge if isinstance(charge, Way) else TrialEvents(charge, *fault_schedule)
        is_random = any(
            getattr(timed.fault, "probability", 1.0) < 1.0 for timed in fault_schedule.faults
        )
        if not (
            is_random or lost_estimates
        ):  # chance is the seed's, the readers depend on all keys
            self._events[variant] = source, found
        return found

    def _common_parts(self, variant: int, trial: Trial, charge: Charge, requested: str) -> _Common:
        testbed = trial.testbed
        known_before = _known_before(trial)
        control_sequence = charge.segments, charge.restarts, charge.last
        source: tuple[Any, ...] = (trial.plan, trial.controllers, control_sequence, known_before)
        source += (trial.period, trial.duration, trial.metrics, trial.plausibility, trial.actuator)
        source += (trial.sensors, type(testbed), testbed.effort_limit, testbed.initial)
        known = self._common.get(variant)
        if known is not None and known.source == source:
            return known
        channels = read_channels(trial)
        noisy = tuple(bool(channel.noise or channel.bias) for channel in channels)
        if (way := way_of_settings(trial, charge)) is not Way.BATCH:
            self._common[variant] = _Common(source, way, noisy)
            return self._common[variant]
        law, config = law_of(trial.active, trial.controllers[trial.active] or {})
        gains, testbed_model = CONTROLLERS[law].batch_gains, True
        requested = requested or plan_key(trial)
        shared = [law, trial.duration, control_sequence, plain(known_before), testbed.kind]
        segments = {name: trial.controllers[name] for _, name in charge.segments}
        if len(segments) > 1:  # each law is made for each trial
            config = segments
        else:
            config = {key: value for key, value in config.items() if key not in gains}
            # joints and instruments are of the craft that flies, not of the law's model
            entry = CONTROLLERS[law]
            testbed_model = entry.reads_testbed(config) or not (
                gains or entry.any_testbed or has_every_key(config.get("model"), testbed)
            )
        design_model = plain(testbed) if testbed_model else None
        keys = (
            json.dumps(part, sort_keys=True)
            for part in (shared, [*shared, requested, config, design_model])
        )
        common = _Common(source, way, noisy, requested, *keys)
        if not (testbed_model or uses_testbed(plain(trial.plan) or {}, testbed)):
            self._common[variant] = common
        return common


def _batch_trial(one: _Candidate, config: BatchSteps) -> BatchTrial | Way:
    """Return a trial ready for a member; a way where only the bench can fly it."""
    case, trial, model, events, common, has_friction = one
    kernel = config.kernel
    try:
        steps = _bench_steps(trial, model, config)
    except FlexslewError:
        return Way.NOT_ALLOWED
    if isfinite(kernel.reach) and _is_quantised(trial):
        steps *= _STEP_FACTOR
    turned = b"" if model.attitude is None else model.attitude.axes.tobytes()
    tips = model.appendages.tip.tobytes()
    instrument_layout = b""
    if model.appendages.instruments:
        instrument_layout = model.appendages.packed(trial.period, None).layout.tobytes()
    motor = bool(trial.actuator.lag), bool(trial.actuator.slew_rate), has_friction
    window = trial.plausibility and trial.plausibility.window
    outside = model.outside and (model.outside.add, model.outside.numbers.size)
    bench = (
        kernel.advance,
        steps,
        common.noisy,
        turned,
        tips,
        instrument_layout,
        motor,
        window,
        outside,
    )
    hold_position = None if trial.plan is not None else _first_measured(trial, model, events.faults)
    if hold_position is not None and not np.isfinite(hold_position).all():
        return Way.NAN
    hold_key = b"" if hold_position is None else hold_position.tobytes()
    law, batch_key = (common.law, hold_key, *bench), (common.course, *bench)
    fields = trial, common.request, model, kernel, steps, hold_position
    return BatchTrial(case, *fields, events, has_friction, law, batch_key)


def _bench_steps(trial: Trial, model: Model, config: BatchSteps) -> int:
    """Return the steps in a tick: those of the bench, or of a kernel with a scheme of its own.

    Raises:
        BadInput: the bench refuses the period.
    """
    kernel, steps = config
    if isfinite(kernel.reach) and steps * kernel.reach <= COARSE:
        return steps
    q, _ = model.split(initial_state(trial.testbed))
    given = trial.integration_steps
    bench = integration_of(model, q, trial.period, trial.duration, given).steps
    return steps if isfinite(kernel.reach) else bench


def _with_target_changes(trial: Trial) -> tuple[Trial, str]:
    """Return a trial with the new targets of its schedule as turns of its testbed.

    Behind it stands its plan_key, which is that of the schedule; empty: it has no new targets.
    """
    if all(entry.retarget is None for entry in trial.schedule):
        return trial, ""
    others = tuple(entry for entry in trial.schedule if entry.retarget is None)
    testbed = with_schedule(trial.testbed, trial.schedule)
    return replace(trial, testbed=testbed, schedule=others), plan_key(trial)


class FaultSchedule(NamedTuple):
    """What disturbs a trial and what breaks in it, in the order of its schedule."""

    disturbances: tuple[TimedDisturbance, ...]
    faults: tuple[Timed, ...]


def fault_schedule_of(trial: Trial, model: Model) -> FaultSchedule:
    """Return what disturbs a trial and what breaks in it; see injections_of for what is refused."""
    names = names_of(model, np.array(trial.testbed.effort_limit))
    found = injections_of(trial.schedule, names, trial.period)
    disturbances = tuple(one for one in found if isinstance(one, TimedDisturbance))
    return FaultSchedule(disturbances, tuple(one for one in found if isinstance(one, Timed)))


def _lost_estimates(trial: Trial, model: Model, faults: Sequence[Timed]) -> EstimateLoss | Way:
    """Return which controllers of a trial have no estimate when."""
    if not faults:
        return {}
    names = Names(model.joint_names, model.appendages.names, ())
    nan = find_invalid(names, faults, trial.seed, round(trial.duration / trial.period))
    if not nan.any():
        return {}
    controllers = [controller_of(trial, name) for name in trial.controllers]
    found = estimate_loss(controllers, model, initial_state(trial.testbed), nan)
    if isinstance(found, Way):
        return found
    return {name: when for name, when in found.items() if when.any()}


def _known_before(trial: Trial) -> tuple[ScheduleEntry, ...]:
    """Return what plans and laws know of the schedule before the flight; see plant_of."""
    return tuple(e for e in trial.schedule if e.at <= 0.0 and isinstance(e.fault, CommandDelay))


def _first_measured(trial: Trial, model: Model, faults: Sequence[Timed]) -> Vector:
    """Return the positions of the joints that are measured at tick 0, shape (joints,)."""
    x, zero_effort = initial_state(trial.testbed), np.zeros(model.efforts)
    sensors = Sensors(trial.sensors, model, trial.period, [trial.seed, 0])  # epoch 0
    readings = sensors.read(exact_readings(model, x, zero_effort, 0.0), x)
    names = Names(model.joint_names, model.appendages.names, ())
    active_faults = Faults(names, trial.seed, 0, tuple(faults))
    active_faults.begin(0, zero_effort, zero_effort)
    return active_faults.read(readings).joint_position


def _is_quantised(trial: Trial) -> bool:
    """Return whether last digits may turn into whole quanta, or pulses."""
    motor = trial.actuator
    channels = any(channel.quantisation for channel in read_channels(trial))
    return bool(channels or motor.quantisation or motor.shortest_pulse)


def way_of_settings(trial: Trial, charge: Charge) -> Way:
    """Return BATCH, or what of a trial's settings only the bench flies."""
    config = [trial.controllers[name] or {} for _, name in charge.segments]
    laws = [
        law_of(segment[1], values)[0]
        for segment, values in zip(charge.segments, config, strict=True)
    ]
    known = all(law in CONTROLLERS and CONTROLLERS[law].linear for law in laws)
    later = known and all(CONTROLLERS[law].takes_over for law in laws[1:])
    conditions = (
        (not known, Way.LAW),  # its entry's `linear` has the last word
        (not later, Way.SWITCH),
    )
    return next((way for condition, way in conditions if condition), Way.BATCH)


def way_of_testbed(model: Model, period: float) -> Way:
    """Return BATCH, or what of a testbed only the bench flies."""
    conditions = (
        (not model.has_equations, Way.BLACK_BOX),
        (model.reading is not None and model.kernels.reading is None, Way.JOINTS),
        (model.efforts != model.joints, Way.EFFORTS),
        (not are_packed(model.appendages.instruments, period), Way.SENSOR),
    )
    return next((way for condition, way in conditions if condition), Way.BATCH)


def law_entry(trial: Trial, name: str) -> LawEntry:
    """Return the law of a controller of a trial that may fly in a batch."""
    return CONTROLLERS[law_of(name, trial.controllers[name] or {})[0]]


def controller_of(trial: Trial, name: str, *left_out: str) -> Controller:
    """Return a controller of a trial, without a plan and without some of its keys."""
    law, config = law_of(name, trial.controllers[name] or {})
    config = {key: value for key, value in config.items() if key not in left_out}
    return build_controller(name, law, config, plant_of(trial), trial.name)


def read_channels(trial: Trial) -> tuple[Any, Any, Any]:
    """Return the settings of the sensors that a law may read: joints, their rates, tips."""
    s = trial.sensors
    return s.joint_position, s.joint_velocity, s.tip_deflection
