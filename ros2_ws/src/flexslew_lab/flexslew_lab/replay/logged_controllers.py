"""The controllers of a log, built again, and the plans that they followed from which tick on."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

from flexslew_control.controllers import (
    CONTROLLERS,
    DERIVED,
    OUTPUT_FEEDBACK,
    build_controller,
)
from flexslew_control.controllers.controller import Controller
from flexslew_control.controllers.host import merged
from flexslew_control.message_fields import in_flight, published_plan
from flexslew_control.plan import Plan
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.messages.cdr import decode
from flexslew_lab.log.messages.logged_event import logged_event
from flexslew_lab.log.messages.logged_text import logged_yaml
from flexslew_lab.trial.overrides import overridden
from flexslew_lab.trial.trial import Trial, law_of, plant_of, trial_of_values
from flexslew_plant.errors import BadInput
from flexslew_plant.events import ControllerTuned, EstimateBegan
from flexslew_plant.graph.topics import PLAN, TOPICS
from flexslew_plant.own_code import Trust

Key = tuple[int, int]  # epoch and tick
_Kind = TypeVar("_Kind", ControllerTuned, EstimateBegan)


class Told(NamedTuple):
    """A plan as it was published."""

    plan: Plan
    of_flight: bool  # in flight: a reset drops it


class Adoption(NamedTuple):
    """A controller took a plan."""

    controller: str
    first: Key  # question that it answered with this plan
    told: tuple[Told, ...]  # the plan, after those before it that a newcomer also received


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
        values = overridden(values, dict(changes))
    return trial_of_values(values, source, bag.trust)


class LoggedControllers:
    """Controllers as a log names them, each at its state before tick 0.

    Args:
        bag: source of the controllers.
        only: name of the only controller needed; None: all of the trial and of the log.
        replaced: laws and settings by name that replace those of the log.
        trial: trial that replaces the log's.
        trust: laws that may be loaded; None: those that the log may load.

    Raises:
        BadInput: if the log lacks data for it, or a law cannot be built.
    """

    def __init__(
        self,
        bag: BagReader,
        only: str | None = None,
        replaced: Mapping[str, tuple[str, dict[str, Any]]] | None = None,
        trial: Trial | None = None,
        trust: Trust | None = None,
    ) -> None:
        overview = bag.overview
        testbed = overview.testbed
        if testbed is None:
            raise BadInput("does not name its testbed (no /testbed)", bag.path)
        laws = logged_laws(bag) | dict(replaced or {})
        self._source = str(bag.path)
        self._plant = replace(plant_of(trial or trial_of(bag)), trust=trust or bag.trust)
        self._laws = laws if only is None else {only: laws[only]}
        self.by_name = {name: self._built(name) for name in self._laws}
        self._due = [a for a in adoptions(bag) if a.controller in self.by_name]
        self._first = dict(self._laws)  # before anybody tuned them
        self._begun = [
            (k, what)
            for k, what in _messages_by_tick(bag, EstimateBegan)
            if what.controller in self._laws
        ]
        self._dying = _answered_twice(bag, [(k, w.controller) for k, w in self._begun if w.fresh])
        flown = logged_laws(bag)  # settings of one law mean nothing to another
        self._tunings = [
            (key, what)
            for key, what in _messages_by_tick(bag, ControllerTuned)
            if (name := what.controller) in self._laws
            and name in flown
            and self._laws[name][0] == flown[name][0]
        ]

    def dying(self, key: Key) -> list[Controller]:
        """Return those that answered this question and were started again before it was over."""
        return [self.by_name[name] for at, name in self._dying if at == key]

    def until(self, key: Key) -> int:
        """Give the controllers the plans and settings that they had at the question `key`.

        Returns:
            number of controllers tuned since the previous call.
        """
        while self._begun and self._begun[0][0] <= key:
            self._begin_anew(*self._begun.pop(0))
        while self._due and self._due[0].first <= key:
            adoption = self._due.pop(0)
            controller = self.by_name[adoption.controller]
            controller.begin_epoch(adoption.first[0])
            controller.adopt(*adoption.told[-1])
        tuned = 0
        while self._tunings and self._tunings[0][0] <= key:
            what = self._tunings.pop(0)[1]
            name = what.controller
            law, values = self._laws[name]
            self._laws[name] = law, merged(values, what.settings)
            successor = self._built(name)
            successor.take_over(self.by_name[name])
            self.by_name[name] = successor
            tuned += 1
        return tuned

    def _begin_anew(self, key: Key, what: EstimateBegan) -> None:
        """Let an estimator begin in flight; that of a new process with all plans, untuned."""
        name = what.controller
        if what.fresh:
            its = [a for a in self._due if a.controller == name and a.first == key]
            self._due = [a for a in self._due if a not in its]
            self._laws[name] = self._first[name]
            self.by_name[name] = self._built(name)
            for one in its[-1].told if its else ():
                self.by_name[name].adopt(*one)
        self.by_name[name].begin_anew(key[0])

    def _built(self, name: str) -> Controller:
        law, values = self._laws[name]
        # wall time decides nothing here
        own = {k: v for k, v in values.items() if law in CONTROLLERS or k != "time_limit"}
        return build_controller(
            name,
            law,
            own,
            self._plant,
            f"{self._source}: controllers.{name}",
        )


def _messages_by_tick(bag: BagReader, kind: type[_Kind]) -> list[tuple[Key, _Kind]]:
    """Return events of this kind from controllers, with their ticks, in their order."""
    told = [
        ((event.epoch, event.tick), event.what)
        for event in bag.overview.events
        if isinstance(event.what, kind)
    ]
    return sorted(told, key=lambda pair: pair[0])


def logged_laws(bag: BagReader) -> dict[str, tuple[str, dict[str, Any]]]:
    """Return law and settings of every controller by name, those not in the trial too."""
    laws = {n: law_of(n, values or {}) for n, values in trial_of(bag).controllers.items()}
    for name, status in bag.overview.statuses.items():
        if name not in laws or laws[name][0] in CONTROLLERS:  # with its defaults of that day
            logged = logged_yaml(status.settings, f"{bag.path}: controllers.{name}")
            values = {k: v for k, v in logged.items() if k not in DERIVED}
            if status.law == OUTPUT_FEEDBACK.name:  # older logs: when it had no other one
                values.setdefault("observer", "steady")
            laws[name] = status.law, values
    # the last status holds the settings of the last tuning
    for _, what in reversed(_messages_by_tick(bag, ControllerTuned)):
        if what.controller in laws:
            laws[what.controller] = laws[what.controller][0], what.before
    return laws


def adoptions(bag: BagReader) -> list[Adoption]:
    """Return the controller, its plan and the first question answered with it, in that order.

    A recorder may discover a controller late, so every status gives the tick of its plan. A
    restarted one has no such tick: a plan that it took before its first question counts from
    there on, which is an event. Until it reports that plan, its predecessor's is assumed.

    Raises:
        BadInput: if a controller reports a plan that is not in the log.
    """
    source = str(bag.path)
    plans = {p.hash: Told(*published_plan(p, source)) for p in bag.overview.plans}
    published: list[tuple[str, Told]] = []
    following: dict[str, tuple[str, int]] = {}
    begun: dict[str, Key] = {}
    seen: dict[str, Key] = {}  # newest question
    heard_of: dict[str, set[int]] = {}  # processes of each name
    unasked: dict[str, int] = {}  # that came in place of another one and has no question yet
    started_again: dict[str, tuple[Told, ...]] = {}
    assumed: dict[str, Adoption] = {}  # plan of its predecessor, until it reports its own
    found = []
    for topic, kind, _, _, data in bag.messages(("/controller_status", "/events", "/plan")):
        status = decode(kind, data)
        if topic == "/plan":
            published.append((status.hash, Told(plans[status.hash].plan, in_flight(status))))
            continue
        if topic == "/events":
            event = logged_event(status, source)
            what, key = event.what, (event.epoch, event.tick)
            if isinstance(what, EstimateBegan) and what.fresh:
                name = what.controller
                begun[name] = key
                unasked.pop(name, None)
                if told := started_again.pop(name, ()):
                    found.append(Adoption(name, key, told))
                elif told := _course(published, following.get(name, ("", 0))[0]):
                    assumed[name] = Adoption(name, key, told)
                    found.append(assumed[name])
            continue
        name, requested = status.controller, status.plan_hash
        instance = getattr(status, "instance", 0)  # which older logs do not have
        if instance not in heard_of.setdefault(name, {instance}):
            heard_of[name].add(instance)
            unasked[name] = instance
        at = int(status.epoch), int(status.last_tick)
        before = seen.get(name, at)
        seen[name] = max(before, at)
        if name in assumed and at >= assumed[name].first:
            _settle(status, assumed.pop(name), found)
        if not requested:
            following.pop(name, None)
            continue
        if following.get(name) == (requested, status.plan_number) and at >= before:
            continue
        if requested not in plans:
            raise BadInput(
                f"{name} follows plan {requested[:12]}, which is not in the log", bag.path
            )
        # no time is known before the first question: the status may come before the plan it names
        known = requested in {digest for digest, _ in published}
        coming = [] if known else [(requested, plans[requested])]
        course = _course([*published, *coming], requested) or (plans[requested],)
        came = unasked.get(name) == instance or at < before
        anew = came or status.plan_number <= following.get(name, ("", 0))[1]
        following[name] = requested, status.plan_number
        not_asked = status.plan_number and not (status.last_tick or status.plan_tick)
        if not_asked and (anew or name in started_again):  # it may receive several plans by then
            started_again[name] = course
        if not_asked and anew:
            continue
        first = _first_question(status)
        # one that is built again, for another testbed or after a crash, reports that it began there
        begun[name] = first = max(first, begun.get(name, first))
        found.append(Adoption(name, first, course))
    return sorted(found, key=lambda adoption: adoption.first)


def _first_question(status: Any) -> Key:
    """Return the first question that was answered with the plan of a status."""
    if status.plan_number:
        return int(status.plan_epoch), int(status.plan_tick)
    # older log: the question after the newest one that its status reports
    first = int(status.epoch), int(status.last_tick) + 1
    # (0, 1) is also in the status of a controller before its first measurement
    return (0, 0) if first == (0, 1) else first


def _settle(status: Any, assumed: Adoption, found: list[Adoption]) -> None:
    """Drop the assumed plan of a newcomer that reports that it has received no plan."""
    if not (status.plan_hash or status.plan_number):
        found.remove(assumed)


def _answered_twice(bag: BagReader, begun: list[tuple[Key, str]]) -> set[tuple[Key, str]]:
    """Return which of the first questions of newcomers their predecessors had answered."""
    if not any(tick > 0 for (_, tick), _ in begun):
        return set()
    found = bag.columns("/controller_state", {"epoch", "tick", "controller", "effort"})
    twice = set[tuple[Key, str]]()
    for (epoch, tick), name in begun:
        rows = (found["epoch"] == epoch) & (found["tick"] == tick) & (found["controller"] == name)
        answers = found["effort"][rows]
        if len(answers) > 1 and (answers[0] != answers[1]).any():  # one repeats its own
            twice.add(((epoch, tick), name))
    return twice


def _course(published: Sequence[tuple[str, Told]], last: str) -> tuple[Told, ...]:
    """Return the plans that a newcomer follows, from that of tick 0 to the one with hash `last`.

    Args:
        published: hashes and plans in their order; a new subscriber receives the latest.
        last: hash of the plan that it received.
    """
    course: tuple[Told, ...] = ()
    found = course
    for digest, told in published[-TOPICS[PLAN].depth :]:
        course = (*course, told) if told.of_flight else (told,)
        found = course if digest == last else found
    return found
