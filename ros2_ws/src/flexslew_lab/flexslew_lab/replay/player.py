"""What of a bag is due at which wall time: order, rate, pause, step, seek, loop; without ROS."""

from collections.abc import Collection, Iterator, Mapping
from itertools import takewhile
from math import inf
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

from flexslew_lab.log.bag_index import BagIndex
from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.bag_reader import BagMessage
from flexslew_lab.log.messages import cdr
from flexslew_plant.errors import BadInput
from flexslew_plant.graph.graph_names import require_name
from flexslew_plant.settings import NonNegative, Positive, section

CLOCK = "/clock"
_stamp = attrgetter("stamp")


@section
class PlaySettings:
    """How a bag is played."""

    bag: str = ""  # its folder or file
    rate: NonNegative = 1.0  # simulated seconds per wall second; 0: as fast as possible
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

    Messages come in the order of the bag. After a start or a jump the latched messages that hold
    there (plan, testbed, events, ...) come first, in a pause, too: a subscriber then has the same
    state as in the run.

    Args:
        settings: how to play.

    Raises:
        BadInput: no such bag, an unknown topic, an invalid remapping, a start after the end.
    """

    def __init__(self, settings: PlaySettings) -> None:
        self.settings = settings
        self._bag = bag = BagIndex(Path(settings.bag))
        self.first, self.last = bag.first, bag.last
        self.period = 0.01  # [s]
        for testbed in bag.stored_messages("/testbed", bag.last + 1):
            self.period = float(cdr.decode(testbed.type, testbed.data).period)
        start = round(settings.start * 1e9)
        if start > self.last:
            end = self.last * 1e-9
            raise BadInput(f"--start: {settings.start} s is after the end of the bag, {end:g} s")
        self._start = start
        self._end = start + settings.duration * 1e9 if settings.duration else inf
        self._types = bag.types
        self._selected_topics = _select_topics(settings.topics, self._types, str(self._bag.path))
        if settings.clock:
            self._selected_topics -= {CLOCK}
        self._names = _new_names(settings.remap, self._types)
        self._latched = {t for t in self._selected_topics if t in TOPICS and TOPICS[t].latched}
        for topic, new in self._names.items():
            kind = self._types.get(new, self._types[topic])
            if new in self._selected_topics - {*self._names} and kind != self._types[topic]:
                raise BadInput(f"--remap: {new} is a {kind}, {topic} a {self._types[topic]}")
        self.paused = settings.paused
        self.iterations = 0  # times the end was reached
        self._time_origin: tuple[float, float] | None = None  # wall time and simulated time [s, ns]
        self._initial_messages: list[Outgoing] = []  # latched, due at once
        self._next: BagMessage | None = None
        self._go_to(start)

    @property
    def topics(self) -> dict[str, str]:
        """Types of what will be published, by the names after remapping."""
        return {self._names.get(t, t): self._types[t] for t in sorted(self._selected_topics)}

    @property
    def latched(self) -> set[str]:
        """The names, after remapping, with last messages that a late subscriber must get."""
        return {self._names.get(t, t) for t in self._latched}

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
        self.paused, self._time_origin = False, None

    def pause(self) -> None:
        """Hold the position."""
        self.paused = True

    def seek(self, time: float) -> float:
        """Move to a simulated time [s]; return the time of the next message [s].

        Raises:
            BadInput: if the time is outside of the played part, or the bag is damaged there; the
                player is then unchanged.
        """
        stamp, end = round(time * 1e9), min(self.last, self._end)
        if not self.first <= stamp <= end:
            raise BadInput(
                f"{time:g} s is outside of the bag, which is played from {self.first * 1e-9:g} s "
                f"to {end * 1e-9:g} s"
            )
        self._go_to(stamp)
        return self.time

    def step(self, until: float) -> list[Outgoing]:
        """Return everything before a simulated time [s] at once, whether paused or not."""
        self._time_origin = None
        return [*self._take_initial_messages(), *self._before(round(until * 1e9), 1 << 62)]

    def due(self, now: float, most: int = 1000) -> list[Outgoing]:
        """Return what is due by now, at most so many messages and what is latched.

        Args:
            now: wall clock [s].
            most: so that listeners keep up.
        """
        if self.paused:
            return self._take_initial_messages()
        if self._next is None and self.settings.loop:
            self.iterations += 1
            self._go_to(self._start)
        return [*self._take_initial_messages(), *self._before(self.simulated(now), most)]

    def simulated(self, now: float) -> float:
        """Return the simulated time at the wall time now [ns]."""
        if self._next is None:
            return min(self._end, self.last)
        if self.settings.rate == 0.0:
            return inf
        if self._time_origin is None or self.paused:
            self._time_origin = now, float(self._next.stamp)
        origin, simulated = self._time_origin
        return simulated + (now - origin) * self.settings.rate * 1e9

    def wait(self, now: float) -> float:
        """Return the wall seconds until something is due."""
        if self._initial_messages:
            return 0.0
        if self.paused or self.done:
            return inf
        if self._next is None or self.settings.rate == 0.0:
            return 0.0
        remaining = self._next.stamp - self.simulated(now)
        return max(0.0, remaining * 1e-9 / self.settings.rate)

    def _before(self, limit: float, most: int) -> Iterator[Outgoing]:
        """Yield the messages up to a log time [ns]."""
        while self._next is not None and self._next.stamp <= limit and most > 0:
            message = self._next
            self._next = next(self._messages, None)
            most -= 1
            yield self._outgoing(message)

    def _outgoing(self, message: BagMessage) -> Outgoing:
        topic, kind, stamp, _, data = message
        return Outgoing(self._names.get(topic, topic), kind, stamp, data)

    def _take_initial_messages(self) -> list[Outgoing]:
        initial, self._initial_messages = self._initial_messages, []
        return initial

    def _go_to(self, stamp: int) -> None:
        """Read at the new place first, so that a damage there changes nothing."""
        initial = sorted(
            (m for t in self._latched for m in self._bag.stored_messages(t, stamp)), key=_stamp
        )
        messages = self._from(stamp)
        self._next, self._messages, self._time_origin = next(messages, None), messages, None
        self._initial_messages = [self._outgoing(message) for message in initial]

    def _from(self, stamp: int) -> Iterator[BagMessage]:
        return takewhile(
            lambda m: m.stamp <= self._end, self._bag.messages(self._selected_topics, stamp)
        )


def _select_topics(requested: Collection[str], types: Mapping[str, str], path: str) -> set[str]:
    """Return the topics to play."""
    names = [name if name.startswith("/") else f"/{name}" for name in requested]
    for name in names:
        if name not in types:
            raise BadInput(f"no topic {name}; it has {', '.join(sorted(types))}", path)
    return set(names or types)


def _new_names(rules: Collection[str], types: Mapping[str, str]) -> dict[str, str]:
    """Return new names by old ones."""
    names = {}
    for rule in rules:
        old, sign, new = rule.partition(":=")
        if not (old and sign and new):
            raise BadInput(f"--remap: {rule!r} is not of the form old:=new")
        old, new = (name if name.startswith("/") else f"/{name}" for name in (old, new))
        if old not in types:
            raise BadInput(f"--remap: no topic {old}; the bag has {', '.join(sorted(types))}")
        require_name(new, "--remap")
        names[old] = new
    return names
