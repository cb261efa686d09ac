"""Events of controllers and plans."""

from typing import Any

from flexslew_plant.events.event import NO_NAME, Count, Finite, Level, Text, fact


def _controller_tuned_message(event: Any) -> str:
    changes = ", ".join(f"{key}: {value}" for key, value in event.settings.items())
    return f"{event.controller} tuned: {changes}"


@fact("tuned", Level.INFO, _controller_tuned_message)
class ControllerTuned:
    """A controller has other settings from this tick on."""

    controller: Text
    settings: dict[str, Any]  # that were changed
    before: dict[str, Any]  # all of them
    who: Text = NO_NAME


def _estimate_started_message(event: Any) -> str:
    why = "has just come" if event.fresh else "has not received the questions before"
    return f"{event.controller} {why}: its estimator begins here"


@fact("began", Level.INFO, _estimate_started_message)
class EstimateStarted:
    """An estimator starts in flight, as its controller was late, came back or missed ticks."""

    controller: Text = ""
    fresh: bool = False  # the first measurement that this process has received


@fact(
    "doubted",
    Level.FAULT,
    lambda event: f"{event.controller} does not trust its estimate: {event.reason}",
)
class EstimateInconsistent:
    """The innovations of an estimator are larger than it states."""

    controller: Text = ""
    channel: Text = ""  # of the measurement
    ticks: Count = 0  # over which the statistic was taken
    statistic: Finite = 0.0
    limit: Finite = 1.0

    @property
    def reason(self) -> str:
        """Why the controller is not ready from now on."""
        times = self.statistic / self.limit if self.limit else 0.0
        where = f"the innovation of {self.channel} over {self.ticks} ticks"
        return f"{where} is {times:.3g} times its limit"


@fact(
    "softened", Level.WARNING, "no effort keeps the limit of {limit}: it is passed by {excess:.3g}"
)
class LimitViolation:
    """No efforts keep a limit of a law that predicts; it is passed by as little as can be."""

    limit: Text  # its name
    excess: Finite  # the largest of the prediction [rad or m]


@fact(
    "repeated",
    Level.WARNING,
    "no answer in {iterations} iterations: the one before is applied again",
)
class AnswerRepeated:
    """A law that solves a problem at every tick found no answer in time; reported once in a row."""

    iterations: Count  # that did not suffice


@fact("stray", Level.WARNING, "{node} ignores a message on {topic}: {what}")
class UnexpectedMessage:
    """A node that is not the plant of this bench publishes on one of its topics; reported once."""

    topic: Text
    node: Text  # that received it
    what: Text  # is wrong with it


@fact(
    "planned", Level.INFO, lambda event: _line(event.method, event.duration, "planned", event.hash)
)
class PlanPublished:
    """Controllers follow a plan from its start on."""

    hash: Text = ""
    method: Text = ""
    duration: Finite | None = None  # [s]
    who: Text = NO_NAME


@fact(
    "plan_drafted",
    Level.INFO,
    lambda event: _line(
        event.method, event.duration, "drafted, to be adopted or refused", event.hash
    ),
)
class PlanDrafted:
    """A plan waits for a decision."""

    hash: Text = ""
    method: Text = ""
    duration: Finite | None = None  # [s]
    who: Text = NO_NAME


def _plan_rejected_message(event: Any) -> str:
    if event.controller is not None:
        return f"{event.controller} refuses the plan: {event.reason}"
    return _line(event.method or "", event.duration, "refused by the operator", event.hash)


@fact(
    "plan_refused",
    lambda event: Level.INFO if event.controller is None else Level.WARNING,
    _plan_rejected_message,
)
class PlanRejected:
    """A draft is dropped by an operator, or a controller does not follow a plan."""

    hash: Text = ""
    method: Text | None = None
    duration: Finite | None = None  # [s]
    who: Text | None = None  # None: the controller
    controller: Text | None = None  # None: the operator
    reason: Text | None = None  # of the controller, for people


@fact("plan_outdated", Level.WARNING, "{method}: {reason}; plan again")
class PlanOutdated:
    """A plan that is still to be flown was made for a law that is not active at its start."""

    hash: Text = ""
    method: Text = ""
    reason: Text = ""  # for people


def _line(method: str, duration: float | None, what: str, digest: str) -> str:
    return f"{method}: {duration or 0.0:g} s {what}, hash {digest[:12]}"
