"""Events of controllers and plans."""

from typing import Any, ClassVar

from flexslew_plant.events.event import UNNAMED, Count, Finite, Level, Text, fact


@fact
class ControllerTuned:
    """A controller has other settings from this tick on."""

    kind: ClassVar[str] = "tuned"
    level: ClassVar[Level] = Level.INFO
    controller: Text
    settings: dict[str, Any]  # that were changed
    before: dict[str, Any]  # all of them
    who: Text = UNNAMED

    @property
    def message(self) -> str:
        """One line for a person."""
        changes = ", ".join(f"{key}: {value}" for key, value in self.settings.items())
        return f"{self.controller} tuned: {changes}"


@fact
class EstimateBegan:
    """An estimator begins in flight: its controller came late, came back, or heard a gap."""

    kind: ClassVar[str] = "began"
    level: ClassVar[Level] = Level.INFO
    controller: Text = ""
    fresh: bool = False  # the first question that this process has heard

    @property
    def message(self) -> str:
        """One line for a person."""
        why = "has just come" if self.fresh else "has not heard the questions before"
        return f"{self.controller} {why}: its estimator begins here"


@fact
class EstimateDoubted:
    """The innovations of an estimator are larger than it states."""

    kind: ClassVar[str] = "doubted"
    level: ClassVar[Level] = Level.FAULT
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

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"{self.controller} does not trust its estimate: {self.reason}"


@fact
class LimitSoftened:
    """No efforts keep a limit of a law that predicts; it is passed by as little as can be."""

    kind: ClassVar[str] = "softened"
    level: ClassVar[Level] = Level.WARNING
    limit: Text  # whose
    excess: Finite  # the largest of the prediction [rad or m]

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"no effort keeps the limit of {self.limit}: it is passed by {self.excess:.3g}"


@fact
class AnswerRepeated:
    """A law that solves a problem at every tick found no answer in time; said once in a row."""

    kind: ClassVar[str] = "repeated"
    level: ClassVar[Level] = Level.WARNING
    iterations: Count  # that did not suffice

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"no answer in {self.iterations} iterations: the one before is applied again"


@fact
class StrayMessage:
    """Somebody who is not the plant of this bench speaks on one of its topics; said once."""

    kind: ClassVar[str] = "stray"
    level: ClassVar[Level] = Level.WARNING
    topic: Text
    node: Text  # that has heard it
    what: Text  # is wrong with it

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"{self.node} ignores a message on {self.topic}: {self.what}"


@fact
class PlanPublished:
    """Controllers follow a plan from its start on."""

    kind: ClassVar[str] = "planned"
    level: ClassVar[Level] = Level.INFO
    hash: Text = ""
    method: Text = ""
    duration: Finite | None = None  # [s]
    who: Text = UNNAMED

    @property
    def message(self) -> str:
        """One line for a person."""
        return _line(self.method, self.duration, "planned", self.hash)


@fact
class PlanDrafted:
    """A plan waits for somebody's decision."""

    kind: ClassVar[str] = "plan_drafted"
    level: ClassVar[Level] = Level.INFO
    hash: Text = ""
    method: Text = ""
    duration: Finite | None = None  # [s]
    who: Text = UNNAMED

    @property
    def message(self) -> str:
        """One line for a person."""
        return _line(self.method, self.duration, "drafted, to be adopted or refused", self.hash)


@fact
class PlanRefused:
    """A draft is dropped by an operator, or a controller does not follow a plan."""

    kind: ClassVar[str] = "plan_refused"
    hash: Text = ""
    method: Text | None = None
    duration: Finite | None = None  # [s]
    who: Text | None = None  # None: the controller
    controller: Text | None = None  # None: the operator
    reason: Text | None = None  # of the controller, for people

    @property
    def level(self) -> Level:
        """An operator knows what he does."""
        return Level.INFO if self.controller is None else Level.WARNING

    @property
    def message(self) -> str:
        """One line for a person."""
        if self.controller is not None:
            return f"{self.controller} refuses the plan: {self.reason}"
        return _line(self.method or "", self.duration, "refused by the operator", self.hash)


def _line(method: str, duration: float | None, what: str, digest: str) -> str:
    return f"{method}: {duration or 0.0:g} s {what}, hash {digest[:12]}"
