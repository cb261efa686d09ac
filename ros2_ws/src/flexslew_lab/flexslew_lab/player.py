"""What of a bag is due at which wall time: order, rate, pause, step, seek, loop; without ROS."""

from collections.abc import Collection, Iterator, Mapping
from math import inf
from pathlib import Path
from typing import NamedTuple

from flexslew_lab.bag_layout import TOPICS
from flexslew_lab.bag_reader import BagMessage, BagReader
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import NonNegative, Positive, section

CLOCK = "/clock"


@section
class PlaySettings:
    """How a bag is played."""

    bag: str = ""  # its folder or file
    rate: NonNegative = 1.0  # simulated seconds per wall second; 0: as fast as it goes
    start: NonNegative = 0.0  # simulated time to begin at [s]
    duration: Positive | None = None  # simulated [s]; null: to the end
    loop: bool = False  # begin again at the end
    topics: tuple[str, ...] = ()  # only these; none: all
    remap: tuple[str, ...] = ()  # old:=new
    clock: NonNegative = 0.0  # own /clock instead of the recorded one [1/wall s]; 0: the recorded
    paused: bool = False  # wait for resume
    wait_for: tuple[str, ...] = ()  # nodes that must listen before the first message


class Outgoing(NamedTuple):
    """A message on its way out."""

    topic: str  # after remapping
    type: str
    stamp: int  # log time, simulated [ns]
    data: bytes  # CDR, as recorded


class Player:
    """A position in a bag that moves with the wall clock, which its caller reads.

    Messages come in the order of the bag. What is latched and lies before the start (plan,
    testbed, events, ...) comes first, so that a listener knows what it would have known.

    Args:
        settings: how to play.

    Raises:
        BadInput: no such bag, an unknown topic, a remapping that is none, a start behind the end.
    """

    def __init__(self, settings: PlaySettings) -> None:
        self.settings = settings
        self._bag = BagReader(Path(settings.bag))
        overview = self._bag.overview
        self.first, self.last = overview.first, overview.last
        self.period = 0.01 if overview.testbed is None else float(overview.testbed.period)
        start = round(settings.start * 1e9)
        if start > self.last:
            end = self.last * 1e-9
            raise BadInput(f"--start: {settings.start} s is behind the end of the bag, {end:g} s")
        self._start = start
        self._end = start + settings.duration * 1e9 if settings.duration else inf
        self._types = dict(overview.types)
        self._chosen = _chosen(settings.topics, self._types, str(self._bag.path))
        if settings.clock:
            self._chosen -= {CLOCK}
        self._names = _remapped(settings.remap, self._types)
        self.paused = settings.paused
        self.rounds = 0  # how often the end was met
        self._anchor: tuple[float, float] | None = None  # wall time and simulated time [s, ns]
        self._next: BagMessage | None = None
        self._go_to(start)

    @property
    def topics(self) -> dict[str, str]:
        """Types of what will be published, by the names after remapping."""
        return {self._names.get(t, t): self._types[t] for t in sorted(self._chosen)}

    @property
    def time(self) -> float:
        """Simulated time of the next message, or of the end [s]."""
        return (self._next.stamp if self._next else min(self._end, self.last)) * 1e-9

    @property
    def done(self) -> bool:
        """Nothing will be due any more."""
        return self._next is None and not self.settings.loop

    def resume(self) -> None:
        """Go on from here; what was missed in a pause is not caught up."""
        self.paused, self._anchor = False, None

    def pause(self) -> None:
        """Hold the position."""
        self.paused = True

    def seek(self, time: float) -> float:
        """Move to a simulated time; return where the next message lies [s].

        Args:
            time: [s]; one before the first or behind the last message becomes that.
        """
        self._go_to(min(max(round(time * 1e9), self.first), self.last))
        return self.time

    def step(self, until: float) -> list[Outgoing]:
        """Return everything before a simulated time [s] at once, whether paused or not."""
        self._anchor = None
        return list(self._before(round(until * 1e9), 1 << 62))

    def due(self, now: float, most: int = 1000) -> list[Outgoing]:
        """Return what is due by now, at most so many messages.

        Args:
            now: wall clock [s].
            most: keeps listeners from drowning.
        """
        if self.paused:
            return []
        if self._next is None and self.settings.loop:
            self.rounds += 1
            self._go_to(self._start)
        return list(self._before(self.simulated(now), most))

    def simulated(self, now: float) -> float:
        """Return the simulated time at the wall time now [ns]."""
        if self._next is None:
            return min(self._end, self.last)
        if self.settings.rate == 0.0:
            return inf
        if self._anchor is None or self.paused:
            self._anchor = now, float(self._next.stamp)
        wall, simulated = self._anchor
        return simulated + (now - wall) * self.settings.rate * 1e9

    def wait(self, now: float) -> float:
        """Return the wall seconds until something is due."""
        if self.paused or self.done:
            return inf
        if self._next is None or self.settings.rate == 0.0:
            return 0.0
        ahead = self._next.stamp - self.simulated(now)
        return max(0.0, ahead * 1e-9 / self.settings.rate)

    def _before(self, limit: float, most: int) -> Iterator[Outgoing]:
        """Yield the messages up to a log time [ns]."""
        while self._next is not None and self._next.stamp <= limit and most > 0:
            m = self._next
            self._next = next(self._messages, None)
            most -= 1
            yield Outgoing(self._names.get(m.topic, m.topic), m.type, m.stamp, m.data)

    def _go_to(self, stamp: int) -> None:
        self._anchor = None
        self._messages = self._from(stamp)
        self._next = next(self._messages, None)

    def _from(self, stamp: int) -> Iterator[BagMessage]:
        """Yield from a log time on, what is latched from the beginning of the bag on."""
        latched = {topic for topic in self._chosen if topic in TOPICS and TOPICS[topic].latched}
        for message in self._bag.messages(self._chosen):
            if message.stamp > self._end:
                return
            if message.stamp >= stamp:
                yield message
            elif message.topic in latched:
                yield message._replace(stamp=stamp)


def _chosen(wanted: Collection[str], types: Mapping[str, str], path: str) -> set[str]:
    """Return the topics to play."""
    names = [name if name.startswith("/") else f"/{name}" for name in wanted]
    for name in names:
        if name not in types:
            raise BadInput(f"{path}: no topic {name}; it has {', '.join(sorted(types))}")
    return set(names or types)


def _remapped(rules: Collection[str], types: Mapping[str, str]) -> dict[str, str]:
    """Return new names by old ones."""
    names = {}
    for rule in rules:
        old, sign, new = rule.partition(":=")
        if not (old and sign and new):
            raise BadInput(f"--remap: {rule!r} is not of the form old:=new")
        old, new = (name if name.startswith("/") else f"/{name}" for name in (old, new))
        if old not in types:
            raise BadInput(f"--remap: no topic {old}; the bag has {', '.join(sorted(types))}")
        names[old] = new
    return names
