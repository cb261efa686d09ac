"""The law that is active at a tick of the bench: controllers, their settings, switches to come."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from flexslew_control.controllers import (
    COMPUTED_KEYS,
    CONTROLLERS,
    PENDING,
    CommonSettings,
    law_values,
)
from flexslew_control.controllers.host import merged
from flexslew_control.law import ActiveLaw
from flexslew_control.plan import Plan, with_warning
from flexslew_control.plans.known_motion import PREDICTED
from flexslew_plant.bench.schedule import Schedule
from flexslew_plant.errors import BadInput
from flexslew_plant.events import (
    BRAKE,
    BrakeActivated,
    BrakeLatched,
    BrakeRequested,
    Fact,
    FallbackActivated,
    SwitchCompleted,
    SwitchDropped,
    SwitchRejected,
    SwitchRequested,
)
from flexslew_plant.settings import plain, validated
from flexslew_plant.yaml_data import load_yaml

LAW_KEY = "planned_for"  # key of a plan's summary
# after which no switch of an earlier tick is still to come
_FINAL_EVENTS = (SwitchCompleted, SwitchRejected, FallbackActivated, BrakeActivated, BrakeLatched)


class PendingSwitch(NamedTuple):
    """A switch that will take place unless it is dropped."""

    tick: int
    controller: str


class LawAt(NamedTuple):
    """The controller that is active at a tick, with its law."""

    controller: str
    law: ActiveLaw
    braked: bool = False  # the brake acts at that tick; the controller was active before

    @property
    def words(self) -> str:
        """One line for a person."""
        entries = ", ".join(f"{key} {value}" for key, value in self.law.settings.items())
        name = self.controller or self.law.law
        law = "" if name == self.law.law else f"{self.law.law}, "
        before = ", active before the brake" if self.braked else ""
        return f"{name} ({law}{entries or 'default settings'}){before}"


def switch_schedule(schedule: Schedule, period: float) -> tuple[PendingSwitch, ...]:
    """Return the switches of a `schedule` section.

    Args:
        schedule: of a trial.
        period: one tick [s].
    """
    return tuple(PendingSwitch(round(e.at / period), e.switch) for e in schedule if e.switch)


def active_at(active: str, switches: Iterable[PendingSwitch], tick: int) -> str:
    """Return the controller that is active at a tick.

    Args:
        active: the controller that is active before the switches.
        switches: that are due; of two at one tick the later one counts.
        tick: of the bench.
    """
    pending = sorted((s for s in switches if s.tick <= tick), key=lambda switch: switch.tick)
    return pending[-1].controller if pending else active


def canonical(law: ActiveLaw) -> ActiveLaw:
    """Return a law with those settings alone that differ from their defaults.

    Two laws that fly alike are then equal, however their settings were written.
    """
    values = dict(law.settings)
    common = {k: v for k, v in values.items() if k in CommonSettings.__annotations__}
    entries, kind = law_values(values), CONTROLLERS.get(law.law)
    try:
        found = _non_default(CommonSettings, common)
        found |= entries if kind is None else _non_default(kind.settings, entries)
    except BadInput:  # the controller itself is not built with them
        return law
    return ActiveLaw(law.law, dict(sorted(found.items())))


def _non_default(kind: Any, values: dict[str, Any]) -> dict[str, Any]:
    """Return the settings that differ from the defaults of their section, as plain data."""
    given: dict[str, Any] = plain(validated(kind, values, ""))
    try:
        defaults = plain(validated(kind, {}, ""))
    except BadInput:  # a section with a required key
        return given
    return {
        k: v for k, v in given.items() if k in values and (k not in defaults or v != defaults[k])
    }


class _LawStatus(NamedTuple):
    """The settings of a controller as its status reports them."""

    law: str
    values: Mapping[str, Any]
    due: tuple[tuple[int, Mapping[str, Any]], ...]  # tunings to come: tick, all settings from then


class ActiveLaws:
    """The controllers of a bench, from their statuses, the bench's state and the events.

    Args:
        initial: law of the controller that is active at tick 0, until its status has come;
            None: not known.
    """

    def __init__(self, initial: ActiveLaw | None = None) -> None:
        self._initial = initial
        self._status_by_name: dict[str, _LawStatus] = {}
        self._schedule: tuple[PendingSwitch, ...] = ()
        self._pending: list[PendingSwitch] = []
        self._active, self._before_brake = "", ""
        self._tick, self._epoch = 0, 0

    @property
    def has_active_law(self) -> bool:
        """Whether the law of the active controller is known."""
        return self.at(self._tick) is not None

    def begin(self, schedule: Schedule, period: float) -> None:
        """Take the schedule of a bench that was announced."""
        self._schedule = switch_schedule(schedule, period)
        self._pending = list(self._schedule)

    def take_status(self, status: Any) -> None:
        """Take a flexslew_msgs/ControllerStatus; one with settings that are not YAML is ignored."""
        try:
            given = load_yaml(status.settings, "settings")
        except BadInput:
            return
        if not isinstance(given, dict) or "file" in given:  # a node replaces a file by its content
            return
        values = {key: value for key, value in given.items() if key not in COMPUTED_KEYS}
        pending: list[tuple[int, dict[str, Any]]] = []
        for each in given.get(PENDING) or ():
            if isinstance(each, dict) and isinstance(each.get("tick"), int):
                changes = each.get("changes")
                values_then = merged(pending[-1][1] if pending else values, changes or {})
                pending.append((each["tick"], values_then))
        self._status_by_name[status.controller] = _LawStatus(status.law, values, tuple(pending))

    def take_state(self, active: str, tick: int, epoch: int) -> None:
        """Take where the bench is, of a flexslew_msgs/BenchState."""
        self._begin_epoch(epoch)
        self._tick, self._active = tick, active
        self._before_brake = active or self._before_brake

    def take_event(self, fact: Fact, tick: int, epoch: int) -> None:
        """Take what became of a switch; other events change nothing."""
        self._begin_epoch(epoch)
        if epoch < self._epoch:
            return
        if isinstance(fact, SwitchRequested):
            self._pending.append(PendingSwitch(fact.tick, fact.controller))
        elif isinstance(fact, BrakeRequested):
            if fact.on:  # which drops the switches that wait
                self._pending = [PendingSwitch(fact.tick, BRAKE)]
        elif isinstance(fact, SwitchDropped):
            dropped = PendingSwitch(fact.due, fact.controller)
            self._pending = [switch for switch in self._pending if switch != dropped]
        elif isinstance(fact, _FINAL_EVENTS):
            self._pending = [switch for switch in self._pending if switch.tick > tick]

    def at(self, tick: int) -> LawAt | None:
        """Return the law that will be active at a tick; None: not known.

        Where the brake acts then it is that of the controller that was active before.
        """
        name = active_at(self._active, self._remaining, tick)
        braked = not name and bool(self._before_brake)
        name = name or self._before_brake
        found = self._status_by_name.get(name)
        if found is None:
            return (
                None
                if self._initial is None or self._epoch or self._tick
                else LawAt(name, canonical(self._initial))
            )
        values = next((v for at, v in reversed(found.due) if at <= tick), found.values)
        return LawAt(name, canonical(ActiveLaw(found.law, dict(values))), braked)

    def switches(self, first: int, last: int) -> tuple[PendingSwitch, ...]:
        """Return the switches that are due after one tick and before another."""
        return tuple(switch for switch in self._remaining if first < switch.tick < last)

    @property
    def _remaining(self) -> list[PendingSwitch]:
        return [switch for switch in self._pending if switch.tick >= self._tick]

    def _begin_epoch(self, epoch: int) -> None:
        if epoch > self._epoch:
            self._epoch, self._tick = epoch, 0
            self._pending = list(self._schedule)


def describe_plan_law(plan: Plan) -> str:
    """Return in words for which law a plan is made; empty: for none, or it states none."""
    made_for = _plan_law(plan)
    return f"planned for {made_for.words}" if made_for is not None else ""


def other_law(plan: Plan, at: LawAt | None) -> str:
    """Return in words that a plan is made for another law than that at its start; empty: it is not.

    Args:
        plan: with the statement of with_law; without one it depends on no law.
        at: the law at its start now; None: not known.
    """
    made_for = _plan_law(plan)
    if at is None or made_for is None or made_for.law == at.law:
        return ""
    return (
        f"the plan from {plan.start:g} s on is made for {made_for.words}, but {at.words} is active "
        "at its start"
    )


def _plan_law(plan: Plan) -> LawAt | None:
    """Return the law that a plan states, see with_law; None: it states none."""
    entries = plan.summary.get(LAW_KEY)
    if not isinstance(entries, dict):
        return None
    law = canonical(ActiveLaw(str(entries.get("law")), entries.get("settings") or {}))
    return LawAt(str(entries.get("controller") or ""), law)


def with_law(plan: Plan, at: LawAt | None, later: Sequence[PendingSwitch] = ()) -> Plan:
    """Return the plan with a statement of the law that it and its prediction are made for.

    Args:
        plan: without one.
        at: the law at the plan's start; None: not known.
        later: switches that are due before the plan ends.
    """
    if at is None or PREDICTED not in plan.summary:  # such a plan depends on no law
        return plan
    entries = {"controller": at.controller, "law": at.law.law, "settings": dict(at.law.settings)}
    plan = replace(plan, summary={**plan.summary, LAW_KEY: entries})
    others = [switch for switch in later if switch.controller != at.controller]
    if not others:
        return plan
    first = min(others)
    return with_warning(
        plan,
        f"{first.controller} takes over at {first.tick * plan.period:g} s, before the plan "
        f"ends at {plan.end:g} s: plan and prediction are for {at.words}",
    )
