"""A trial file: the bench, the controllers that fly it, and what happens when."""

from dataclasses import fields, replace
from math import floor
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
from pydantic import Discriminator, Field, Tag

from flexslew_control.active_laws import LawAt, active_at, canonical, switch_schedule, with_law
from flexslew_control.controllers import (
    DEFAULT,
    build_controller,
    require_settings,
    with_file,
)
from flexslew_control.controllers.controller import Controller
from flexslew_control.law import ActiveLaw, PlantDescription
from flexslew_control.plan import Plan
from flexslew_control.planners import (
    PLANNERS,
    PlanSettings,
    make_plan,
    plan_settings,
    require_section,
    with_plan_files,
)
from flexslew_control.planners.checks.first_point import with_jump
from flexslew_control.planners.law_gains import law_gains
from flexslew_control.planners.slew import Feedback
from flexslew_control.plans.plan_file import load_plan
from flexslew_lab.progress import phase
from flexslew_lab.short_values import short
from flexslew_plant.bench.bench import Bench
from flexslew_plant.bench.injections import injections_of, names_of
from flexslew_plant.bench.records import BenchSettings, RateSettings
from flexslew_plant.bench.retarget import with_schedule
from flexslew_plant.bench.schedule import command_delay_ticks, require_allowed
from flexslew_plant.counted import count_text
from flexslew_plant.errors import BadInput
from flexslew_plant.faults.commands import ControllerSilent
from flexslew_plant.given_file import given_text
from flexslew_plant.hardware.actuator import ActuatorSettings, minimum_impulse
from flexslew_plant.hardware.friction import coefficients
from flexslew_plant.hardware.sensors import SensorSettings
from flexslew_plant.joint_quantities import require_units_of_joints
from flexslew_plant.keys.refused_keys import LIST_FOR_KEYS
from flexslew_plant.near_names import spelling_hint
from flexslew_plant.notebook_table import in_notebook
from flexslew_plant.own_code import NO_CODE, Trust
from flexslew_plant.refusal import Refusal
from flexslew_plant.settings import NotAKey, Positive, plain, section, validated
from flexslew_plant.testbeds import Testbed, TestbedSettings, default_testbed, with_model_file
from flexslew_plant.testbeds.contract import has_own_clock
from flexslew_plant.yaml_data import load_yaml, require_short, yaml_text


def _default_controllers() -> dict[str, dict[str, Any]]:
    return {DEFAULT: {}}


@section
class SavedPlan:
    """The `plan` section that flies a plan from its file."""

    file: Annotated[str, Field(min_length=1)]  # the saved plan, a path from the working directory


def _plan_form(values: Any) -> str:
    """Return which of the two forms of a `plan` section is meant."""
    saved = "file" in values if isinstance(values, dict) else isinstance(values, SavedPlan)
    return "saved" if saved else "asked"


PlanKey: TypeAlias = Annotated[
    Annotated[PlanSettings, Tag("asked")] | Annotated[SavedPlan, Tag("saved")],
    Discriminator(_plan_form),
]


