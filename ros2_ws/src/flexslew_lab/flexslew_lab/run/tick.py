"""One tick of a bench whose controllers are in the same process: which ones are asked."""

from collections.abc import Callable, Mapping
from typing import TypeVar

from flexslew_plant.bench.bench import Bench
from flexslew_plant.measurement import Measurement

_Controller = TypeVar("_Controller")


def ask_controllers(
    bench: Bench,
    question: Measurement,
    controllers: Mapping[str, _Controller],
    exchange: Callable[[_Controller, Measurement], None],
    publish: Callable[[Measurement], None] | None = None,
) -> None:
    """Put the question of a tick to all controllers, and again to one where a step was refused.

    Where the drive refuses the step of a controller that takes over, the question goes to the
    previous one.

    Args:
        bench: that asks.
        question: of this tick.
        controllers: by name.
        exchange: takes a question to a controller, and its answer to the bench.
        publish: receives a question that is put again.
    """
    for controller in controllers.values():
        exchange(controller, question)
    if bench.question is not question and not bench.answered:  # else it was the brake
        if publish is not None:
            publish(bench.question)
        previous = controllers.get(bench.question.controller)
        if previous is not None:
            exchange(previous, bench.question)
