"""Events of the active controller: switches, missed answers, fallbacks, brake, readiness."""

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


@fact("switch_requested", Level.INFO, "{controller} requested from tick {tick} on")
class SwitchRequested:
    """An operator requested another controller, which becomes active unless it is refused."""

    controller: Text
    tick: Count  # from which on
    strict: Flag
    max_effort_step: Finite  # [N m or N]
    who: Text = ""


@fact(
    "switched",
    Level.INFO,
    lambda event: (
        f"{event.from_ or 'brake'} -> {event.to}, effort step {step_words(event.effort_step)}"
    ),
)
class SwitchCompleted:
    """Another controller has answered and is in charge."""

    from_: Text | None = None
    to: Text | None = None
    effort_step: Efforts | Finite | None = None


@fact(
    "switch_refused",
    Level.WARNING,
    lambda event: (
        f"switch to {event.to} refused: its effort would step by "
        f"{largest(event.effort_step):.3g}, max_effort_step is "
        f"{event.max_effort_step or 0.0:.3g}; {event.from_ or 'the brake'} stays in charge"
    ),
)
class SwitchRejected:
    """The effort of a newcomer would have stepped too far; its predecessor stays in charge."""

    from_: Text | None = None
    to: Text | None = None
    effort_step: Efforts | Finite | None = None
    max_effort_step: Finite | None = None


@fact("switch_dropped", Level.WARNING, "switch to {controller} dropped: {reason}")
class SwitchDropped:
    """A switch that was requested did not take place."""

    controller: Text
    cause: Cause
    reason: Text = ""  # for people
    due: Count = 0  # tick


@fact(
    "missed",
    Level.WARNING,
    "no valid answer from {controller}, last effort held ({in_a_row} in a row)",
)
class AnswerMissing:
    """A tick passed without a valid answer, and the last effort was held."""

    controller: Text = ""
    in_a_row: Count = 1
    ticks: Count | None = None  # that it stands for; None: one


@fact(
    "fallback",
    Level.FAULT,
    lambda event: f"{event.from_} {_failing(event.cause)}: {event.to} takes over",
)
class FallbackActivated:
    """A fallback, or the predecessor of a newcomer, took over from a controller that failed."""

    to: Text
    from_: Text = ""
    cause: Cause | None = None


@fact(
    "brake",
    Level.FAULT,
    lambda event: f"{event.from_} {_failing(event.cause)}: the brake takes over",
)
class BrakeActivated:
    """The drive's own brake took over from a controller that failed."""

    to: Text = BRAKE
    from_: Text = ""
    cause: Cause | None = None


def _failing(cause: Cause | None) -> str:
    return "uses implausible sensors" if cause is Cause.DOUBTED else "is silent"


@fact(
    "brake_requested",
    Level.INFO,
    lambda event: (
        f"{'brake' if event.on else 'release of the brake'} requested from tick {event.tick} on"
    ),
)
class BrakeRequested:
    """An operator latches or releases the brake."""

    on: Flag
    tick: Count = 0  # from which on
    who: Text = ""


@fact(
    "brake_latched",
    Level.WARNING,
    lambda event: f"brake latched; {event.from_ or 'nobody'} was in charge",
)
class BrakeLatched:
    """The brake is on until an operator releases it."""

    from_: Text = BRAKE
    to: Text = BRAKE


@fact("brake_released", Level.INFO, "brake released; it stays on until a controller is switched in")
class BrakeReleased:
    """Controllers can be switched in again; until then the brake acts."""


@fact("not_ready", Level.WARNING, "{controller} is not ready: {reason}")
class ControllerNotReady:
    """A controller can no longer take charge, or can not for another cause than before."""

    controller: Text = ""
    reason: Text = ""  # for people
    cause: Cause | None = None


@fact("ready", Level.INFO, "{controller} is ready again")
class ControllerReady:
    """A controller can take charge again."""

    controller: Text = ""
    reason: Text = ""  # empty


@fact(
    "implausible",
    Level.FAULT,
    "the sensors of {joint} contradict each other: it moves by {difference:.3g} per "
    "second more than its rate sensor reads",
)
class SensorsInconsistent:
    """The joint sensors contradict each other; the controller in charge loses the bench."""

    controller: Text = ""
    joint: Text = ""
    difference: Finite = 0.0  # between the motion and the rate sensor [rad/s or m/s]


def step_words(step: list[float] | float | None) -> str:
    """Return the largest magnitude of an effort step for a person; what is rounding is 0."""
    size = largest(step)
    return f"{size:.3g}" if size > _ROUNDING else "0"


def largest(step: list[float] | float | None) -> float:
    """Return the largest magnitude of an effort step; 0 where there is none."""
    steps = step if isinstance(step, list) else [step or 0.0]
    return max(map(abs, steps), default=0.0)
