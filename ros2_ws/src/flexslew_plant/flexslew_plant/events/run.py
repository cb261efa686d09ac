"""Events of the run itself: its start and end, its pace, what the drive and the plant refuse."""

from enum import StrEnum
from math import pi
from typing import Any

from flexslew_plant.counted import count_text
from flexslew_plant.events.event import NO_NAME, Count, Finite, Level, Seconds, Text, fact
from flexslew_plant.step_times import TimeSummary


@fact("started", Level.INFO, "started at tick {tick}")
class Started:
    """Ticks pass from tick 0 on."""

    tick: Count = 0
    who: Text | None = None  # None: the trial started by itself


@fact("resumed", Level.INFO, "resumed at tick {tick}")
class Resumed:
    """Ticks pass again after a pause."""

    tick: Count = 0
    who: Text = NO_NAME


@fact("paused", Level.INFO, "paused at tick {tick}")
class Paused:
    """The bench rests between two ticks."""

    tick: Count = 0
    who: Text = NO_NAME


@fact(
    "step", Level.INFO, lambda event: f"{count_text(event.ticks, 'tick')} from tick {event.tick} on"
)
class StepsRequested:
    """An operator lets a paused bench fly some ticks."""

    tick: Count = 0
    ticks: Count = 1
    who: Text = NO_NAME


@fact("reset", Level.INFO, "reset, epoch {epoch}; call start")
class WasReset:
    """The bench is back at tick 0, in another epoch."""

    from_tick: Count | None = None  # None: it is not in the log
    epoch: Count | None = None  # that begins
    who: Text = NO_NAME


@fact(
    "rate",
    Level.INFO,
    lambda event: f"rate {event.rate_factor:g}" if event.rate_factor else "as fast as possible",
)
class RateChanged:
    """The run goes on at another rate."""

    rate_factor: Finite = 0.0  # simulated seconds per wall second; 0: as fast as possible
    who: Text = NO_NAME


@fact("note", Level.INFO, "{text}")
class OperatorNote:
    """An operator's remark."""

    text: Text = ""
    who: Text = NO_NAME


@fact("interrupted", Level.WARNING, "stopped at tick {tick}")
class RunStopped:
    """The run ends before its time."""

    tick: Count = 0


def _run_finished_message(event: Any) -> str:
    elapsed = event.wall_time or 0.0
    ticks = count_text(event.ticks or 0, "tick")
    return f"{ticks} in {elapsed:.2f} s wall, {event.missed_ticks} missed"


@fact("finished", Level.INFO, _run_finished_message)
class RunFinished:
    """The plant has flown the last tick."""

    wall_time: Seconds | None = None  # during which ticks have passed [s]
    ticks: Count | None = None
    missed_ticks: Count | None = None
    saturated_time: Seconds | None = None  # in which a demand was beyond a limit, simulated [s]
    rejected: dict[str, Count] | None = None  # commands, by the drive's objection


@fact(
    "large_deflection",
    Level.WARNING,
    "{channel} deflects by {deflection:.3g} m, more than a tenth of its length: beyond "
    "{small:.3g} m the equations of small deflections no longer hold",
)
class LargeDeflection:
    """An appendage has left the range of small deflections, for the first time of its epoch."""

    channel: Text = ""  # which reading of its tip
    deflection: Finite = 0.0  # [m]
    small: Finite = 0.0  # largest that counts as small [m]


def _fast_mode(event: Any) -> str:
    """Return what happens to a mode that turns far in a tick."""
    words = (
        f"the fastest mode, {event.frequency:.4g} rad/s, turns by {event.turn:.3g} rad in a tick "
        f"of {count_text(event.steps, 'step')}: an error of {100.0 * event.error:.2g} % of its "
        "vibration over the run"
    )
    if event.turn > pi:
        words += "; sensors read it at a lower frequency, as it turns by more than half a turn"
    return f"{words}; take at most {event.period:g} s, or fewer modes"


