"""A logged run once more: bench and controllers, steered by the events of the log."""

from collections import defaultdict
from collections.abc import Mapping
from typing import Any

from flexslew_control.controllers.controller import Answer
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.replay.logged_controllers import (
    Key,
    LoggedControllers,
    ReplayedController,
    trial_of,
)
from flexslew_lab.run.tick import ask_controllers
from flexslew_lab.trial.trial import Trial, law_of
from flexslew_plant.bench.bench import Bench, SwitchRequest
from flexslew_plant.errors import BadInput, RunFault
from flexslew_plant.events import (
    AnswerMissing,
    BrakeActivated,
    BrakeRequested,
    ControllerTuned,
    Fact,
    FallbackActivated,
    FaultEndRequested,
    InjectionRequested,
    SwitchDropped,
    SwitchRejected,
    SwitchRequested,
    TargetRequested,
    kind_of,
)
from flexslew_plant.measurement import Measurement
from flexslew_plant.refusal import Cause, Refusal

_LATEST = 1 << 40  # tick of a run without an end
REQUESTS = (
    SwitchRequested,
    InjectionRequested,
    FaultEndRequested,
    BrakeRequested,
    TargetRequested,
)
_NOT_READY = Refusal("the log contains it", cause=Cause.NOT_READY)


class Resimulator:
    """The bench and its controllers, steered by the events of the log.

    Args:
        bag: to read.
        trial: trial of the bag, with changes.
        bench: bench of this trial.
        programs: that stand in for controllers of the log, by name.
    """

    def __init__(
        self, bag: BagReader, trial: Trial, bench: Bench, programs: Mapping[str, ReplayedController]
    ) -> None:
        recorded, self.bench = trial_of(bag), bench
        other = {
            name: law_of(name, values or {})
            for name, values in trial.controllers.items()
            if values != recorded.controllers.get(name)
        }
        self._controllers = LoggedControllers(
            bag, replacements=other, trial=trial, programs=programs
        )
        self._requests: dict[Key, list[Fact]] = defaultdict(list)
        self._late_requests: dict[Key, list[Fact]] = defaultdict(list)  # a step was refused
        self._missing_responses: set[Key] = set()
        self._rejected: set[Key] = set()
        self._last_query: Key | None = None  # the newest question of the log that is out
        self._dropped: dict[Key, set[str]] = defaultdict(set)  # not ready when they were due
        self._next_controllers: dict[Key, str] = {}  # controller that took over from a silent one
        self.replayed = dict.fromkeys(
            (kind_of(what) for what in (*REQUESTS, ControllerTuned, AnswerMissing)), 0
        )
        self._epochs = len(bag.overview.events)  # each reset is one of them
        for event in bag.overview.events:
            self._note((event.epoch, event.tick), event.what)

    def _note(self, key: Key, what: Fact) -> None:
        """Store the log's event of a tick."""
        match what:
            case AnswerMissing():
                self._missing_responses.add(key)
            case SwitchRejected():
                self._rejected.add(key)
            case SwitchDropped(controller=name, cause=Cause.NOT_READY):
                self._dropped[key].add(name)
            case FallbackActivated(to=successor) | BrakeActivated(to=successor):
                self._next_controllers[key] = successor
            case _ if isinstance(what, REQUESTS):
                requests = self._late_requests if key in self._rejected else self._requests
                requests[key].append(what)

    def truth(self, key: Key) -> dict[str, Any]:
        """Fly to this tick; return the state there."""
        bench = self.bench
        last = _LATEST if bench.last_tick is None else bench.last_tick
        if key[0] > self._epochs or key[1] > last:
            raise BadInput(
                f"the truth of tick {key[1]} of epoch {key[0]} is beyond the end of the trial"
            )
        while bench.epoch < key[0]:
            self._end_epoch()
        while (bench.epoch, bench.tick) < key:
            self._simulate_tick()
            bench.events.clear()
            bench.switch_results.clear()
        if bench.tick != key[1]:
            raise BadInput(f"the truth steps back to tick {key[1]} of epoch {key[0]}")
        self._last_query = key
        return bench.truth()._asdict()

    def _end_epoch(self) -> None:
        """Reset the bench; its last question was received, if it went out, and never answered."""
        question = self.bench.question
        key = question.epoch, question.tick
        self._begin(key)
        if key == self._last_query:
            for controller in self._controllers.by_name.values():
                controller.observe(question)
        self.bench.reset()

    def _begin(self, key: Key) -> None:
        """Let happen what was requested of the controllers and of the bench at this tick."""
        self.replayed[kind_of(ControllerTuned)] += self._controllers.until(key)
        for request in self._requests.pop(key, ()):
            self._apply_request(request)

    def _simulate_tick(self) -> None:
        bench, question = self.bench, self.bench.question
        key = question.epoch, question.tick
        previous = [
            controller.observe(question) for controller in self._controllers.previous_instances(key)
        ]
        self._begin(key)
        missing = key in self._missing_responses
        self.replayed[kind_of(AnswerMissing)] += missing
        was_refused = key in self._rejected  # the step of an answer, which did arrive

        def offer(answer: Answer | None, asked: Measurement) -> None:
            if answer is not None and (not missing or (was_refused and asked is question)):
                bench.offer(answer.command)

        for answer in previous:
            offer(answer, question)
        # all controllers that received it, even if no answer arrived
        ask_controllers(
            bench,
            question,
            self._controllers.by_name,
            lambda controller, asked: offer(controller.observe(asked), asked),
        )
        for request in self._late_requests.pop(key, ()):
            self._apply_request(request)
        not_ready = self._not_ready(key)
        for name in not_ready:
            bench.set_ready_status(name, _NOT_READY)
        bench.advance()
        for name in not_ready:
            bench.set_ready_status(name, None)
        if bench.failure:
            raise RunFault(bench.failure)

    def _not_ready(self, key: Key) -> set[str]:
        """Return the controllers not ready at the end of this tick, as its outcome shows."""
        not_ready = set(self._dropped.get((key[0], key[1] + 1), ()))
        if key in self._next_controllers:
            possible = {*self._controllers.by_name, *self.bench.settings.fallback}
            ready = {self._next_controllers[key], *self.bench.handover.due(key[1] + 1)}
            not_ready |= possible - ready
        return not_ready

    def _apply_request(self, what: Fact) -> None:
        """Let an operator ask again."""
        self.replayed[kind_of(what)] += 1
        match what:
            case SwitchRequested():
                self.bench.request_switch(
                    SwitchRequest(what.controller, what.tick, what.strict, what.max_effort_step)
                )
            case InjectionRequested():
                self.bench.inject(what.text, what.start)
            case TargetRequested():
                self.bench.retarget(what.text, what.start)
            case FaultEndRequested():
                self.bench.end_fault(what.number)
            case BrakeRequested():
                self.bench.brake(what.on)
