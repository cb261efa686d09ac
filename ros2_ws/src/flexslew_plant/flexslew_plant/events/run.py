"""Events of the run itself: its start and end, its pace, what the drive and the plant refuse."""

from enum import StrEnum
from typing import ClassVar

from flexslew_plant.counted import counted
from flexslew_plant.events.event import UNNAMED, Count, Finite, Level, Seconds, Text, fact


@fact
class Started:
    """Ticks pass from tick 0 on."""

    kind: ClassVar[str] = "started"
    level: ClassVar[Level] = Level.INFO
    tick: Count = 0
    who: Text | None = None  # None: nobody asked, the trial begins by itself

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"started at tick {self.tick}"


@fact
class Resumed:
    """Ticks pass again after a pause."""

    kind: ClassVar[str] = "resumed"
    level: ClassVar[Level] = Level.INFO
    tick: Count = 0
    who: Text = UNNAMED

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"resumed at tick {self.tick}"


@fact
class Paused:
    """The bench rests between two ticks."""

    kind: ClassVar[str] = "paused"
    level: ClassVar[Level] = Level.INFO
    tick: Count = 0
    who: Text = UNNAMED

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"paused at tick {self.tick}"


@fact
class Stepped:
    """An operator lets a paused bench fly some ticks."""

    kind: ClassVar[str] = "step"
    level: ClassVar[Level] = Level.INFO
    tick: Count = 0
    ticks: Count = 1
    who: Text = UNNAMED

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"{counted(self.ticks, 'tick')} from tick {self.tick} on"


@fact
class WasReset:
    """The bench is back at tick 0, in another epoch."""

    kind: ClassVar[str] = "reset"
    level: ClassVar[Level] = Level.INFO
    from_tick: Count | None = None  # None: the log does not say it
    epoch: Count | None = None  # that begins
    who: Text = UNNAMED

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"reset, epoch {self.epoch}; call start"


@fact
class RateChanged:
    """The run goes on at another rate."""

    kind: ClassVar[str] = "rate"
    level: ClassVar[Level] = Level.INFO
    rate_factor: Finite = 0.0  # simulated seconds per wall second; 0: as fast as possible
    who: Text = UNNAMED

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"rate {self.rate_factor:g}" if self.rate_factor else "as fast as possible"


@fact
class Noted:
    """An operator's remark."""

    kind: ClassVar[str] = "note"
    level: ClassVar[Level] = Level.INFO
    text: Text = ""
    who: Text = UNNAMED

    @property
    def message(self) -> str:
        """The remark."""
        return self.text


@fact
class Interrupted:
    """The run ends before its time."""

    kind: ClassVar[str] = "interrupted"
    level: ClassVar[Level] = Level.WARNING
    tick: Count = 0

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"stopped at tick {self.tick}"


@fact
class RunFinished:
    """The plant has flown the last tick."""

    kind: ClassVar[str] = "finished"
    level: ClassVar[Level] = Level.INFO
    wall_time: Seconds | None = None  # during which ticks have passed [s]
    ticks: Count | None = None
    missed_ticks: Count | None = None
    saturated_time: Seconds | None = None  # in which more was asked for than a limit, simulated [s]
    rejected: dict[str, Count] | None = None  # commands, by the drive's objection

    @property
    def message(self) -> str:
        """One line for a person."""
        wall = self.wall_time or 0.0
        return (
            f"{counted(self.ticks or 0, 'tick')} in {wall:.2f} s wall, {self.missed_ticks} missed"
        )


@fact
class BentFar:
    """An appendage has left the range of small deflections, for the first time of its epoch."""

    kind: ClassVar[str] = "large_deflection"
    level: ClassVar[Level] = Level.WARNING
    channel: Text = ""  # which reading of its tip
    deflection: Finite = 0.0  # [m]
    small: Finite = 0.0  # largest that counts as small [m]

    @property
    def message(self) -> str:
        """One line for a person."""
        return (
            f"{self.channel} deflects by {self.deflection:.3g} m, more than a tenth of its length: "
            f"beyond {self.small:.3g} m the equations of small deflections no longer hold"
        )


@fact
class TurnsFar:
    """A mode is too fast for the ticks to follow, for the first time of an epoch."""

    kind: ClassVar[str] = "fast_mode"
    level: ClassVar[Level] = Level.WARNING
    frequency: Finite = 0.0  # of the fastest mode at the start [rad/s]
    turn: Finite = 0.0  # of it in a tick [rad]
    period: Seconds = 0.0  # that is short enough [s]

    @property
    def message(self) -> str:
        """One line for a person."""
        return (
            f"the fastest mode, {self.frequency:.4g} rad/s, turns by {self.turn:.3g} rad in a "
            "tick, more than half a turn: its vibration is not followed, and fades or grows; take "
            f"at most {self.period:.2g} s, or fewer modes"
        )


@fact
class StateLost:
    """The state after a tick is not finite, and the run ends."""

    kind: ClassVar[str] = "not_finite"
    level: ClassVar[Level] = Level.FAULT
    tick: Count = 0
    time: Seconds = 0.0  # simulated [s]
    state: Text = ""  # which part of it
    cause: Text = ""  # the likely one, for people

    @property
    def message(self) -> str:
        """One line for a person."""
        return (
            f"the state is not finite after tick {self.tick} ({self.time:.6g} s), {self.state}; "
            f"likely cause: {self.cause}"
        )


@fact
class FellBehind:
    """A paced run was too late and begins a new schedule."""

    kind: ClassVar[str] = "late"
    level: ClassVar[Level] = Level.WARNING
    late: Finite = 0.0  # this time [wall s]
    total: Finite = 0.0  # in all [wall s]
    count: Count = 1  # how often so far

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"{self.late:.3f} s behind the schedule, which is shifted; {self.total:.3f} s in all"


@fact
class TransportChosen:
    """How a controller is asked, and answers: what it computes is the same either way."""

    kind: ClassVar[str] = "transport"
    level: ClassVar[Level] = Level.INFO
    controller: Text = ""
    transport: Text = ""  # socket (a process of this machine and user) or dds

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"{self.controller} is asked over {self.transport}"


class Objection(StrEnum):
    """Why the drive does not take a command."""

    SENDER = "sender"
    STALE = "stale"
    SIZE = "size"
    FINITE = "finite"


@fact
class CommandRejected:
    """The drive did not take a command; the 1st, 2nd, 4th, 8th ... of a kind is an event."""

    kind: ClassVar[str] = "rejected"
    level: ClassVar[Level] = Level.WARNING
    reason: Objection | None = None
    count: Count = 1  # of this reason so far
    controller: Text = ""
    detail: Text = ""  # for people

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"effort command rejected ({self.reason}): {self.detail}; {self.count} so far"


@fact
class SecondPlant:
    """Another plant has come onto this bench."""

    kind: ClassVar[str] = "rival"
    level: ClassVar[Level] = Level.WARNING
    node: Text = ""

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"a second plant has joined this bench and must exit: {self.node}"
