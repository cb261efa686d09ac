"""A flight kept whole: the truth at every tick, the events, and the metrics of both."""

from dataclasses import dataclass, field
from typing import Any

from flexslew_control.plan import Plan
from flexslew_lab.run.in_process import Observer
from flexslew_lab.run.metrics_observer import MetricsObserver
from flexslew_plant.bench.bench import Bench, Truth
from flexslew_plant.events import Event


@dataclass
class FlightLog(Observer):
    """Implements in_process.Observer."""

    bench: Bench  # that flies
    plan: Plan | None
    truth_log: list[Truth] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)

    def truth(self, truth: Truth) -> None:
        """Take the state at a tick."""
        self.truth_log.append(truth)

    def event(self, event: Event) -> None:
        """Take an event."""
        self.events.append(event)

    def metrics(self, end: float | None = None) -> dict[str, Any]:
        """Return the content of metrics.json.

        Args:
            end: of the manoeuvre, instead of that of the plan [s].
        """
        measured = MetricsObserver(self.bench, self.plan, end=end)
        for truth in self.truth_log:
            measured.truth(truth)
        for event in self.events:
            measured.event(event)
        return measured.result()