@fact("fast_mode", Level.WARNING, _fast_mode)
class FastMode:
    """A mode turns far in a tick: what integration and sampling make of it, once an epoch."""

    frequency: Finite = 0.0  # of the fastest mode at the start [rad/s]
    turn: Finite = 0.0  # of it in a tick [rad]
    period: Seconds = 0.0  # that is short enough [s]
    steps: Count = 1  # of the integration in a tick
    error: Finite = 0.0  # of its vibration over the run, of the amplitude at the start [-]


@fact(
    "not_finite",
    Level.FAULT,
    "the state is not finite after tick {tick} ({time:.6g} s), {state}; likely cause: {cause}",
)
class StateLost:
    """The state after a tick is not finite, and the run ends."""

    tick: Count = 0
    time: Seconds = 0.0  # simulated [s]
    state: Text = ""  # which part of it
    cause: Text = ""  # the likely one, for people


@fact(
    "plant_lost",
    Level.FAULT,
    "the plant cannot go on after tick {tick} ({time:.6g} s): {cause}",
)
class PlantLost:
    """An external plant has ended, is too slow or breaks its protocol, and the run ends."""

    tick: Count = 0
    time: Seconds = 0.0  # simulated [s]
    cause: Text = ""  # for people


@fact(
    "plant_ticks_missed",
    Level.WARNING,
    lambda event: (
        f"{count_text(event.ticks, 'tick')} of the plant's clock missed until tick {event.tick}: "
        f"{event.lost} lost, {event.late} late"
    ),
)
class PlantTicksMissed:
    """Ticks of a plant with its own clock in a row: their measurement was lost, or effort late."""

    tick: Count = 0  # at which they end
    ticks: Count = 0
    lost: Count = 0  # measurements that have not come
    late: Count = 0  # efforts that left after the next measurement had come


_QUANTITIES = {
    "step": "plant, efforts with their measurements",
    "response": "bench, measurements with their efforts",
    "interval": "plant, intervals of its measurements",
    "controller": "controller, measurements with their efforts",
}


def _wall_times(event: Any) -> str:
    summary = TimeSummary(*list(vars(event).values())[1:])
    return f"{_QUANTITIES.get(event.quantity, event.quantity)}: {summary}"


@fact("wall_times", Level.INFO, _wall_times)
class WallTimes:
    """Wall times of an external plant at the end of an epoch, or of a controller so far."""

    quantity: Text = ""  # step, response, interval or controller
    steps: Count = 0
    least: Seconds = 0.0  # [wall s]
    median: Seconds = 0.0  # [wall s]
    late: Seconds = 0.0  # 99 % are at most as long [wall s]
    longest: Seconds = 0.0  # [wall s]
    jitter: Seconds = 0.0  # standard deviation [wall s]


@fact(
    "late",
    Level.WARNING,
    "{late:.3f} s behind the schedule, which is shifted; {total:.3f} s in all",
)
class ScheduleShifted:
    """A paced run was too late and begins a new schedule."""

    late: Finite = 0.0  # this time [wall s]
    total: Finite = 0.0  # in all [wall s]
    count: Count = 1  # how often so far


@fact("transport", Level.INFO, "{controller} is queried over {transport}")
class TransportChosen:
    """How a controller receives measurements and answers: its efforts are the same either way."""

    controller: Text = ""
    transport: Text = ""  # socket (a process of this machine and user) or dds


class RejectionReason(StrEnum):
    """Why the drive does not take a command."""

    SENDER = "sender"
    STALE = "stale"
    SIZE = "size"
    FINITE = "finite"


@fact("rejected", Level.WARNING, "effort command rejected ({reason}): {detail}; {count} so far")
class CommandRejected:
    """The drive did not take a command; the 1st, 2nd, 4th, 8th ... of a kind is an event."""

    reason: RejectionReason | None = None
    count: Count = 1  # of this reason so far
    controller: Text = ""
    detail: Text = ""  # for people


@fact("rival", Level.WARNING, "a second plant has joined this bench and must exit: {node}")
class SecondPlant:
    """Another plant has come onto this bench."""

    node: Text = ""
