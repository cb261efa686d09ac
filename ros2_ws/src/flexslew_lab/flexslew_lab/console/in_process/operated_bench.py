"""A bench with its controllers in one process, paced, that takes an operator's requests."""

import sys
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from functools import partial
from threading import Event as Signal
from time import monotonic
from typing import Any

from flexslew_control.controllers import build_controller, settings_text, with_file
from flexslew_control.controllers.controller import Controller
from flexslew_control.controllers.host import ControllerHost
from flexslew_control.message_fields import status_fields
from flexslew_lab.console.in_process.plans import LocalPlans
from flexslew_lab.console.link import RequestResult, Then
from flexslew_lab.console.view import Now
from flexslew_lab.log.recording.bag_observer import BagObserver
from flexslew_lab.run.run_trial import PreparedTrial
from flexslew_lab.trial.trial import law_of, plant_of
from flexslew_plant.bench.bench import SwitchRequest, Truth
from flexslew_plant.bench.due_ticks import requested_tick
from flexslew_plant.bench.operation.requests import Requests
from flexslew_plant.bench.operation.run_state import FINISHED
from flexslew_plant.bench.operation.session import Session
from flexslew_plant.errors import BadInput
from flexslew_plant.events import Event
from flexslew_plant.graph import topics
from flexslew_plant.measurement import EffortCommand, Measurement
from flexslew_plant.refusal import Refusal, Reply
from flexslew_plant.yaml_data import load_yaml

_AT_ONCE = 0.005  # ticks flown before requests are taken again [wall s]
_LONGEST_WAIT = 0.02  # between two looks for requests [wall s]
_SHARE = 2e-4  # for which one of two threads works before the other one may [wall s]
_TUNE = topics.TUNE.removeprefix("~")  # behind the name of a controller


