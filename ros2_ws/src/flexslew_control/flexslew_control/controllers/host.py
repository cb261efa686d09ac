"""A controller as its node has it: built when the testbed is known, tuned at a tick, ready or not.

The host holds everything that a node must decide but the graph: so it is tested without ROS, and a
log is flown again with the same object.
"""

import json
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from textwrap import shorten
from typing import Any, NamedTuple

from flexslew_control.controllers.controller import Answer, Controller
from flexslew_control.controllers.question_thread import QuestionThread
from flexslew_control.plan import Plan
from flexslew_control.plans.plan_file import plan_hash
from flexslew_plant.bench.due_ticks import past, too_late
from flexslew_plant.errors import BadInput
from flexslew_plant.events import (
    NO_NAME,
    ControllerTuned,
    Event,
    PlanRejected,
    UnexpectedMessage,
    event_of,
)
from flexslew_plant.graph import topics
from flexslew_plant.measurement import Measurement
from flexslew_plant.refusal import NO_TESTBED, Cause, Refusal, Reply
from flexslew_plant.yaml_data import MAX_LENGTH

_MAX_LENGTH = 200  # characters of a value in an answer

Build = Callable[[dict[str, Any]], Controller]  # from the settings of the law


class _PendingChange(NamedTuple):
    tick: int
    changes: dict[str, Any]
    values: dict[str, Any]
    controller: Controller
    who: str


