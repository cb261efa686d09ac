"""The statuses of the controllers, of which those count that have their name by right."""

from collections.abc import Callable
from time import monotonic
from typing import Any

from flexslew_msgs import msg

from flexslew_plant.bench.operation.presence import BEAT_EVERY, Presence


class Statuses:
    """Passes on what the oldest of a name says that is alive; what others say waits until they are.

    One that was started again may be heard while its predecessor still counts as alive, and a plant
    that comes late hears of both before their signs of life.

    Args:
        presence: signs of life.
        take: takes a status that counts.

    Attributes:
        counted: the last one that counts of each name.
    """

    def __init__(self, presence: Presence, take: Callable[[msg.ControllerStatus], None]) -> None:
        self._presence, self._take = presence, take
        self._heard: dict[str, dict[int, Any]] = {}  # the last of each instance, by name
        self.counted: dict[str, msg.ControllerStatus] = {}
        self._next = 0.0  # [wall s]

    def hear(self, status: msg.ControllerStatus) -> None:
        """Take a status, of whomever."""
        self._heard.setdefault(status.controller, {})[status.instance] = status
        if self._presence.counts(status.controller, status.instance, monotonic()):
            self._count(status)

    def poll(self, now: float) -> None:
        """Let count, of names that several have used, what the one says whose it is by now."""
        if now < self._next:
            return
        self._next = now + BEAT_EVERY / 2
        for name, heard in self._heard.items():
            first = self._presence.alive(now).get(name) if {*heard} - {0} else None
            status = heard.get(first.instance) if first is not None else None
            if status is not None and status is not self.counted.get(name):
                self._count(status)

    def _count(self, status: msg.ControllerStatus) -> None:
        self.counted[status.controller] = status
        self._take(status)