@section
class Trial(BenchSettings, RateSettings):
    """The keys of a trial file: the bench, and the controllers that fly it."""

    # name of the run and of its folder: letters, digits, `_`, `.`, `-`
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]+$")] = "trial"
    duration: Positive = 100.0  # length of the run [s], simulated
    plan: PlanKey | None = None  # the manoeuvre; null: hold the first measured position
    # controllers by name; all of them run, one is in charge
    controllers: dict[str, dict[str, Any]] = Field(default_factory=_default_controllers)
    # largest `goal_error` (see metrics.json) of a run that has reached its goal [-]; a run that has
    # not ends with exit code 1
    goal_tolerance: Positive = 0.1
    # metrics of your own besides the bench's: `my_metric.py:MyMetric`, see metrics.json
    metrics: tuple[str, ...] = ()
    trust: NotAKey[Trust] = Field(default=NO_CODE, exclude=True, repr=False)

    def __repr__(self) -> str:
        """Return one line: the testbed, the duration, the plan and the controllers."""
        plan = "no plan"
        if self.plan is not None:
            plan = self.plan.file if isinstance(self.plan, SavedPlan) else self.plan.method
        what = f"{self.testbed.kind}, {self.duration:g} s, {plan}"
        return f"<Trial {self.name}: {what}; {', '.join(self.controllers)}>"

    def _repr_html_(self) -> str:
        """Return its main sections, for notebooks."""
        plan = {} if self.plan is None else plain(self.plan)
        manoeuvre = {k: plan[k] for k in ("goal", "start", "duration") if plan.get(k) is not None}
        rows = [
            ("testbed", f"{self.testbed.kind}, {count_text(self.testbed.modes, 'mode')}"),
            (
                "joints",
                ", ".join(f"{n} [{u}]" for n, u in self.testbed.model().units_by_joint.items()),
            ),
            ("plan", plan.get("method", plan.get("file", "none"))),
            *((f"plan.{key}", short(value)) for key, value in manoeuvre.items()),
            ("controllers", ", ".join(self.controllers)),
            ("active", self.active),
            ("schedule", count_text(len(self.schedule), "event")),
            ("duration", f"{self.duration:g} s in ticks of {self.period:g} s"),
        ]
        return in_notebook(repr(self), (), rows)

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel to another process as its keys: it finds there what a file holds by its name."""
        return trial_of_values, (plain(self), self.name, self.trust)


def load_trial(path: Path, trust: Trust = NO_CODE) -> Trial:
    """Return the trial of a file.

    Args:
        path: of it.
        trust: which classes of the user's own it may name.

    Raises:
        BadInput: the file cannot be read, or one of its values is not allowed.
    """
    return checked_trial(parse_trial(text_of(path), str(path), trust), str(path))


def text_of(path: Path) -> str:
    """Return the text of a trial file.

    Raises:
        BadInput: it cannot be read.
    """
    return given_text(path)


_MOST_TICKS = 1e12  # of a run


def checked_trial(trial: Trial, source: str) -> Trial:
    """Return a trial that is about to be flown, checked for errors that an old log may contain.

    Raises:
        BadInput: if it has too many ticks or none, an entry of the schedule is after the end or
            silences no controller, a plan that ends in motion is over before the run, settings
            of a controller are wrong, or the testbed lacks what the goal or the schedule names.
    """
    _require_settings(trial, source)
    if not trial.duration / trial.period <= _MOST_TICKS:
        words = f"more than {_MOST_TICKS:g} ticks of {trial.period:g} s"
        raise BadInput(words, source, "duration", trial.duration)
    if has_own_clock(trial.testbed) and trial.rate_factor:
        words = "the testbed has a clock of its own, which paces the run; give 0"
        raise BadInput(words, source, "rate_factor", trial.rate_factor)
    if round(trial.duration / trial.period) < 1:
        words = f"at least a tick of {trial.period:g} s"
        raise BadInput(words, source, "duration", trial.duration)
    until = getattr(trial.plan, "turns_until", None)
    if until is not None and round(until / trial.period) < round(trial.duration / trial.period):
        raise BadInput(
            f"the craft still turns when the plan is over, at {until:g} s, and the run ends at "
            f"{trial.duration:g} s; let the plan last until then",
            source,
            "plan.duration",
            getattr(trial.plan, "duration", None),
        )
    for i, entry in enumerate(trial.schedule):
        if round(entry.at / trial.period) >= round(trial.duration / trial.period):
            raise BadInput(
                f"the run ends at {trial.duration:g} s; choose an earlier time or a longer "
                "duration",
                source,
                f"schedule.{i}.at",
                entry.at,
            )
        if isinstance(entry.fault, ControllerSilent):
            _require_controller(
                trial, entry.fault.controller, source, f"schedule.{i}.fault.controller"
            )
    return trial


def _require_settings(trial: Trial, source: str) -> None:
    """Check what stands in `controllers`, goal and schedule, as far as that needs no design."""
    plant = plant_of(trial)
    names = names_of(plant.testbed.model(), plant.effort_limit)
    injections_of(trial.schedule, names, trial.period, source)
    try:
        motors, model = trial.actuator, plant.testbed.model()
        minimum_impulse(motors, model.joint_names, plant.effort_limit, trial.period)
        coefficients(model.resolved_motors, motors)
    except BadInput as error:
        raise BadInput(error.refusal.within("actuator", source)) from None
    for name, values in trial.controllers.items():
        law, user_settings = law_of(name, values or {})
        require_settings(law, user_settings, plant, f"{source}: controllers.{name}")
    plan: Any = trial.plan
    if getattr(plan, "method", None) in PLANNERS:
        require_section(plan, plant, source)


def _require_controller(trial: Trial, name: str, source: str, key: str) -> None:
    if not trial.controllers:
        raise BadInput("give at least one, for example {pd_feedforward: {}}", source, "controllers")
    if name not in trial.controllers:
        known = ", ".join(trial.controllers)
        hint = spelling_hint(name, trial.controllers)
        raise BadInput(f"{name} is not in controllers; {hint}allowed: {known}", source, key)


def parse_trial(text: str, source: str, trust: Trust = NO_CODE) -> Trial:
    """Return the trial of a YAML text; see load_trial."""
    return trial_of_values(load_yaml(text, source), source, trust)


def trial_of_values(values: Any, source: str, trust: Trust = NO_CODE) -> Trial:
    """Return the trial that plain data describe; see load_trial."""
    if not isinstance(values, dict):
        words = "holds no keys; `flexslew trials` lists examples"
        raise BadInput(LIST_FOR_KEYS if isinstance(values, list) else words, source)
    trial: Trial = validated(Trial, values, source, trust)
    require_units_of_joints(Trial, values, trial.testbed, source)
    if trial.trust != trust:
        trial = replace(trial, trust=trust)
    if "" in trial.controllers:  # that name is the brake's
        raise BadInput("a name", source, "controllers", "")
    requested = {"active": trial.active} | {
        f"fallback.{i}": c for i, c in enumerate(trial.fallback)
    }
    requested |= {
        f"schedule.{i}.switch": e.switch for i, e in enumerate(trial.schedule) if e.switch
    }
    for key, controller in requested.items():
        _require_controller(trial, controller, source, key)
    require_allowed(trial.schedule, trial.allow_faults, source)
    return _with_files(trial, source)


def _with_files(trial: Trial, source: str) -> Trial:
    """Return the trial with what the files of laws and models hold in place of their names.

    So a log holds all that flew, and is flown again without the files.
    """
    read = {}
    for name, values in trial.controllers.items():
        law, _ = law_of(name, values or {})
        user_settings, place = dict(values or {}), f"{source}: controllers.{name}"
        if "file" in user_settings:
            user_settings = with_file(law, user_settings, place, trial.trust)
        if isinstance(user_settings.get("model"), dict):
            user_settings["model"] = with_model_file(
                user_settings["model"], f"{place}.model", trial.trust
            )
        read[name] = user_settings if values else values
    plan: Any = trial.plan
    model = getattr(plan, "model", None)
    if isinstance(model, dict):
        plan = replace(plan, model=with_model_file(model, f"{source}: plan.model", trial.trust))
    plan = with_plan_files(plan, source, trial.trust)
    if read == trial.controllers and plan is trial.plan:
        return trial
    return replace(trial, controllers=read, plan=plan)


@section
class _SeparateSections:
    """Sections of a trial that no other one is checked against."""

    testbed: TestbedSettings = Field(default_factory=default_testbed)
    actuator: ActuatorSettings = ActuatorSettings()
    sensors: SensorSettings = SensorSettings()


SEPARATE_SECTIONS = frozenset(field.name for field in fields(_SeparateSections))


def with_sections(trial: Trial, values: dict[str, Any], source: str) -> Trial:
    """Return a checked trial with other sections of ALONE, and with its own name, seed and pace.

    Many times as fast as trial_of_values for all of it.

    Args:
        trial: the trial; sections without a new value stay.
        values: plain data of the new sections; seed, name and rate_factor as they are.
        source: source for messages.

    Raises:
        BadInput: if a value of a section is not allowed.
    """
    given = {name: value for name, value in values.items() if name in SEPARATE_SECTIONS}
    sections = validated(_SeparateSections, given, source, trial.trust)
    read = {name: getattr(sections, name) for name in given}
    other = object.__new__(Trial)  # all of it is checked
    vars(other).update({**vars(trial), **values, **read})
    return other


def trial_text(trial: Trial) -> str:
    """Return the trial as YAML with every default written out; parse_trial reads it back.

    Raises:
        BadInput: it is longer than a log can hold.
    """
    text = yaml_text(plain(trial))
    require_short(text, f"trial {trial.name}")
    return text


def bench_settings(trial: Trial) -> BenchSettings:
    """Return the part of the trial that the plant needs."""
    return BenchSettings(**{item.name: getattr(trial, item.name) for item in fields(BenchSettings)})


def law_of(name: str, values: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """Return which law a controller of the trial runs, and that law's own values."""
    user_settings = dict(values)
    return str(user_settings.pop("law", name)), user_settings


