"""A trial in one process, without ROS: the same ticks, the same log, the same bits."""

from collections.abc import Callable, Iterator
from time import monotonic
from typing import Protocol

from flexslew_control.controllers.controller import Answer, Controller
from flexslew_lab.run.tick import ask_controllers
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
    started, exchange = monotonic(), _exchange(bench, observer)
    publish = None if observer is None else observer.question
    bench.tell(Started())
    try:
        while not bench.done:
            question = bench.question
            if observer is not None:
                observer.question(question)
                observer.truth(bench.truth())
                for event in _take_events(bench):
                    observer.event(event)
            ask_controllers(bench, question, controllers, exchange, publish)
            bench.advance()
            if progress is not None and bench.tick % 1000 == 0:
                progress(bench.tick)
        bench.finish(monotonic() - started)
    finally:
        bench.close()  # a plant with a brake is braked however the run ends
        for controller in controllers.values():
            controller.close()
    if observer is not None:
        if not bench.failure:  # else the truth of this tick was seen before it failed
            observer.truth(bench.truth())
        for event in _take_events(bench):
            observer.event(event)


def _exchange(bench: Bench, observer: Observer | None) -> Callable[[Controller, Measurement], None]:
    """Return what takes a question to a controller, and its answer to the bench."""

    def exchange(controller: Controller, question: Measurement) -> None:
        answer = controller.observe(question)
        if answer is not None:
            bench.offer(answer.command)
            if observer is not None:
                observer.answer(answer)
        bench.set_ready_status(controller.name, controller.reason)
        while controller.events:
            event = controller.events.popleft()
            if observer is not None:
                observer.event(event)

    return exchange


def _take_events(bench: Bench) -> Iterator[Event]:
    while bench.events:
        yield bench.events.popleft()
