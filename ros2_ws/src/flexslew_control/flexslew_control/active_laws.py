"""The law that is active at a tick of the bench: controllers, their settings, switches to come."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from flexslew_control.controllers import CONTROLLERS, DERIVED, DUE, CommonSettings, law_values
from flexslew_control.controllers.host import merged
from flexslew_control.known_motion import PREDICTED
from flexslew_control.law import ActiveLaw
from flexslew_control.plan import Plan, with_warning
from flexslew_plant.bench.schedule import Schedule
from flexslew_plant.errors import BadInput
from flexslew_plant.events import (
    BRAKE,
    BrakeLatched,
    BrakeRequested,
    BrakeTookOver,
    Fact,
    FallbackTookOver,
    SwitchDropped,
    Switched,
    SwitchRefused,
    SwitchRequested,
)
from flexslew_plant.settings import plain, validated
from flexslew_plant.yaml_data import load_yaml

PLANNED_FOR = "planned_for"  # key of a plan's summary
# after which no switch of an earlier tick is still to come
_DECIDED = (Switched, SwitchRefused, FallbackTookOver, BrakeTookOver, BrakeLatched)


class DueSwitch(NamedTuple):
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
        own = ", ".join(f"{key} {value}" for key, value in self.law.settings.items())
        name = self.controller or self.law.law
        law = "" if name == self.law.law else f"{self.law.law}, "
        before = ", active before the brake" if self.braked else ""
        return f"{name} ({law}{own or 'default settings'}){before}"


def switches_of(schedule: Schedule, period: float) -> tuple[DueSwitch, ...]:
    """Return the switches of a `schedule` section.

    Args:
        schedule: of a trial.
        period: one tick [s].
    """
    return tuple(DueSwitch(round(e.at / period), e.switch) for e in schedule if e.switch)


def active_at(active: str, switches: Iterable[DueSwitch], tick: int) -> str:
    """Return the controller that is active at a tick.

    Args:
        active: the controller that is active before the switches.
        switches: that are due; of two at one tick the later one counts.
        tick: of the bench.
    """
    due = sorted((s for s in switches if s.tick <= tick), key=lambda switch: switch.tick)
    return due[-1].controller if due else active


def canonical(law: ActiveLaw) -> ActiveLaw:
    """Return a law with those settings alone that differ from their defaults.

    Two laws that fly alike are then equal, however their settings were written.
    """
    values = dict(law.settings)
    common = {k: v for k, v in values.items() if k in CommonSettings.__annotations__}
    own, kind = law_values(values), CONTROLLERS.get(law.law)
    try:
        found = _differing(CommonSettings, common)
        found |= own if kind is None else _differing(kind.settings, own)
    except BadInput:  # the controller itself is not built with them
        return law
    return ActiveLaw(law.law, dict(sorted(found.items())))


def _differing(kind: Any, values: dict[str, Any]) -> dict[str, Any]:
    """Return the settings that differ from the defaults of their section, as plain data."""
    given: dict[str, Any] = plain(validated(kind, values, ""))
    try:
        defaults = plain(validated(kind, {}, ""))
    except BadInput:  # a section with a required key
        return given
    return {
        k: v for k, v in given.items() if k in values and (k not in defaults or v != defaults[k])
    }


class _Announced(NamedTuple):
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
        self._announced: dict[str, _Announced] = {}
        self._scheduled: tuple[DueSwitch, ...] = ()
        self._due: list[DueSwitch] = []
        self._active, self._before_brake = "", ""
        self._tick, self._epoch = 0, 0

    @property
    def known(self) -> bool:
        """Whether the law of the active controller is known."""
        return self.at(self._tick) is not None

    def begin(self, schedule: Schedule, period: float) -> None:
        """Take the schedule of a bench that was announced."""
        self._scheduled = switches_of(schedule, period)
        self._due = list(self._scheduled)

    def take_status(self, status: Any) -> None:
        """Take a flexslew_msgs/ControllerStatus; one with settings that are not YAML is ignored."""
        try:
            given = load_yaml(status.settings, "settings")
        except BadInput:
            return
        if not isinstance(given, dict) or "file" in given:  # a node replaces a file by its content
            return
        values = {key: value for key, value in given.items() if key not in DERIVED}
        due: list[tuple[int, dict[str, Any]]] = []
        for each in given.get(DUE) or ():
            if isinstance(each, dict) and isinstance(each.get("tick"), int):
                changes = each.get("changes")
                values_then = merged(due[-1][1] if due else values, changes or {})
                due.append((each["tick"], values_then))
        self._announced[status.controller] = _Announced(status.law, values, tuple(due))

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
            self._due.append(DueSwitch(fact.tick, fact.controller))
        elif isinstance(fact, BrakeRequested):
            if fact.on:  # which drops the switches that wait
                self._due = [DueSwitch(fact.tick, BRAKE)]
        elif isinstance(fact, SwitchDropped):
            gone = DueSwitch(fact.due, fact.controller)
            self._due = [switch for switch in self._due if switch != gone]
        elif isinstance(fact, _DECIDED):
            self._due = [switch for switch in self._due if switch.tick > tick]

    def at(self, tick: int) -> LawAt | None:
        """Return the law that will be active at a tick; None: not known.

        Where the brake acts then it is that of the controller that was active before.
        """
        name = active_at(self._active, self._to_come, tick)
        braked = not name and bool(self._before_brake)
        name = name or self._before_brake
        found = self._announced.get(name)
        if found is None:
            return (
                None
                if self._initial is None or self._epoch or self._tick
                else LawAt(name, canonical(self._initial))
            )
        values = next((v for at, v in reversed(found.due) if at <= tick), found.values)
        return LawAt(name, canonical(ActiveLaw(found.law, dict(values))), braked)

    def switches(self, first: int, last: int) -> tuple[DueSwitch, ...]:
        """Return the switches that are due after one tick and before another."""
        return tuple(switch for switch in self._to_come if first < switch.tick < last)

    @property
    def _to_come(self) -> list[DueSwitch]:
        return [switch for switch in self._due if switch.tick >= self._tick]

    def _begin_epoch(self, epoch: int) -> None:
        if epoch > self._epoch:
            self._epoch, self._tick = epoch, 0
            self._due = list(self._scheduled)


def planned_for(plan: Plan) -> str:
    """Return in words for which law a plan is made; empty: for none, or it states none."""
    made_for = _stated(plan)
    return f"planned for {made_for.words}" if made_for is not None else ""


def other_law(plan: Plan, at: LawAt | None) -> str:
    """Return in words that a plan is made for another law than that at its start; empty: it is not.

    Args:
        plan: with the statement of with_law; without one it depends on no law.
        at: the law at its start now; None: not known.
    """
    made_for = _stated(plan)
    if at is None or made_for is None or made_for.law == at.law:
        return ""
    return (
        f"the plan from {plan.start:g} s on is made for {made_for.words}, but {at.words} is active "
        "at its start"
    )


def _stated(plan: Plan) -> LawAt | None:
    """Return the law that a plan states, see with_law; None: it states none."""
    own = plan.summary.get(PLANNED_FOR)
    if not isinstance(own, dict):
        return None
    law = canonical(ActiveLaw(str(own.get("law")), own.get("settings") or {}))
    return LawAt(str(own.get("controller") or ""), law)


def with_law(plan: Plan, at: LawAt | None, later: Sequence[DueSwitch] = ()) -> Plan:
    """Return the plan with a statement of the law that it and its prediction are made for.

    Args:
        plan: without one.
        at: the law at the plan's start; None: not known.
        later: switches that are due before the plan ends.
    """
    if at is None or PREDICTED not in plan.summary:  # such a plan depends on no law
        return plan
    own = {"controller": at.controller, "law": at.law.law, "settings": dict(at.law.settings)}
    plan = replace(plan, summary={**plan.summary, PLANNED_FOR: own})
    others = [switch for switch in later if switch.controller != at.controller]
    if not others:
        return plan
    first = min(others)
    return with_warning(
        plan,
        f"{first.controller} takes over at {first.tick * plan.period:g} s, before the plan "
        f"ends at {plan.end:g} s: plan and prediction are for {at.words}",
    )