def build_controllers(trial: Trial, source: str) -> dict[str, Controller]:
    """Return the trial's controllers by name.

    Raises:
        BadInput: a law or one of its values is not allowed.
    """
    built = {}
    plant = plant_of(trial)
    for name, values in trial.controllers.items():
        law, user_settings = law_of(name, values or {})
        built[name] = build_controller(
            name,
            law,
            user_settings,
            plant,
            f"{source}: controllers.{name}",
        )
    return built


def set_up(
    trial: Trial, source: str, testbed: Testbed | None = None
) -> tuple[Bench, dict[str, Controller]]:
    """Return the trial's bench at tick 0 and its controllers.

    Args:
        trial: what the controllers are designed for.
        source: its file, for messages.
        testbed: what stands on the bench; None: the trial's own.

    Raises:
        BadInput: a law or one of its values is not allowed.
    """
    plant_trial = trial if testbed is None else replace(trial, testbed=testbed)
    try:
        bench = Bench(bench_settings(plant_trial))
    except BadInput as error:
        user_settings = error.refusal.source  # the file of a user's testbed
        raise BadInput(replace(error.refusal, source=user_settings or source)) from None
    return bench, build_controllers(trial, source)


def set_plan(controllers: dict[str, Controller], active: str, plan: Plan | None) -> Refusal | None:
    """Let controllers follow a plan; return why the one in charge cannot, or None.

    Another one that cannot is not ready.
    """
    if plan is None:
        return None
    refusals = {name: controller.adopt(plan) for name, controller in controllers.items()}
    return refusals[active] or controllers[active].reason


