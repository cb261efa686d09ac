"""One question, one answer over a serial line that loses, damages, repeats and delays frames.

The question is sent again until its answer comes or the time limit is over. The other end answers a
repeated question with the same bytes and does not compute again, so a lost frame costs a repeat
and nothing else. An answer counts only if its kind, epoch and tick are those of the question.

Each message follows the number of its session (uint32, little-endian), which an exchange draws and
the other end repeats: a frame of an earlier run on the line never counts.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from secrets import randbits
from struct import Struct
from time import monotonic
from typing import NamedTuple

from flexslew_plant.external.messages import (
    HEADER,
    Message,
    MessageKind,
    PlantFault,
    decoded,
    text_of,
)
from flexslew_plant.serial_line.frames import Deframer, framed
from flexslew_plant.serial_line.port import Port

LARGEST = 1 << 14  # of a frame [B]
SESSION = Struct("<I")


class Patience(NamedTuple):
    """How long the bench waits."""

    answer: float = 1.0  # for an answer; then the line counts as silent [wall s]
    repeat: float = 0.05  # for an answer before its question is sent again [wall s]


_PATIENCE = Patience()


@dataclass
class LineCount:
    """What has passed over a line."""

    questions: int = 0
    repeats: int = 0  # questions that were sent again
    damaged: int = 0  # frames with a wrong checksum
    stale: int = 0  # whole frames of other sessions or that answer no question that is open


class Exchange:
    """The bench's end of a line.

    Args:
        port: to the other end.
        patience: of each question.
        clock: returns the time, never backwards [wall s].
        session: its number, 32 bits; None: a random one.
    """

    def __init__(
        self,
        port: Port,
        patience: Patience = _PATIENCE,
        clock: Callable[[], float] = monotonic,
        session: int | None = None,
    ) -> None:
        self._port, self._clock = port, clock
        self._session = SESSION.pack(randbits(32) if session is None else session)
        self.patience, self.count = patience, LineCount()
        self._deframer, self._waiting = Deframer(LARGEST), deque[Message]()

    @property
    def name(self) -> str:
        """Name of the line, for errors."""
        return self._port.name

    def ask(self, question: bytes, kind: MessageKind, epoch: int, tick: int) -> Message:
        """Return the answer to a question.

        Args:
            question: a message.
            kind: of the answer.
            epoch: of the answer.
            tick: of the answer.

        Raises:
            PlantFault: no answer within the time limit, the other end reports that it cannot go on,
                or the port is gone.
        """
        self.count.questions += 1
        self.count.stale += len(self._waiting)
        self._waiting.clear()
        frame, wait = framed(self._session + question), self.patience
        end = self._clock() + wait.answer
        try:
            self._port.write(frame)
            again = self._clock() + wait.repeat
            while (now := self._clock()) < end:
                if now >= again:
                    self.count.repeats += 1
                    self._port.write(frame)
                    again = now + wait.repeat
                for message in self._received(min(again, end) - now):
                    if message[:3] == (kind, epoch, tick):
                        return message
                    if message.kind == MessageKind.ERROR and message[1:3] == question_key(question):
                        raise PlantFault(f"{self.name}: reports: {text_of(message.body)}")
                    self.count.stale += 1
        except OSError as error:
            raise self._line_fault(error) from None
        raise PlantFault(f"{self.name}: no answer within {wait.answer:g} s ({self._losses()})")

    def send(self, message: bytes) -> None:
        """Send a message without an answer.

        Raises:
            PlantFault: the line is gone.
        """
        try:
            self._port.write(framed(self._session + message))
        except OSError as error:
            raise self._line_fault(error) from None

    def receive(self, timeout: float) -> Message | None:
        """Return the next message; None: none has come within a time [wall s].

        Raises:
            PlantFault: the line is gone.
        """
        end = self._clock() + timeout
        try:
            while not self._waiting:
                left = end - self._clock()
                self._waiting += self._received(left)
                if left <= 0.0:
                    break
        except OSError as error:
            raise self._line_fault(error) from None
        return self._waiting.popleft() if self._waiting else None

    @property
    def timeout(self) -> float:
        """Time limit of an answer [wall s]."""
        return self.patience.answer

    def set_timeout(self, timeout: float) -> None:
        """Set the time limit of an answer [wall s]."""
        self.patience = self.patience._replace(answer=timeout)

    def close(self) -> int:
        """Give the port back; return 0: there is no process that could fail to end."""
        self._port.close()
        return 0

    def _received(self, timeout: float) -> list[Message]:
        """Return the whole messages that come within a time [wall s]."""
        whole = self._deframer.take(self._port.read(max(0.0, timeout)))
        self.count.damaged = self._deframer.damaged
        least, session = SESSION.size + HEADER.size, self._session
        counted = [data for data in whole if len(data) >= least and data.startswith(session)]
        self.count.stale += len(whole) - len(counted)
        return [decoded(data[SESSION.size :]) for data in counted]

    def _line_fault(self, error: OSError) -> PlantFault:
        return PlantFault(f"{self.name}: the line is gone ({error})")

    def _losses(self) -> str:
        count = self.count
        return f"{count.repeats} repeats, {count.damaged} damaged frames, {count.stale} stale ones"


def question_key(question: bytes) -> tuple[int, int]:
    """Return epoch and tick of a question."""
    return decoded(question)[1:3]
