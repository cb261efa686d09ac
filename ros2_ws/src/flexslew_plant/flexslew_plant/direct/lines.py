"""The plant's ends of all lines."""

from collections import OrderedDict
from collections.abc import Callable, Iterator
from typing import TypeAlias

from flexslew_plant.bench.wire import command_from
from flexslew_plant.direct.line import DirectLine, facts
from flexslew_plant.direct.reception import ListenerSocket
from flexslew_plant.errors import BadInput
from flexslew_plant.graph.topics import LOOP_DEPTH
from flexslew_plant.measurement import EffortCommand
from flexslew_plant.message_codec import HEAD

Key: TypeAlias = tuple[int, int]  # epoch and tick

CALLER, ANSWERS = "controller", "answers"  # facts of a caller: its name, that it has started
EPOCH, TICK = "epoch", "tick"  # facts of the plant: the newest question before the line


class Lines:
    """Takes the calls of controllers, one line for each name.

    A caller sends its name, and gets the key of the question that is out: it receives all later
    ones on the line. When that question has reached it over DDS, it sends that it answers here.

    Args:
        address: socket address to listen on.
        newest: returns epoch and tick of the question that is out.
    """

    def __init__(self, address: bytes, newest: Callable[[], Key]) -> None:
        self._newest, self._listener = newest, ListenerSocket(address)
        self._lines: dict[str, DirectLine] = {}
        # as many as DDS would keep, the oldest first; a dict is slow at letting go of that one
        self._recent_commands: OrderedDict[bytes, None] = OrderedDict()
        self.answering: set[str] = set()  # the controllers that answer on their lines

    def look(self) -> None:
        """Take calls, and remove the lines that the callers have closed."""
        for name in [name for name, line in self._lines.items() if line.closed]:
            del self._lines[name]
            self.answering.discard(name)
        for line in self._lines.values():
            line.flush()
        for line, request in self._listener.callers():
            self._accept(line, request.get(CALLER))

    def send(self, named: str, question: bytes, eager: bool) -> None:
        """Send a question: first to the controller that must answer, then to the observers.

        Args:
            named: name of the controller that must answer.
            question: the question as it goes over DDS.
            eager: wait awake for the answer.
        """
        first = self._lines.get(named)
        if first is not None:
            first.eager = eager
            first.send(question)
        for line in self._lines.values():
            if line is not first:
                line.send(question)

    def answer(self, name: str, wait: float) -> EffortCommand | None:
        """Return the next answer of a controller, see DirectLine.receive; None: none yet."""
        data = self._lines[name].receive(wait)
        return None if data is None else self._decode(name, data)

    def received(self) -> Iterator[EffortCommand]:
        """Yield all answers that wait."""
        for name, line in self._lines.items():
            while (data := line.receive()) is not None:
                command = self._decode(name, data)
                if command is not None:
                    yield command

    def _decode(self, name: str, data: bytes) -> EffortCommand | None:
        """Return an answer; None: it is something else, after which there may be no line."""
        try:
            if data[:4] == HEAD:
                command = command_from(data)
                self._recent_commands[data] = None
                if len(self._recent_commands) > LOOP_DEPTH:
                    self._recent_commands.popitem(last=False)
                return command
        except BadInput:
            pass
        if facts(data).get(ANSWERS) is True:
            self.answering.add(name)
        else:
            self._lines[name].close()
        return None

    def copied(self, data: bytes) -> bool:
        """Return whether an answer came on a line before."""
        return data in self._recent_commands

    @property
    def handshake_pending(self) -> bool:
        """Whether a caller has called and does not answer on its line yet."""
        return self._listener.handshake_pending or len(self.answering) < len(self._lines)

    def _accept(self, line: DirectLine, name: object) -> None:
        """Send a caller of this name the newest question's key; it gets all later ones here."""
        if not isinstance(name, str) or not name or name in self._lines:
            line.close()  # of two with one name the older one keeps its line
            return
        epoch, tick = self._newest()
        line.notify({EPOCH: epoch, TICK: tick})
        self._lines[name] = line
