"""The statuses of the controllers, of which those count that have their name by right."""

from collections.abc import Callable
from time import monotonic
from typing import Any

from flexslew_msgs import msg

from flexslew_plant.bench.operation.presence import HEARTBEAT_PERIOD, Heartbeats


class StatusMonitor:
    """Passes on the status of the oldest live node of each name; keeps the others until then.

    A restarted node may be received while the previous one still counts as alive, and a plant
    that comes late receives both before their heartbeats.

    Args:
        heartbeats: heartbeats of all nodes.
        take: takes a status that counts.

    Attributes:
        counted: the last one that counts of each name.
    """

    def __init__(
        self, heartbeats: Heartbeats, take: Callable[[msg.ControllerStatus], None]
    ) -> None:
        self._heartbeats, self._take = heartbeats, take
        self._received: dict[str, dict[int, Any]] = {}  # the last of each instance, by name
        self.counted: dict[str, msg.ControllerStatus] = {}
        self._next = 0.0  # [wall s]

    def receive(self, status: msg.ControllerStatus) -> None:
        """Take a status of any node."""
        self._received.setdefault(status.controller, {})[status.instance] = status
        if self._heartbeats.counts(status.controller, status.instance, monotonic()):
            self._count(status)

    def poll(self, now: float) -> None:
        """Count, for names that several nodes have used, the status of the one that has it now."""
        if now < self._next:
            return
        self._next = now + HEARTBEAT_PERIOD / 2
        for name, received in self._received.items():
            first = self._heartbeats.alive(now).get(name) if {*received} - {0} else None
            status = received.get(first.instance) if first is not None else None
            if status is not None and status is not self.counted.get(name):
                self._count(status)

    def _count(self, status: msg.ControllerStatus) -> None:
        self.counted[status.controller] = status
        self._take(status)