def plan_of_trial(trial: Trial, predict: bool = True) -> Plan | None:
    """Return the trial's plan, or None where it has none.

    Args:
        trial: the trial that flies it.
        predict: see make_plan.

    Raises:
        BadInput, PlanFailed: see make_plan.
    """
    if trial.plan is None:
        return None
    plant = plant_of(trial)
    if isinstance(trial.plan, SavedPlan):
        return with_jump(load_plan(trial.plan.file), plant, {})
    law, gains = law_in_charge(trial), feedback_of(trial)
    with phase(f"planning by {trial.plan.method}", "iteration") as count:
        plan = make_plan(
            trial.plan, plant, gains, lambda update: count(update.number, 0), law, predict
        )
    plan = with_law_statement(trial, plan)
    return with_jump(plan, plant, {}) if getattr(trial.plan, "initial", None) else plan


def plan_section_of(trial: Trial, source: str) -> PlanSettings | None:
    """Return the `plan` section of a trial; that of a saved plan is the one it was made from.

    Raises:
        BadInput: the file of the plan is no plan.
    """
    if isinstance(trial.plan, SavedPlan):
        saved = load_plan(trial.plan.file)
        return plan_settings(saved.request, f"{source}: plan: {trial.plan.file}", trial.trust)
    return trial.plan


def plant_of(trial: Trial) -> PlantDescription:
    """Return what stands on the trial's bench."""
    limit = np.array(trial.testbed.effort_limit, dtype=np.float64)
    testbed = with_schedule(trial.testbed, trial.schedule)
    delay = command_delay_ticks(trial.schedule, testbed.model().joint_names, 0.0)
    return PlantDescription(
        testbed, trial.period, limit, trial.trust, trial.actuator, delay, trial.schedule
    )


def active_controller(trial: Trial, time: float) -> str:
    """Return the controller that the schedule has made active by a simulated time [s].

    Fallbacks of a controller that falls silent do not count.
    """
    now = floor(time / trial.period + 1e-6)  # a tick that rounding has moved is that tick
    return active_at(trial.active, switch_schedule(trial.schedule, trial.period), now)


def law_in_charge(trial: Trial) -> ActiveLaw:
    """Return the law of the controller that is active at the start of the trial's plan."""
    name = _plan_controller(trial)
    return ActiveLaw(*law_of(name, trial.controllers[name] or {}))


def feedback_of(trial: Trial) -> Feedback | None:
    """Return the joint gains of that law, where it has such gains."""
    place = f"controllers.{_plan_controller(trial)}"
    return law_gains(law_in_charge(trial), plant_of(trial), place)


def with_law_statement(trial: Trial, plan: Plan) -> Plan:
    """Return the plan of a trial with a statement of the law that it is made for."""
    at = LawAt(_plan_controller(trial), canonical(law_in_charge(trial)))
    first, last = plan.first_tick, plan.first_tick + plan.ticks
    switches = switch_schedule(trial.schedule, trial.period)
    return with_law(plan, at, [switch for switch in switches if first < switch.tick < last])


def _plan_controller(trial: Trial) -> str:
    return active_controller(trial, getattr(trial.plan, "start", None) or 0.0)