class ControllerHost:
    """One controller of the bench.

    Args:
        name: unique on the bench.
        values: settings of its law as plain data.
    """

    def __init__(self, name: str, values: dict[str, Any]) -> None:
        self.name, self.values = name, values
        self.controller: Controller | None = None
        self.plan: Plan | None = None
        self._first: Plan | None = None  # that of tick 0
        self._received: list[tuple[Plan, bool]] = []  # received before the first testbed; see adopt
        self.epoch = 0  # of the last question
        self.run_ends = 0  # at this tick; 0: only when it is stopped
        self.plan_count, self.plan_hash = 0, ""  # of the plan that is followed
        self.plan_from = 0, 0  # epoch and tick of the first question answered with it
        self.events: deque[Event] = deque()
        self._build: Build | None = None
        self._testbed_error = NO_TESTBED
        self._appendages = 0  # of the testbed
        self._plan_rejection: Refusal | None = None
        self._pending_changes: list[_PendingChange] = []
        self._thread = QuestionThread()
        self._warned = False  # a stray message was reported

    @property
    def reason(self) -> Refusal | None:
        """Why it could not take charge now; None when it could."""
        if self.controller is None:
            return self._testbed_error
        return self._plan_rejection or self.controller.reason

    @property
    def last_tick(self) -> int:
        """The last tick that the controller has seen; 0: none."""
        return max(self.controller.last_tick, 0) if self.controller else 0

    @property
    def due(self) -> tuple[tuple[int, dict[str, Any]], ...]:
        """Changes of settings that were granted and take effect at a tick to come."""
        return tuple((change.tick, change.changes) for change in self._pending_changes)

    @property
    def newest(self) -> tuple[int, int] | None:
        """Epoch and tick of the last question that counted; None: there was none."""
        return self._thread.newest

    def notify(self, build: Build, appendages: int = 0) -> None:
        """Build the controller for a testbed, in place of any before.

        Of the plans that it followed there it keeps that of tick 0, as after a reset.

        Args:
            build: makes a controller for this testbed.
            appendages: how many it has.

        Raises:
            BadInput: the settings do not fit the first testbed announced.
        """
        first, self._build = self._build is None, build
        self._pending_changes, self._appendages, self.epoch = [], appendages, 0
        self._thread = QuestionThread()
        try:
            self.controller = build(self.values)
        except BadInput as error:
            if first:
                raise
            words = f"it does not fit this testbed: {error}"
            self.controller, self._testbed_error = None, Refusal(words, cause=Cause.NO_TESTBED)
            return
        self.controller.warm(appendages)
        if not first:
            self._received = [] if self._first is None else [(self._first, False)]
            self.plan, self.plan_hash, self._plan_rejection = self._first, "", None
        known = self._received
        for plan, of_flight in known:
            self._activate_plan(plan, plan_hash(plan), of_flight)
        self._received = []

    def begin_epoch(self, epoch: int) -> None:
        """Know that the bench was reset, whether a question of the new epoch has come or not.

        What was to be tuned with the next question is tuned with the first one; what was due later
        is forgotten.
        """
        self.epoch, self._plan_rejection = epoch, None
        if self.controller is None:
            return
        pending = [
            each for each in self._pending_changes if each.tick <= self.controller.last_tick + 1
        ]
        self._pending_changes = [each._replace(tick=0) for each in pending]
        before = self.controller.plan
        self.controller.begin_epoch(epoch)
        plan = self.controller.plan
        if plan is not before:  # that of the start again, or none
            self.plan, self.plan_from = plan, (epoch, 0)
            self.plan_hash = plan_hash(plan) if plan is not None else ""
            self.plan_count += plan is not None

    def adopt(
        self, plan: Plan, of_flight: bool = False, epoch: int | None = None
    ) -> Refusal | None:
        """Follow a plan as soon as there is a testbed; return why not, or None.

        A plan that it follows already, or did in this flight, changes nothing: planners publish a
        plan again after a reset, after their own restart, and when a later one was refused.

        Args:
            plan: plan to be followed.
            of_flight: whether it was published in flight, see Controller.adopt.
            epoch: number of resets before it was published; None: as many as this controller has
                received. A plan of a flight that is over may arrive after the reset.
        """
        if of_flight and epoch is not None and (late := self._begin_flight(epoch)) is not None:
            return late
        digest, current = plan_hash(plan), self.controller and self.controller.plan
        if current and digest == self.plan_hash and self._plan_rejection is None:
            return None
        if self.controller and any(digest == plan_hash(known) for known in self.controller.started):
            return None
        self.plan = plan
        if not of_flight:
            self._first = plan
        if self._build is None:
            self._received.append((plan, of_flight))
        rejection = self._activate_plan(plan, digest, of_flight)
        if rejection is None:
            self.plan_count += 1
        return rejection

    def _begin_flight(self, epoch: int) -> Refusal | None:
        """Begin the epoch of a plan published in flight; return why not, if that one is over."""
        if epoch < self.epoch:
            words = (
                f"published in epoch {epoch}, before a reset; the bench is in epoch {self.epoch}"
            )
            return Refusal(f"the plan was {words}", cause=Cause.BENCH_RESET)
        if epoch > self.epoch:
            self.begin_epoch(epoch)
        elif self.controller is not None:
            self.controller.begin_epoch(epoch)  # a reset that comes before any question drops it
        return None

    def _activate_plan(self, plan: Plan, digest: str, of_flight: bool) -> Refusal | None:
        first = self.epoch, (self.controller.last_tick if self.controller else -1) + 1
        self._plan_rejection = None
        if self.controller is not None:
            self._plan_rejection = self.controller.adopt(plan, of_flight)
            if self.controller.is_starting:
                self.controller.warm(self._appendages)  # on the plan that it will follow
        if self._plan_rejection is None:
            self.plan_hash, self.plan_from = digest, first
        return self._plan_rejection

    def plan_refused(self, digest: str, why: Refusal) -> Event:
        """Return the event of a plan with this hash that was refused."""
        tick, period = self.last_tick, self.controller.period if self.controller else 0.0
        what = PlanRejected(digest, controller=self.name, reason=str(why))
        return event_of(what, tick, tick * period, self.epoch, self.name)

    def observe(self, question: Measurement) -> Answer | None:
        """Return the answer if the question names this controller; see Controller.observe."""
        if self.controller is None:
            return None
        if question.mismatch(len(self.controller.joint_names), self._appendages):
            return None  # of a testbed still to be announced, or from a stray sender
        if not self._thread.take((question.epoch, question.tick)):
            self.ignored(
                topics.MEASUREMENT,
                f"tick {question.tick} of epoch {question.epoch}, the bench is at tick "
                f"{self.last_tick} of epoch {self.epoch}",
            )
            return None
        if self._thread.resumed:
            self.controller.restart(question.epoch)
        if question.epoch != self.epoch:
            self.begin_epoch(question.epoch)
        while self._pending_changes and self._pending_changes[0].tick <= question.tick:
            self._take(self._pending_changes.pop(0), question)
        answer = self.controller.observe(question)
        while self.controller.events:
            self.events.append(self.controller.events.popleft())
        return answer

    def ignored(self, topic: str, what: str) -> None:
        """Report once that a message is not one of the plant of this bench."""
        if not self._warned:
            self._warned = True
            period = self.controller.period if self.controller else 0.0
            tick, fact = self.last_tick, UnexpectedMessage(topic, self.name, what)
            self.events.append(event_of(fact, tick, tick * period, self.epoch, self.name))

    def tune(
        self,
        changes: Mapping[str, Any],
        tick: int = 0,
        who: str = "",
        executor: Callable[
            [Callable[[], "list[_PendingChange]"]], "list[_PendingChange]"
        ] = lambda make: make(),
    ) -> Reply:
        """Design the controller again with some settings changed, for a tick to come.

        Args:
            changes: changed settings, nested as they are.
            tick: first one with the new settings; 0, or one that is over when the design is made:
                the next.
            who: name of the client that requests it.
            executor: makes the design while questions are answered.
        """
        if self._build is None or self.controller is None:
            why = Refusal(f"{self.name} cannot be tuned: {self.reason}", cause=Cause.NO_TESTBED)
            return Reply(refused=why)
        seen, period = self.controller.last_tick, self.controller.period
        if never := past(tick, seen, period) or too_late(tick, self.run_ends or None):
            return Reply(refused=never)
        tick = max(tick, seen + 1)
        if (invalid := self._not_settings(changes)) is not None:
            return Reply(tick=tick, refused=invalid)
        build, epoch, current = self._build, self.epoch, seen + 1
        try:
            made = executor(partial(self._design_changes, build, tick, dict(changes), who))
        except BadInput as error:
            return Reply(tick=tick, refused=error.refusal)
        if self._build is not build:
            why = Refusal("another testbed was announced meanwhile", cause=Cause.NO_TESTBED)
            return Reply(tick=tick, refused=why)
        now = self.controller.last_tick + 1
        if self.epoch != epoch:  # as begin_epoch has done with those before
            if tick > current:
                why = Refusal("the bench was reset meanwhile", cause=Cause.BENCH_RESET)
                return Reply(tick=tick, refused=why)
            made, tick = [each._replace(tick=now) for each in made[:1]], now
        previous = [change for change in self._pending_changes if change.tick <= tick]
        self._pending_changes = previous + [
            each._replace(tick=max(each.tick, now)) for each in made
        ]
        tick = max(tick, now)
        words = ", ".join(
            f"{key}: {shorten(str(value), _MAX_LENGTH, placeholder=' ...')}"
            for key, value in changes.items()
        )
        return Reply(f"{words} from tick {tick} on", tick=tick)

    def _not_settings(self, changes: Mapping[str, Any]) -> Refusal | None:
        """Return why no log could hold these changes as those of settings, or None."""
        if not changes:
            return Refusal("nothing changes; give at least one setting")
        try:
            size = len(json.dumps([changes, self.values], allow_nan=False))
        except (TypeError, ValueError):
            words = "not plain data or not a finite number: the log could not hold it"
            return Refusal(words, _invalid_key(changes))
        if size > MAX_LENGTH:
            return Refusal(f"settings of {size:,} characters; a log holds at most {MAX_LENGTH:,}")
        return None

    def _design_changes(
        self, build: Build, tick: int, changes: dict[str, Any], who: str
    ) -> list[_PendingChange]:
        """Return a new tuning, then the later ones, designed again on top of it."""
        before = [each for each in self._pending_changes if each.tick <= tick]
        after = [(t.tick, t.changes, t.who) for t in self._pending_changes if t.tick > tick]
        values, made = before[-1].values if before else self.values, []
        for at, what, client in [(tick, changes, who), *after]:
            values = merged(values, what)
            controller = build(values)
            controller.warm(self._appendages)
            made.append(_PendingChange(at, what, values, controller, client))
        return made

    def _take(self, change: _PendingChange, question: Measurement) -> None:
        assert self.controller is not None
        change.controller.take_over(self.controller)
        before, self.controller, self.values = self.values, change.controller, change.values
        what = ControllerTuned(self.name, change.changes, before, change.who or NO_NAME)
        self.events.append(event_of(what, question.tick, question.time, question.epoch, self.name))


def _invalid_key(values: Any) -> str:
    """Return the path of the first value in nested settings that JSON cannot hold."""
    items: Iterable[tuple[Any, Any]] = ()
    if isinstance(values, Mapping):
        items = values.items()
    elif isinstance(values, list | tuple):
        items = enumerate(values)
    for key, value in items:
        try:
            json.dumps(value, allow_nan=False)
        except (TypeError, ValueError):
            return ".".join(filter(None, (str(key), _invalid_key(value))))
    return ""


def merged(values: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested settings with some of them changed."""
    result = dict(values)
    for key, value in changes.items():
        before = result.get(key)
        nested = isinstance(value, Mapping) and isinstance(before, Mapping)
        result[key] = merged(before, value) if nested else value  # type: ignore[arg-type]
    return result
