"""Leaves statuses out of a log: those of controllers with a name that belongs to another one."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.messages import cdr
from flexslew_plant.bench.operation.presence import Heartbeats
from flexslew_plant.errors import BadInput

_STATUS = "/controller_status"


class _StoredStatus(NamedTuple):
    since: float  # [wall s]
    name: str
    instance: int
    data: bytes  # CDR


class StatusFilter:
    """Admits statuses of the controller that owns its name, and all messages on other topics.

    A restarted controller sends while its predecessor still counts as alive: its messages wait
    until that one is silent, or lives on.

    Args:
        presence: signs of life.
    """

    def __init__(self, presence: Heartbeats) -> None:
        self._presence = presence
        self._stored: list[_StoredStatus] = []

    def filter_messages(
        self, messages: Iterable[tuple[str, bytes]], now: float, last: bool = False
    ) -> Iterator[tuple[str, bytes]]:
        """Yield topic and CDR of what is let in.

        Args:
            messages: topic and CDR.
            now: [wall s].
            last: nothing will come any more, no signs of life either.
        """
        stored, self._stored = self._stored, []
        for one in stored:
            if last or self._presence.counts(one.name, one.instance, now):
                yield _STATUS, one.data
            elif not self._presence.has_later_heartbeat(one.name, one.instance, one.since, now):
                self._stored.append(one)
        for topic, data in messages:
            status = _status(now, data) if topic == _STATUS else None
            if status is None or self._presence.counts(status.name, status.instance, now):
                yield topic, data
            else:
                self._stored.append(status)


def _status(now: float, data: bytes) -> _StoredStatus | None:
    try:
        status = cdr.decode(TOPICS[_STATUS].type, data)
    except BadInput:
        return None  # left out later, with a word
    return _StoredStatus(now, status.controller, status.instance, data)
