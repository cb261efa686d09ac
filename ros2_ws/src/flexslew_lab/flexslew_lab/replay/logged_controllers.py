"""The controllers of a log, built again, and the plans that they followed from which tick on."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol, TypeVar

from flexslew_control.controllers import (
    COMPUTED_KEYS,
    CONTROLLERS,
    OUTPUT_FEEDBACK,
    build_controller,
)
from flexslew_control.controllers.controller import Answer, Controller
from flexslew_control.controllers.host import merged
from flexslew_control.message_fields import in_flight, received_plan
from flexslew_control.plan import Plan
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.messages.cdr import decode
from flexslew_lab.log.messages.logged_event import logged_event
from flexslew_lab.log.messages.logged_text import logged_yaml
from flexslew_lab.trial.overrides import override_values
from flexslew_lab.trial.trial import Trial, law_of, plant_of, trial_of_values
from flexslew_plant.errors import BadInput
from flexslew_plant.events import ControllerTuned, EstimateStarted
from flexslew_plant.graph.topics import PLAN, TOPICS
from flexslew_plant.measurement import Measurement
from flexslew_plant.own_code import Trust, Untrusted, allow_words, file_of

Key = tuple[int, int]  # epoch and tick
_Kind = TypeVar("_Kind", ControllerTuned, EstimateStarted)


class ReplayedController(Protocol):
    """What answers the question of a tick."""

    def observe(self, measurement: Measurement) -> Answer | None:
        """Return the answer if the measurement names it."""


class PlanMessage(NamedTuple):
    """A plan as it was published."""

    plan: Plan
    of_flight: bool  # in flight: a reset drops it


class PlanChange(NamedTuple):
    """A controller took a plan."""

    controller: str
    first: Key  # question that it answered with this plan
    told: tuple[PlanMessage, ...]  # the plan, after those before it that a newcomer also received


def trial_of(bag: BagReader, changes: Mapping[str, Any] | None = None) -> Trial:
    """Return the trial that a bag was recorded from.

    Args:
        bag: to read.
        changes: values by path that replace those of the trial.

    Raises:
        BadInput: if the bag holds no trial, or none that this version reads.
    """
    if not bag.trial_text:
        raise BadInput("holds no trial", bag.path)
    source = f"{bag.path}: trial"
    values = logged_yaml(bag.trial_text, source)
    for path in changes or ():
        if path.partition(".")[0] == "plan":  # else it would change nothing, in silence
            raise BadInput(
                "a log is flown again with the plan that it holds, nothing is planned again; "
                "fly the trial.yaml of its run with another plan",
                key=path,
            )
    if changes:
        values = override_values(values, dict(changes))
    return trial_of_values(values, source, bag.trust)


class LoggedControllers:
    """Controllers as a log names them, each at its state before tick 0.

    Args:
        bag: source of the controllers.
        only: name of the only controller needed; None: all of the trial and of the log.
        replacements: laws and settings by name that replace those of the log.
        trial: trial that replaces the log's.
        trust: laws that may be loaded; None: those that the log may load.
        programs: that stand in for controllers of the log, by name; see replay.program.

    Raises:
        BadInput: if the log lacks data for it, or a law cannot be built.
    """

    def __init__(
        self,
        bag: BagReader,
        only: str | None = None,
        replacements: Mapping[str, tuple[str, dict[str, Any]]] | None = None,
        trial: Trial | None = None,
        trust: Trust | None = None,
        programs: Mapping[str, ReplayedController] = MappingProxyType({}),
    ) -> None:
        overview = bag.overview
        testbed = overview.testbed
        if testbed is None:
            raise BadInput("does not name its testbed (no /testbed)", bag.path)
        laws = logged_laws(bag) | dict(replacements or {})
        self._source = str(bag.path)
        self._plant = replace(plant_of(trial or trial_of(bag)), trust=trust or bag.trust)
        names = laws if only is None else [only]
        self._laws = {name: laws[name] for name in names if name not in programs}
        self._built = {name: self._build(name) for name in self._laws}
        self._programs = dict(programs)
        self._pending = [a for a in plan_changes(bag) if a.controller in self._laws]
        self._first = dict(self._laws)  # before anybody tuned them
        self._estimator_starts = [
            (k, what)
            for k, what in _messages_by_tick(bag, EstimateStarted)
            if what.controller in self._laws
        ]
        self._duplicate_responses = _duplicate_responses(
            bag, [(k, w.controller) for k, w in self._estimator_starts if w.fresh]
        )
        recorded_laws = logged_laws(bag)  # settings of one law mean nothing to another
        self._setting_changes = [
            (key, what)
            for key, what in _messages_by_tick(bag, ControllerTuned)
            if (name := what.controller) in self._laws
            and name in recorded_laws
            and self._laws[name][0] == recorded_laws[name][0]
        ]

    @property
    def by_name(self) -> dict[str, ReplayedController]:
        """The controllers and programs by the names of the log."""
        return {**self._built, **self._programs}

    def previous_instances(self, key: Key) -> list[ReplayedController]:
        """Return those that answered this question and were started again before it was over."""
        return [self._built[name] for at, name in self._duplicate_responses if at == key]

    def until(self, key: Key) -> int:
        """Give the controllers the plans and settings that they had at the question `key`.

        Returns:
            number of controllers tuned since the previous call.
        """
        while self._estimator_starts and self._estimator_starts[0][0] <= key:
            self._restart(*self._estimator_starts.pop(0))
        while self._pending and self._pending[0].first <= key:
            change = self._pending.pop(0)
            controller = self._built[change.controller]
            controller.begin_epoch(change.first[0])
            controller.adopt(*change.told[-1])
        change_count = 0
        while self._setting_changes and self._setting_changes[0][0] <= key:
            what = self._setting_changes.pop(0)[1]
            name = what.controller
            law, values = self._laws[name]
            self._laws[name] = law, merged(values, what.settings)
            replacement = self._build(name)
            replacement.take_over(self._built[name])
            self._built[name] = replacement
            change_count += 1
        return change_count

    def _restart(self, key: Key, what: EstimateStarted) -> None:
        """Let an estimator begin in flight; that of a new process with all plans, untuned."""
        name = what.controller
        if what.fresh:
            its = [a for a in self._pending if a.controller == name and a.first == key]
            self._pending = [a for a in self._pending if a not in its]
            self._laws[name] = self._first[name]
            self._built[name] = self._build(name)
            for one in its[-1].told if its else ():
                self._built[name].adopt(*one)
        self._built[name].restart(key[0])

    def _build(self, name: str) -> Controller:
        law, values = self._laws[name]
        # wall time decides nothing here
        settings = {k: v for k, v in values.items() if law in CONTROLLERS or k != "time_limit"}
        try:
            return build_controller(
                name, law, settings, self._plant, f"{self._source}: controllers.{name}"
            )
        except BadInput as error:
            if not is_program(law):
                raise
            remedy = "give a controller that was a program of its own by --with COMMAND"
            if not isinstance(error, Untrusted):
                raise BadInput(f"{error}; {remedy}") from None
            place = f"{self._source}: controllers.{name}"
            words = f"{place}: refused to run {law}, which is not found here; {remedy}"
            raise Untrusted(f"{words}, and {allow_words(law)} if it is a class", law) from None


def is_program(law: str) -> bool:
    """Return whether a controller of a log was a program of its own: its law is no code here."""
    return law not in CONTROLLERS and ".py:" not in law and file_of(law) is None


def _messages_by_tick(bag: BagReader, kind: type[_Kind]) -> list[tuple[Key, _Kind]]:
    """Return events of this kind from controllers, with their ticks, in their order."""
    recorded = [
        ((event.epoch, event.tick), event.what)
        for event in bag.overview.events
        if isinstance(event.what, kind)
    ]
    return sorted(recorded, key=lambda pair: pair[0])


def logged_laws(bag: BagReader) -> dict[str, tuple[str, dict[str, Any]]]:
    """Return law and settings of every controller by name, those not in the trial too."""
    laws = {n: law_of(n, values or {}) for n, values in trial_of(bag).controllers.items()}
    for name, status in bag.overview.statuses.items():
        if name not in laws or laws[name][0] in CONTROLLERS:  # with its defaults of that day
            logged = logged_yaml(status.settings, f"{bag.path}: controllers.{name}")
            values = {k: v for k, v in logged.items() if k not in COMPUTED_KEYS}
            if status.law == OUTPUT_FEEDBACK.name:  # older logs: when it had no other one
                values.setdefault("observer", "steady")
            laws[name] = status.law, values
    # the last status holds the settings of the last tuning
    for _, what in reversed(_messages_by_tick(bag, ControllerTuned)):
        if what.controller in laws:
            laws[what.controller] = laws[what.controller][0], what.before
    return laws


def plan_changes(bag: BagReader) -> list[PlanChange]:
    """Return the controller, its plan and the first question answered with it, in that order.

    A recorder may discover a controller late, so every status gives the tick of its plan. A
    restarted one has no such tick: a plan that it took before its first question counts from
    there on, which is an event. Until it reports that plan, its predecessor's is assumed.

    Raises:
        BadInput: if a controller reports a plan that is not in the log.
    """
    changes = _PlanChanges(bag)
    for topic, kind, _, _, data in bag.messages(("/controller_status", "/events", "/plan")):
        message = decode(kind, data)
        if topic == "/plan":
            changes.take_plan(message)
        elif topic == "/events":
            changes.take_event(message)
        else:
            changes.take_status(message)
    for name in list(changes.begun):
        changes.begin(name)
    return sorted(changes.found, key=lambda change: change.first)


class _PlanChanges:
    """Follows plans, events and statuses of a log in their order.

    Attributes:
        found: the changes, in any order.
        begun: first questions of newcomers. The statuses that they published before may stand
            behind these in the log, as long as their predecessors counted as alive.
    """

    def __init__(self, bag: BagReader) -> None:
        self._source, self._path = str(bag.path), bag.path
        self._plan_by_hash = {
            p.hash: PlanMessage(*received_plan(p, self._source)) for p in bag.overview.plans
        }
        self._plan_messages: list[tuple[str, PlanMessage]] = []
        self._active_plan: dict[str, tuple[str, int]] = {}
        self._starts: dict[str, Key] = {}
        self._seen: dict[str, Key] = {}  # newest question
        self._instances: dict[str, set[int]] = {}  # processes of each name
        # that came in place of another one and has no question yet
        self._pending_instance: dict[str, int] = {}
        self._restart_sequence: dict[str, tuple[PlanMessage, ...]] = {}
        # plan of its predecessor, until it reports its own
        self._default_change: dict[str, PlanChange] = {}
        self.found: list[PlanChange] = []
        self.begun: dict[str, Key] = {}

    def take_plan(self, message: Any) -> None:
        """Take a plan that was published."""
        plan = self._plan_by_hash[message.hash].plan
        self._plan_messages.append((message.hash, PlanMessage(plan, in_flight(message))))

    def take_event(self, message: Any) -> None:
        """Take an event."""
        event = logged_event(message, self._source)
        if isinstance(event.what, EstimateStarted) and event.what.fresh:
            name = event.what.controller
            if name in self.begun:
                self.begin(name)
            self.begun[name] = self._starts[name] = event.epoch, event.tick

    def begin(self, name: str) -> None:
        """Add the plan with which a newcomer begins: all that it published before is known."""
        key = self.begun.pop(name)
        self._pending_instance.pop(name, None)
        if recorded := self._restart_sequence.pop(name, ()):
            self.found.append(PlanChange(name, key, recorded))
            return
        active, _ = self._active_plan.get(name, ("", 0))
        if recorded := _plan_sequence(self._plan_messages, active):
            self._default_change[name] = PlanChange(name, key, recorded)
            self.found.append(self._default_change[name])

    def take_status(self, status: Any) -> None:
        """Take a status of a controller."""
        name, requested = status.controller, status.plan_hash
        instance = getattr(status, "instance", 0)  # which older logs do not have
        at = int(status.epoch), int(status.last_tick)
        is_known = instance in self._instances.setdefault(name, {instance})
        if name in self.begun and (
            at >= self.begun[name] or (not is_known and name in self._pending_instance)
        ):
            self.begin(name)
        if not is_known:
            self._instances[name].add(instance)
            self._pending_instance[name] = instance
        before = self._seen.get(name, at)
        self._seen[name] = max(before, at)
        default = self._default_change.get(name)
        if default is not None and at >= default.first:
            del self._default_change[name]
            if not (requested or status.plan_number):  # a newcomer that has received no plan
                self.found.remove(default)
        if not requested:
            self._active_plan.pop(name, None)
        elif self._active_plan.get(name) != (requested, status.plan_number) or at < before:
            is_new = self._pending_instance.get(name) == instance or at < before
            self._take_plan_of(status, is_new)

    def _take_plan_of(self, status: Any, is_new: bool) -> None:
        """Take another plan than the last one of a controller.

        Args:
            status: that names it.
            is_new: it comes from a process that has not begun yet.
        """
        name, requested = status.controller, status.plan_hash
        if requested not in self._plan_by_hash:
            raise BadInput(
                f"{name} follows plan {requested[:12]}, which is not in the log", self._path
            )
        # no time is known before the first question: the status may come before the plan it names
        known = requested in {digest for digest, _ in self._plan_messages}
        coming = [] if known else [(requested, self._plan_by_hash[requested])]
        sequence = _plan_sequence([*self._plan_messages, *coming], requested) or (
            self._plan_by_hash[requested],
        )
        restart = is_new or status.plan_number <= self._active_plan.get(name, ("", 0))[1]
        self._active_plan[name] = requested, status.plan_number
        unused = status.plan_number and not (status.last_tick or status.plan_tick)
        # it may receive several plans by then
        if unused and (restart or name in self._restart_sequence):
            self._restart_sequence[name] = sequence
        if unused and restart:
            return
        # one that is built again, for another testbed or after a crash, reports that it began there
        first = _first_question(status)
        self._starts[name] = first = max(first, self._starts.get(name, first))
        self.found.append(PlanChange(name, first, sequence))


def _first_question(status: Any) -> Key:
    """Return the first question that was answered with the plan of a status."""
    if status.plan_number:
        return int(status.plan_epoch), int(status.plan_tick)
    # older log: the question after the newest one that its status reports
    first = int(status.epoch), int(status.last_tick) + 1
    # (0, 1) is also in the status of a controller before its first measurement
    return (0, 0) if first == (0, 1) else first


def _duplicate_responses(bag: BagReader, starts: list[tuple[Key, str]]) -> set[tuple[Key, str]]:
    """Return which of the first questions of newcomers their predecessors had answered."""
    if not any(tick > 0 for (_, tick), _ in starts):
        return set()
    found = bag.columns("/controller_state", {"epoch", "tick", "controller", "effort"})
    duplicates = set[tuple[Key, str]]()
    for (epoch, tick), name in starts:
        rows = (found["epoch"] == epoch) & (found["tick"] == tick) & (found["controller"] == name)
        efforts = found["effort"][rows]
        if len(efforts) > 1 and (efforts[0] != efforts[1]).any():  # one repeats its own
            duplicates.add(((epoch, tick), name))
    return duplicates


def _plan_sequence(
    plan_messages: Sequence[tuple[str, PlanMessage]], last: str
) -> tuple[PlanMessage, ...]:
    """Return the plans that a newcomer follows, from that of tick 0 to the one with hash `last`.

    Args:
        plan_messages: hashes and plans in their order; a new subscriber receives the latest.
        last: hash of the plan that it received.
    """
    sequence: tuple[PlanMessage, ...] = ()
    found = sequence
    for digest, recorded in plan_messages[-TOPICS[PLAN].depth :]:
        sequence = (*sequence, recorded) if recorded.of_flight else (recorded,)
        found = sequence if digest == last else found
    return found
