"""The ticks that a recorder still waits for: question received, but not yet all of its answer."""

from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

from flexslew_lab.log.messages import cdr
from flexslew_plant.events import AnswerMissing, kind_of

PATIENCE = 1.0  # that an answer is waited for [wall s]
_COMMAND, _STATE = 1, 2  # bits of the two messages of an answer
ANSWER_BITS = {"/effort_command": _COMMAND, "/controller_state": _STATE}
_KEPT = 512  # ticks with a remembered end

Key = tuple[int, int]  # epoch and tick


@dataclass(slots=True)
class _Question:
    at: int  # simulated time [ns]
    controller: bytes  # controller that must answer
    since: float  # received at [wall s]
    missing: int = _COMMAND | _STATE


class OpenTicks:
    """Follows questions, answers and missed ticks.

    So a log cut at any moment lacks answers to its last questions only. A controller that never
    publishes its state is not waited for after the first time.
    """

    def __init__(self) -> None:
        self._open: dict[Key, _Question] = {}
        # answers that came before their question
        self._early = OrderedDict[tuple[Key, bytes], int]()
        self._closed = OrderedDict[Key, bytes]()  # controller that has answered
        self._stateless: set[bytes] = set()

    def receive_event(self, data: bytes) -> None:
        """Take an event: one that reports a missed tick closes it.

        Args:
            data: CDR.

        Raises:
            BadInput: it is no event.
        """
        event = cdr.decode("flexslew_msgs/msg/Event", data)
        if event.kind == kind_of(AnswerMissing):
            self._close((int(event.epoch), int(event.tick)))

    def first(self, now: float) -> tuple[int, int] | None:
        """Return epoch and time [ns] of the first tick that is not whole yet; None: there is none.

        Args:
            now: wall clock [s]; what has been waited for long enough is given up.
        """
        for key, question in list(self._open.items()):
            if now - question.since <= PATIENCE:
                return key[0], question.at
            if question.missing == _STATE:
                self._stateless.add(question.controller)
            self._close(key)
        return None

    def ask(self, key: Key, name: bytes, at: int, now: float) -> None:
        """Take a question.

        Args:
            key: its epoch and tick.
            name: controller that must answer.
            at: its simulated time in the epoch [ns].
            now: wall clock [s].
        """
        if not name or self._closed.get(key) == name:  # the brake needs no answer
            return
        known = self._open.get(key)
        if known is None or known.controller != name:
            question = _Question(at, name, known.since if known else now)
            if self._early:
                question.missing &= ~self._early.pop((key, name), 0)
            if name in self._stateless:
                question.missing &= ~_STATE
            self._open[key] = question
        if not self._open[key].missing:
            self._close(key)

    def answer(self, key: Key, name: bytes, bit: int) -> None:
        """Take an answer.

        Args:
            key: epoch and tick of its question.
            name: controller that answers.
            bit: of its topic, one of ANSWER_BITS.
        """
        if bit == _STATE:
            self._stateless.discard(name)
        question = self._open.get(key)
        if question is None or question.controller != name:
            if key not in self._closed:
                self._early[key, name] = self._early.get((key, name), 0) | bit
                _trim(self._early)
            return
        question.missing &= ~bit
        if not question.missing:
            self._close(key)

    def _close(self, key: Key) -> None:
        question = self._open.pop(key, None)
        self._closed[key] = question.controller if question else b""
        _trim(self._closed)


def _trim(kept: "OrderedDict[Any, Any]") -> None:
    """Forget the oldest entries."""
    while len(kept) > _KEPT:
        kept.popitem(last=False)