class OperatedBench:
    """Flies a prepared trial as an operator requests.

    All methods but `submit` are of the thread that calls `fly`.

    Args:
        prepared: trial with its bench at tick 0; its controllers are taken over.
        observer: writes the log.
        behind: returns whether the bench must wait for who displays it.

    Attributes:
        now: state of the bench; replaced as a whole.
        plans: makes and releases plans.
    """

    def __init__(
        self, prepared: PreparedTrial, observer: BagObserver, behind: Callable[[], bool]
    ) -> None:
        trial, self._bench, controllers, plan = prepared
        self._observer, self._behind = observer, behind
        self._requests: deque[Callable[[], None]] = deque()
        self._wake = Signal()
        self._epoch, self._next_refresh = 0, 0.0  # [wall s]
        self._laws: dict[str, str] = {}
        self._statuses: dict[str, tuple[Any, ...]] = {}  # as written last, by controller
        self._switches: list[tuple[SwitchRequest, float, Then]] = []  # with a deadline [wall s]
        running = trial.rate_factor, trial.answer_timeout, False
        self.session = Session(self._bench, (*controllers,), *running, list, list)
        self._by_name = Requests(self.session, lambda: self._hosts)
        self._by_name.actions[topics.START] = self._start
        plant = plant_of(trial)
        self._hosts: dict[str, ControllerHost] = {}
        for name, controller in controllers.items():
            law, values = law_of(name, trial.controllers[name] or {})
            values = with_file(law, values, f"controllers.{name}", trial.trust)
            first = [controller]

            def build(
                values: dict[str, Any],
                first: list[Controller] = first,
                name: str = name,
                law: str = law,
            ) -> Controller:
                built = partial(build_controller, name, law, values, plant, f"controllers.{name}")
                return first.pop() if first else built()

            host = ControllerHost(name, values)
            host.notify(build, len(self._bench.appendages.names))
            host.run_ends = self._bench.last_tick or 0
            self._hosts[name], self._laws[name] = host, law
        testbed = observer.describe(trial, self._bench)
        self.plans = LocalPlans(
            self.session, list(self._hosts.values()), observer, self._event, testbed, trial.trust
        )
        if plan is not None:
            self.plans.release.begin_with(plan)
        self._announce()
        self.now = self._state()

    def submit(self, act: Callable[[], None]) -> None:
        """Let something be done between two ticks; may be called by any thread."""
        self._requests.append(act)
        self._wake.set()

    def fly(self, progress: Callable[[int], None]) -> None:
        """Fly until the run is over, or until it is interrupted.

        Args:
            progress: called with the tick.

        Raises:
            KeyboardInterrupt: after the log has a note of it.
        """
        interval = sys.getswitchinterval()
        sys.setswitchinterval(_SHARE)
        try:
            while self.session.run.state != FINISHED:
                while self._requests:
                    self._requests.popleft()()
                pause = _LONGEST_WAIT if self._behind() else self._poll()
                progress(self._bench.tick)
                if pause > 0.0:
                    self._wake.wait(min(pause, _LONGEST_WAIT))
                    self._wake.clear()
        except KeyboardInterrupt:
            self.session.interrupted()
            raise
        finally:
            sys.setswitchinterval(interval)
            self._bench.close()
            self._send()
            self.plans.close()
            self.now = self._state()
            for _, _, then in self._switches:
                then(RequestResult(False, "the run is over"))

    def serve(self, service: str, values: dict[str, Any], then: Then) -> None:
        """Do what an operator requests, and answer.

        Args:
            service: name of the ROS service that requests the same.
            values: fields of its request; a simulated time `at` in seconds.
            then: takes the answer.
        """
        acts = self._by_name.services | {topics.DECIDE_PLAN: self.plans.decide}
        if service == topics.SWITCH_CONTROLLER:
            self._switch(then=then, **values)
            return
        name, tick = service.removesuffix(_TUNE), self._bench.tick
        try:
            if service in acts:
                reply = acts[service](**values)
            elif name in self._hosts:
                reply = self._tune(self._hosts[name], **values)
            else:
                reply = Reply(refused=Refusal(f"the bench has no service {service}"))
        except BadInput as error:
            reply = Reply(refused=error.refusal)
        then(RequestResult(reply.ok, reply.message, reply.tick or tick))

    def _start(self, who: str) -> Reply:
        reply = self.session.start(who)
        self._poll()
        return self._by_name.with_missing(reply)

    def _switch(
        self, then: Then, controller: str, at: float, strict: bool, max_effort_step: float,
        timeout: float, who: str,
    ) -> None:  # fmt: skip
        """Answer when the switch has happened, or cannot any more."""
        now = monotonic()
        request, refusal = self.session.requested_switch(
            controller, at, strict, max_effort_step, who, now
        )
        if refusal is not None:
            then(RequestResult(False, str(refusal), max(0, request.tick)))
        else:
            self._switches.append((request, now + timeout, then))

    def _answer_switches(self, now: float) -> None:
        results = self._bench.handover.results
        while results:
            result = results.popleft()
            for pending in [p for p in self._switches if p[0] == result.request]:
                self._switches.remove(pending)
                pending[2](RequestResult(result.ok, result.message, result.tick))
        for pending in [p for p in self._switches if now >= p[1]]:
            self._switches.remove(pending)
            request, _, then = pending
            words = f"switch to {request.controller} is due at tick {request.tick}"
            then(RequestResult(True, f"{words} and stays in the queue", request.tick))

    def _tune(self, host: ControllerHost, settings: str, at: float, who: str) -> Reply:
        changes = load_yaml(settings, "settings") or {}
        if not isinstance(changes, dict):
            words = "give YAML keys, for example {kp: [500.0, 500.0]}"
            return Reply(refused=Refusal(words, "settings", changes))
        changes = with_file(self._laws[host.name], changes, "settings")
        tick = requested_tick(at, self._bench.settings.period, host.last_tick)
        return host.tune(changes, tick, who, self._make_in_thread)

    def _make_in_thread(self, make: Callable[[], Any]) -> Any:
        """Return what is made in a thread, while the bench goes on."""
        with ThreadPoolExecutor(1) as pool:
            made = pool.submit(make)
            while not made.done():
                wait([made], min(self._poll(), _LONGEST_WAIT))
        return made.result()

    def _poll(self) -> float:
        """Fly for a moment; return after how many wall seconds to be called again."""
        until = monotonic() + _AT_ONCE
        while True:
            now = monotonic()
            pause = self.session.poll(now)
            self._send()
            if self.session.outgoing:
                pause = 0.0
            if pause > 0.0 or now >= until or self.session.run.state == FINISHED:
                break
        if self._bench.epoch != self._epoch:
            self._epoch = self._bench.epoch
            for host in self._hosts.values():
                host.begin_epoch(self._epoch)
            self.plans.release.restart()
        if now >= self._next_refresh:
            self._next_refresh = now + _LONGEST_WAIT
            self._refresh(now)
        return pause

    def _refresh(self, now: float) -> None:
        """Do what is not due at every tick."""
        self._answer_switches(now)
        self.plans.poll()
        self._announce()
        self.now = self._state()

    def _send(self) -> None:
        """Write the records that the session has put out, then answer its question."""
        question = None
        while self.session.outgoing:
            record = self.session.outgoing.popleft()
            if isinstance(record, Measurement):
                question = record
                self._observer.question(record)
            elif isinstance(record, Truth):
                self._observer.truth(record)
            else:
                self._event(record)
        if question is not None:
            for command in self._commands(question):
                self.session.take(command, monotonic())

    def _commands(self, question: Measurement) -> list[EffortCommand]:
        """Return the answers of the controllers to a question."""
        found = []
        for host in self._hosts.values():
            answer = host.observe(question)
            while host.events:
                self._event(host.events.popleft())
            reason = host.reason
            if self._statuses[host.name][0] != reason:
                self._announce()
            self._bench.set_ready_status(host.name, reason)
            if answer is not None:
                self._observer.answer(answer)
                found.append(answer.command)
        return found

    def _event(self, event: Event) -> None:
        self._observer.event(event)
        self.plans.release.laws.take_event(event.what, event.tick, event.epoch)

    def _announce(self) -> None:
        """Write the status of each controller that has changed."""
        for host in self._hosts.values():
            state = (
                host.reason, host.plan_hash, host.plan_count, host.plan_from, host.due,
                id(host.controller),
            )  # fmt: skip
            if self._statuses.get(host.name) != state:
                self._statuses[host.name] = state
                self._report(host)

    def _report(self, host: ControllerHost) -> None:
        """Write the status of a controller; session and plans take it too."""
        reason, law = host.reason, self._laws[host.name]
        assert host.controller is not None
        settings = settings_text(host.controller, law, host.values, host.due)
        fields = status_fields(host, law, reason, settings)
        self.session.receive(host.name, reason is None, str(reason or ""))
        self.plans.release.laws.take_status(self._observer.status(fields))

    def _state(self) -> Now:
        session, bench = self.session, self._bench
        faults = tuple((fault.number, fault.words) for fault in bench.active_faults())
        return Now(
            session.run.state, tuple(session.waiting_for), bench.tick, bench.last_tick or 0,
            bench.epoch, session.tick_timer.rate_factor, session.run.wall_time(monotonic()),
            bench.drive.active, bench.handover.latched, bench.drive.missed, faults,
        )  # fmt: skip
