"""A bench and its controllers as over ROS, without it: all that passes between them is bytes."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from flexslew_control.controllers import build_controller
from flexslew_control.controllers.host import ControllerHost
from flexslew_control.law import PlantDescription
from flexslew_lab.run.in_process import Observer
from flexslew_lab.trial.trial import Trial, bench_settings, law_of, plant_of
from flexslew_plant.bench.bench import Bench, Truth
from flexslew_plant.bench.operation.session import Session
from flexslew_plant.bench.wire import (
    command_bytes,
    command_from,
    measurement_bytes,
    measurement_from,
)
from flexslew_plant.events import Event
from flexslew_plant.measurement import Measurement


class WireBench:
    """A session, its hosts, and what they have said.

    Args:
        trial: whose bench and controllers they are; it has no plan of its own here.
    """

    def __init__(self, trial: Trial) -> None:
        trial = replace(trial, plan=None)
        self.bench = Bench(bench_settings(trial))
        self.plant: PlantDescription = plant_of(trial)
        self.now = 0.0
        self.session = Session(self.bench, (), 0.0, 2.0, True, lambda: [], lambda: [])
        self.events: list[Any] = []
        self.truth_log: list[Truth] = []
        self.hosts: dict[str, ControllerHost] = {}
        self._laws = {name: law_of(name, own or {}) for name, own in trial.controllers.items()}
        for name in self._laws:
            self.start(name)
        self._asleep: dict[str, int] = {}  # who hears no question before which tick
        self._waiting: list[Measurement] = []
        self.observer: Observer | None = None
        self._tell()

    def start(self, name: str) -> None:
        """Start a controller, or start it again in place of one that was killed."""
        law, values = self._laws[name]
        self.hosts[name] = host = ControllerHost(name, values)
        host.notify(
            lambda given: build_controller(name, law, given, self.plant, name),
            len(self.bench.appendages.names),
        )

    def sleep(self, name: str, ticks: int) -> None:
        """Let a controller hear nothing for so many ticks."""
        self._asleep[name] = self.bench.tick + ticks

    def fly(self, tick: int, deaf: Mapping[int, set[str]] | None = None) -> None:
        """Fly until the question of this tick is out, or the run rests.

        Args:
            tick: at which to stop.
            deaf: at which tick nobody hears the answers of whom: they are missed.
        """
        for _ in range(1000 * (tick + 10)):
            if (self.bench.tick >= tick and self._waiting) or self.bench.done:
                return
            self.now += 0.02
            self.session.poll(self.now)
            self._take()
            if self._waiting and self.bench.tick < tick:
                self._answer(deaf or {})
            self._tell()
            if not self.session.run.running and self.session.run.state != "waiting":
                return
        raise AssertionError(f"stuck at tick {self.bench.tick}: {self.session.waiting_for}")

    def of_kind(self, kind: str) -> list[Any]:
        """Return the events of a kind."""
        return [event for event in self.events if event.kind == kind]

    def _answer(self, deaf: Mapping[int, set[str]]) -> None:
        """Let everybody hear the questions that wait."""
        waiting, self._waiting = self._waiting, []
        for question in waiting:
            data = measurement_bytes(question)
            for name, host in self.hosts.items():
                if question.tick < self._asleep.get(name, 0):
                    continue
                heard, at = measurement_from(data, self.bench.settings.period)
                answer = host.observe(heard)
                if answer is not None and self.observer is not None:
                    self.observer.answer(answer)
                if answer is not None and name not in deaf.get(question.tick, ()):
                    command = command_from(command_bytes(answer.command, at))
                    self.session.take(command, self.now)
        self._take()

    def _take(self) -> None:
        """Take what the session and the hosts have said."""
        while self.session.outgoing:
            record = self.session.outgoing.popleft()
            if isinstance(record, Measurement):
                self._waiting.append(record)
                if self.observer is not None:
                    self.observer.question(record)
            elif isinstance(record, Truth):
                self.truth_log.append(record)
                if self.observer is not None:
                    self.observer.truth(record)
            else:
                self._note(record)
        for host in self.hosts.values():
            while host.events:
                self._note(host.events.popleft())

    def _note(self, event: Event) -> None:
        self.events.append(event)
        if self.observer is not None:
            self.observer.event(event)

    def _tell(self) -> None:
        """Let the plant hear how the controllers are."""
        for name, host in self.hosts.items():
            self.session.reasons[name] = host.reason
            self.session.node_progress.received(name, host.last_tick, host.epoch)
