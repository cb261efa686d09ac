"""Which trials may fly beside each other in lanes."""

import json
from collections.abc import Hashable
from math import ceil
from typing import Any, NamedTuple

from flexslew_control.controllers import CONTROLLERS, LawEntry, build_controller
from flexslew_control.controllers.controller import Controller
from flexslew_lab.studies.cases import Case, case_trial
from flexslew_lab.studies.flight import plan_key, sets_every_key, uses_testbed
from flexslew_lab.studies.study import Study
from flexslew_lab.studies.ways import Way
from flexslew_lab.trial.trial import Trial, law_of, plant_of
from flexslew_plant.errors import FlexslewError
from flexslew_plant.settings import plain
from flexslew_plant.testbeds.compiled.lane_by_lane import lane_by_lane
from flexslew_plant.testbeds.compiled.lanes import LaneKernel, knows_frequency
from flexslew_plant.testbeds.compiled.traced_kernel import traced_kernel
from flexslew_plant.testbeds.model import Model


class LaneTrial(NamedTuple):
    """A trial that may fly in a lane."""

    case: Case
    trial: Trial
    asked: str  # its plan_key: a plan itself is large, and some have one of their own
    model: Model
    kernel: LaneKernel
    steps: int  # of the kernel per tick
    law: Hashable  # trials for which it is equal have the same law, but for its lane_gains
    together: Hashable  # trials for which it is equal may fly at once, if their laws may


class _Common(NamedTuple):
    """What does not depend on the testbed, and what it was made from."""

    source: tuple[Any, ...]
    way: Way
    noisy: tuple[bool, ...]  # by channel that a law may read: whether it errs
    asked: str = ""
    course: str = ""
    law: str = ""


class LaneIntake:
    """Turns cases of a study into lane trials; keeps what many have in common."""

    def __init__(self, study: Study) -> None:
        self._study = study
        self._common: dict[int, _Common] = {}  # newest by variant

    def lane_trial(self, case: Case) -> LaneTrial | Way:
        """Return a case ready for a lane; a way where only the bench can fly it."""
        try:
            trial = case_trial(self._study, case)
            common = self._said(case.variant, trial)
            model = trial.testbed.model()
            way = common.way if common.way is not Way.LANES else way_of_testbed(trial)
            if way is not Way.LANES:
                return way
            bound = trial.testbed if knows_frequency(trial.testbed) else None
            kernel = traced_kernel(model, bound is not None) or lane_by_lane(model)
        except FlexslewError:
            return Way.NOT_ALLOWED
        fast = 0.0 if bound is None else bound.highest_frequency() * trial.period
        steps = max(1, ceil(fast / kernel.reach))
        turned = b"" if model.attitude is None else model.attitude.axes.tobytes()
        tips = model.appendages.tip.tobytes()
        told = b""
        if model.appendages.instruments:
            told = model.appendages.packed(trial.period, None).layout.tobytes()
        motor = bool(trial.actuator.lag), bool(trial.actuator.slew_rate)
        outside = model.outside and (model.outside.add, model.outside.numbers.size)
        bench = (kernel.advance, steps, common.noisy, turned, tips, told, motor, outside)
        law, together = (common.law, *bench), (common.course, *bench)
        return LaneTrial(case, trial, common.asked, model, kernel, steps, law, together)

    def _said(self, variant: int, trial: Trial) -> _Common:
        testbed = trial.testbed
        source: tuple[Any, ...] = (trial.plan, trial.controllers, trial.active, trial.schedule)
        source += (trial.period, trial.duration, trial.metrics, trial.allow_faults, trial.actuator)
        source += (trial.sensors, type(testbed), testbed.effort_limit, testbed.initial)
        known = self._common.get(variant)
        if known is not None and known.source == source:
            return known
        channels = _read_channels(trial)
        noisy = tuple(bool(channel.noise or channel.bias) for channel in channels)
        if (way := way_of_settings(trial)) is not Way.LANES:
            self._common[variant] = _Common(source, way, noisy)
            return self._common[variant]
        law, own = law_of(trial.active, trial.controllers[trial.active] or {})
        gains, believes = CONTROLLERS[law].lane_gains, True
        asked = plan_key(trial)
        shared = [law, trial.duration, plain(trial.schedule), testbed.kind]
        legs = {name: trial.controllers[name] for _, name in in_charge(trial)}
        if len(legs) > 1:  # each law is made for each trial
            own = legs
        else:
            own = {key: value for key, value in own.items() if key not in gains}
            # joints and instruments are of the craft that flies, whatever the law believes
            knows = any(own.get(key) not in (None, False) for key in CONTROLLERS[law].of_testbed)
            believes = knows or not (gains or sets_every_key(own.get("model"), testbed))
        belief = plain(testbed) if believes else None
        texts = (
            json.dumps(part, sort_keys=True) for part in (shared, [*shared, asked, own, belief])
        )
        common = _Common(source, way, noisy, asked, *texts)
        if not (believes or uses_testbed(plain(trial.plan), testbed)):
            self._common[variant] = common
        return common


