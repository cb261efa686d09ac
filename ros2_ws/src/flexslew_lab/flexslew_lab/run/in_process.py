"""A trial in one process, without ROS: the same ticks, the same log, the same bits."""

from collections.abc import Callable, Iterator
from time import monotonic
from typing import Protocol

from flexslew_control.controllers.controller import Answer, Controller
from flexslew_plant.bench.bench import Bench, Truth
from flexslew_plant.events import Event, Started
from flexslew_plant.measurement import Measurement


class Observer(Protocol):
    """Sees everything that goes over the topics of a run."""

    def truth(self, truth: Truth) -> None:
        """Take the state at a tick."""
        return

    def question(self, question: Measurement) -> None:
        """Take a measurement."""
        return

    def answer(self, answer: Answer) -> None:
        """Take an answer, whether the drive takes it or not."""
        return

    def event(self, event: Event) -> None:
        """Take an event."""
        return


def run_bench(
    bench: Bench,
    controllers: dict[str, Controller],
    observer: Observer | None = None,
    progress: Callable[[int], None] | None = None,
) -> None:
    """Run the bench to the end of its duration, or until its state is lost.

    Args:
        bench: at tick 0.
        controllers: by name; every one sees every measurement.
        observer: gets what the topics would carry.
        progress: called with the tick, once every 1000.
    """
    started = monotonic()
    bench.tell(Started())
    while not bench.done:
        _tick(bench, controllers, observer)
        if progress is not None and bench.tick % 1000 == 0:
            progress(bench.tick)
    bench.finish(monotonic() - started)
    if observer is not None:
        if not bench.failure:  # else the truth of this tick was seen before it failed
            observer.truth(bench.truth())
        for event in _take_events(bench):
            observer.event(event)


def _tick(bench: Bench, controllers: dict[str, Controller], observer: Observer | None) -> None:
    question = bench.question
    if observer is not None:
        observer.question(question)
        observer.truth(bench.truth())
        for event in _take_events(bench):
            observer.event(event)
    for controller in controllers.values():
        _answer(bench, controller, question, observer)
        bench.set_ready_status(controller.name, controller.reason)
        while controller.events:
            event = controller.events.popleft()
            if observer is not None:
                observer.event(event)
    if not bench.answered and bench.question is not question:
        # the drive refused the newcomer's step and returns the question to its predecessor
        if observer is not None:
            observer.question(bench.question)
        previous = controllers.get(bench.question.controller)
        if previous is not None:  # else it was the brake
            _answer(bench, previous, bench.question, observer)
    bench.advance()


def _answer(
    bench: Bench, controller: Controller, question: Measurement, observer: Observer | None
) -> None:
    answer = controller.observe(question)
    if answer is None:
        return
    bench.offer(answer.command)
    if observer is not None:
        observer.answer(answer)


def _take_events(bench: Bench) -> Iterator[Event]:
    while bench.events:
        yield bench.events.popleft()
