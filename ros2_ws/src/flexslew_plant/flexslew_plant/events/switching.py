"""Events of who is in charge: switches, missed answers, fallbacks, the brake, who is ready."""

from typing import ClassVar

from flexslew_plant.events.event import (
    Count,
    Efforts,
    Finite,
    Flag,
    Level,
    Text,
    fact,
)
from flexslew_plant.refusal import Cause

BRAKE = ""  # the name of the drive's own brake, where a controller's stands


_ROUNDING = 1e-9  # effort steps below this come from it [N m or N]


@fact
class SwitchRequested:
    """Somebody asked for another controller, and will get it unless something comes between."""

    kind: ClassVar[str] = "switch_requested"
    level: ClassVar[Level] = Level.INFO
    controller: Text
    tick: Count  # from which on
    strict: Flag
    max_effort_step: Finite  # [N m or N]
    who: Text = ""

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"{self.controller} requested from tick {self.tick} on"


@fact
class Switched:
    """Another controller has answered and is in charge."""

    kind: ClassVar[str] = "switched"
    level: ClassVar[Level] = Level.INFO
    from_: Text | None = None
    to: Text | None = None
    effort_step: Efforts | Finite | None = None

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"{self.from_ or 'brake'} -> {self.to}, effort step {step_words(self.effort_step)}"


@fact
class SwitchRefused:
    """The effort of a newcomer would have stepped too far; its predecessor stays in charge."""

    kind: ClassVar[str] = "switch_refused"
    level: ClassVar[Level] = Level.WARNING
    from_: Text | None = None
    to: Text | None = None
    effort_step: Efforts | Finite | None = None
    max_effort_step: Finite | None = None

    @property
    def message(self) -> str:
        """One line for a person."""
        return (
            f"switch to {self.to} refused: its effort would step by "
            f"{largest(self.effort_step):.3g}, max_effort_step is "
            f"{self.max_effort_step or 0.0:.3g}; {self.from_ or 'the brake'} stays in charge"
        )


@fact
class SwitchDropped:
    """A switch that was requested did not take place."""

    kind: ClassVar[str] = "switch_dropped"
    level: ClassVar[Level] = Level.WARNING
    controller: Text
    cause: Cause
    reason: Text = ""  # for people
    due: Count = 0  # tick

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"switch to {self.controller} dropped: {self.reason}"


@fact
class AnswerMissed:
    """A tick passed without a valid answer, and the last effort was held."""

    kind: ClassVar[str] = "missed"
    level: ClassVar[Level] = Level.WARNING
    controller: Text = ""
    in_a_row: Count = 1
    ticks: Count | None = None  # that it stands for; None: one

    @property
    def message(self) -> str:
        """One line for a person."""
        return (
            f"no valid answer from {self.controller}, last effort held ({self.in_a_row} in a row)"
        )


@fact
class FallbackTookOver:
    """A fallback, or the predecessor of a newcomer, took over from a controller that failed."""

    kind: ClassVar[str] = "fallback"
    level: ClassVar[Level] = Level.FAULT
    to: Text
    from_: Text = ""
    cause: Cause | None = None

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"{self.from_} {_failing(self.cause)}: {self.to} takes over"


@fact
class BrakeTookOver:
    """The drive's own brake took over from a controller that failed."""

    kind: ClassVar[str] = "brake"
    level: ClassVar[Level] = Level.FAULT
    to: Text = BRAKE
    from_: Text = ""
    cause: Cause | None = None

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"{self.from_} {_failing(self.cause)}: the brake takes over"


def _failing(cause: Cause | None) -> str:
    return "uses implausible sensors" if cause is Cause.DOUBTED else "is silent"


@fact
class BrakeRequested:
    """An operator wants the brake, or no longer."""

    kind: ClassVar[str] = "brake_requested"
    level: ClassVar[Level] = Level.INFO
    on: Flag
    tick: Count = 0  # from which on
    who: Text = ""

    @property
    def message(self) -> str:
        """One line for a person."""
        return (
            f"{'brake' if self.on else 'release of the brake'} requested from tick {self.tick} on"
        )


@fact
class BrakeLatched:
    """The brake is on until an operator releases it."""

    kind: ClassVar[str] = "brake_latched"
    level: ClassVar[Level] = Level.WARNING
    from_: Text = BRAKE
    to: Text = BRAKE

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"brake latched; {self.from_ or 'nobody'} was in charge"


@fact
class BrakeReleased:
    """Controllers can be switched in again; until then the brake acts."""

    kind: ClassVar[str] = "brake_released"
    level: ClassVar[Level] = Level.INFO

    @property
    def message(self) -> str:
        """One line for a person."""
        return "brake released; it stays on until a controller is switched in"


@fact
class BecameUnready:
    """A controller can no longer take charge, or can not for another cause than before."""

    kind: ClassVar[str] = "not_ready"
    level: ClassVar[Level] = Level.WARNING
    controller: Text = ""
    reason: Text = ""  # for people
    cause: Cause | None = None

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"{self.controller} is not ready: {self.reason}"


@fact
class BecameReady:
    """A controller can take charge again."""

    kind: ClassVar[str] = "ready"
    level: ClassVar[Level] = Level.INFO
    controller: Text = ""
    reason: Text = ""  # empty

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"{self.controller} is ready again"


@fact
class SensorsImplausible:
    """The joint sensors contradict each other; the controller in charge loses the bench."""

    kind: ClassVar[str] = "implausible"
    level: ClassVar[Level] = Level.FAULT
    controller: Text = ""
    joint: Text = ""
    difference: Finite = 0.0  # between the motion and the rate sensor [rad/s or m/s]

    @property
    def message(self) -> str:
        """One line for a person."""
        return (
            f"the sensors of {self.joint} contradict each other: it moves by "
            f"{self.difference:.3g} per second more than its rate sensor says"
        )


def step_words(step: list[float] | float | None) -> str:
    """Return the largest magnitude of an effort step for a person; what is rounding is 0."""
    size = largest(step)
    return f"{size:.3g}" if size > _ROUNDING else "0"


def largest(step: list[float] | float | None) -> float:
    """Return the largest magnitude of an effort step; 0 where there is none."""
    steps = step if isinstance(step, list) else [step or 0.0]
    return max(map(abs, steps), default=0.0)