def way_of_settings(trial: Trial) -> Way:
    """Return LANES, or what of a trial's settings only the bench knows."""
    s, motor = trial.sensors, trial.actuator
    channels = (s.joint_position, s.joint_velocity, s.tip_deflection, s.root_curvature)
    legs = in_charge(trial)
    laws = [law_of(name, trial.controllers[name] or {})[0] for _, name in legs]
    known = all(law in CONTROLLERS and CONTROLLERS[law].linear for law in laws)
    ticks = {tick for tick, _ in legs}
    broken = any(entry.disturbance is None and entry.switch is None for entry in trial.schedule)
    later = known and all(CONTROLLERS[law].takes_over for law in laws[1:])
    obstacles = (
        (bool(motor.quantisation or motor.viscous_friction or motor.coulomb_friction), Way.MOTORS),
        (any(channel.quantisation for channel in channels), Way.QUANTISED),
        (broken or len(ticks) < len(legs), Way.SCHEDULE),
        (trial.plan is None, Way.NO_PLAN),
        (not known, Way.LAW),  # its entry's `linear` has the last word
        (not later, Way.SWITCH),
    )
    return next((way for there, way in obstacles if there), Way.LANES)


def way_of_testbed(trial: Trial) -> Way:
    """Return LANES, or what of a trial's testbed only the bench knows."""
    model = trial.testbed.model()
    obstacles = (
        (model.reading is not None and model.kernels.reading is None, Way.JOINTS),
        (model.efforts != model.joints, Way.EFFORTS),
    )
    return next((way for there, way in obstacles if there), Way.LANES)


def in_charge(trial: Trial) -> list[tuple[int, str]]:
    """Return which controllers a trial's schedule puts in charge, each from which tick on."""
    legs, end = [(0, trial.active)], round(trial.duration / trial.period)
    switches = [(round(e.at / trial.period), e.switch) for e in trial.schedule if e.switch]
    for tick, name in sorted(switches, key=lambda switch: switch[0]):
        if tick < end and name != legs[-1][1]:
            legs.append((tick, name))
    return legs


def law_entry(trial: Trial, name: str) -> LawEntry:
    """Return the law of a controller of a trial that may fly in a lane."""
    return CONTROLLERS[law_of(name, trial.controllers[name] or {})[0]]


def controller_of(trial: Trial, name: str, *left_out: str) -> Controller:
    """Return a controller of a trial, without a plan and without some of its keys."""
    law, own = law_of(name, trial.controllers[name] or {})
    own = {key: value for key, value in own.items() if key not in left_out}
    return build_controller(name, law, own, plant_of(trial), trial.name)


def _read_channels(trial: Trial) -> tuple[Any, Any, Any]:
    s = trial.sensors
    return s.joint_position, s.joint_velocity, s.tip_deflection
