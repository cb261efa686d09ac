"""What a page needs of a bench, be it alive or a log."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol

from flexslew_lab.console.view import BenchView
from flexslew_plant.graph import topics

SHOWN_TOPICS = (  # what a page shows of a bench or of a log
    topics.TESTBED, topics.CONTROLLER_STATUS, topics.EVENTS, topics.PLAN, topics.TRUTH,
    topics.CONTROLLER_STATE,
)  # fmt: skip


class RequestResult(NamedTuple):
    """What became of a request."""

    ok: bool
    message: str
    tick: int = 0  # tick of the request, if it has one


class Iterate(NamedTuple):
    """One iteration of a planner."""

    number: int
    objective: float
    norm_terminal_error: float
    norm_input: float  # NaN where the method has none


DRAFTED = "drafted: adopt or refuse it"


def plan_outcome(plan: Any, outcome: str, *details: str | None) -> str:
    """Return what became of a request for a plan, for a person.

    Args:
        plan: the plan, or its message.
        outcome: what it is now, such as DRAFTED.
        details: what else there is to state; empty ones are left out.
    """
    words = f"{plan.method}: {plan.duration:g} s from {plan.start:g} s on is {outcome}"
    return "; ".join(filter(None, (words, *details)))


Then = Callable[[RequestResult], None]
PlanCallback = Callable[
    [RequestResult, Any], None
]  # takes a flexslew_msgs/Plan, or None without one


class BenchLink(Protocol):
    """The way to a bench. All calls come from one thread, and all answers to it."""

    view: BenchView
    replay: bool  # of a log, which accepts no requests
    folder: str  # of the run; empty where it is not known
    command: str  # that repeats it

    def poll(self, now: float) -> None:
        """Take what has come by this wall time [s] into the view, and deliver answers."""

    def ask(self, service: str, values: Mapping[str, Any], then: Then) -> None:
        """Ask for something by the name of its ROS service.

        Args:
            service: as in the table of topics; `<controller>/tune` for a controller.
            values: fields of the request; a simulated time `at` in seconds.
            then: called with the answer, also where there is none.
        """

    def draft(
        self, request: str, who: str, progress: Callable[[Iterate], None], then: PlanCallback
    ) -> None:
        """Request a manoeuvre, YAML of a `plan` section, that no controller follows yet."""

    def cancel(self) -> None:
        """Give up the plan that is being made."""

    def measure(self, on: bool) -> None:
        """Add the sensor readings of every tick to the view, or stop adding them."""
