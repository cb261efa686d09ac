"""The ticks that a recorder still waits for: question received, but not yet all of its answer."""

from dataclasses import dataclass, field
from typing import Any

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.messages import cdr
from flexslew_plant.events import AnswerMissing, kind_of
from flexslew_plant.message_codec import leading

PATIENCE = 1.0  # that an answer is waited for [wall s]
_ANSWER_TOPICS = frozenset({"/effort_command", "/controller_state"})
TRACKED_TOPICS = _ANSWER_TOPICS | {"/measurement", "/events"}
_KEPT = 512  # ticks with a remembered end

Key = tuple[int, int]  # epoch and tick


@dataclass
class _Question:
    at: int  # simulated time [ns]
    controller: str  # controller that must answer
    since: float  # received at [wall s]
    missing: set[str] = field(default_factory=lambda: set(_ANSWER_TOPICS))


class OpenTicks:
    """Follows questions, answers and missed ticks.

    So a log cut at any moment lacks answers to its last questions only. A controller that never
    publishes its state is not waited for after the first time.
    """

    def __init__(self) -> None:
        self._open: dict[Key, _Question] = {}
        self._pending_topics: dict[
            tuple[Key, str], set[str]
        ] = {}  # answers that came before their question
        self._closed: dict[Key, str] = {}  # controller that has answered
        self._stateless: set[str] = set()

    def receive(self, epoch: int, at: int, topic: str, data: bytes, now: float) -> None:
        """Take a message.

        Args:
            epoch: to which it belongs.
            at: its simulated time in that epoch [ns].
            topic: absolute name, one of FOLLOWED.
            data: CDR.
            now: wall clock [s].

        Raises:
            BadInput: it is not of the topic's type.
            struct.error: the same.
        """
        if topic == "/events":
            event = cdr.decode("flexslew_msgs/msg/Event", data)
            if event.kind == kind_of(AnswerMissing):
                self._close((int(event.epoch), int(event.tick)))
            return
        key, name = _key_and_name(topic, data)
        if topic == "/measurement":
            self._add_question(key, at, name, now)
        else:
            self._answer(key, name, topic)

    def first(self, now: float) -> tuple[int, int] | None:
        """Return epoch and time [ns] of the first tick that is not whole yet; None: there is none.

        Args:
            now: wall clock [s]; what has been waited for long enough is given up.
        """
        for key, question in list(self._open.items()):
            if now - question.since <= PATIENCE:
                return key[0], question.at
            if question.missing == {"/controller_state"}:
                self._stateless.add(question.controller)
            self._close(key)
        return None

    def _add_question(self, key: Key, at: int, name: str, now: float) -> None:
        if not name or self._closed.get(key) == name:  # the brake needs no answer
            return
        known = self._open.get(key)
        if known is None or known.controller != name:
            question = _Question(at, name, known.since if known else now)
            question.missing -= self._pending_topics.pop((key, name), set())
            if name in self._stateless:
                question.missing.discard("/controller_state")
            self._open[key] = question
        if not self._open[key].missing:
            self._close(key)

    def _answer(self, key: Key, name: str, topic: str) -> None:
        if topic == "/controller_state":
            self._stateless.discard(name)
        question = self._open.get(key)
        if question is None or question.controller != name:
            if key not in self._closed:
                self._pending_topics.setdefault((key, name), set()).add(topic)
                _trim(self._pending_topics)
            return
        question.missing.discard(topic)
        if not question.missing:
            self._close(key)

    def _close(self, key: Key) -> None:
        question = self._open.pop(key, None)
        self._closed[key] = question.controller if question else ""
        _trim(self._closed)


def _trim(kept: dict[Any, Any]) -> None:
    """Forget the oldest entries."""
    while len(kept) > _KEPT:
        del kept[next(iter(kept))]


def _key_and_name(topic: str, data: bytes) -> tuple[Key, str]:
    """Return epoch and tick, and the controller, of a question or an answer."""
    head = leading(TOPICS[topic].type, "tick", "epoch", "controller")
    tick, epoch, length = head.unpack_from(data)
    name = data[head.size : head.size + length - 1]
    return (int(epoch), int(tick)), name.decode(errors="replace")
