"""A publisher that sends to the recorder on a direct line and to all other listeners over DDS."""

import os
from collections.abc import Callable
from typing import Any

from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message

from flexslew_plant.direct.inbox import DDS_FLAG

_CPU_COUNT = len(os.sched_getaffinity(0))  # of this process
_BUSY_CPU_COUNT = 2  # of the processors are taken while plant and controller wait awake


class LoopCounter:
    """How often the loop of a node has turned; within one turn the listeners count as constant."""

    def __init__(self) -> None:
        self.count = 0


class DirectPublisher:
    """A publisher of one topic.

    Args:
        publisher: the publisher over DDS.
        add: appends number and CDR to the message to the recorder; returns whether they fit.
        loop_counter: turns of the loop; None: the listeners are counted at each call.

    Attributes:
        number: number of the topic on the line to the recorder; -1: it is not on that line.
        recorder_only: the recorder had the only subscription at the last check.
    """

    def __init__(
        self,
        publisher: "Publisher[Any]",
        add: Callable[[int, bytes], bool] = lambda number, data: False,
        loop_counter: LoopCounter | None = None,
    ) -> None:
        self.publisher, self._handle, self._add = publisher, publisher.handle, add
        self.number, self.recorder_only = -1, False
        self._loop_counter = loop_counter
        self._count_cycle: int | None = None  # turn of the last count
        self._count = 0  # subscriptions counted then

    @property
    def count(self) -> int:
        """How many subscriptions DDS serves, counted once per turn of the loop."""
        cycle = None if self._loop_counter is None else self._loop_counter.count
        if cycle is None or cycle != self._count_cycle:
            self._count_cycle = cycle
            self._count = int(self._handle.get_subscription_count())  # quicker than the publisher's
        return self._count

    @property
    def received(self) -> bool:
        """Whether there is any listener."""
        if self.number >= 0:
            return True
        known = self._loop_counter is not None and self._loop_counter.count == self._count_cycle
        return (self._count if known else self.count) > 0

    @property
    def shared(self) -> bool:
        """Whether there is a listener over DDS other than the recorder on its line."""
        count = self.count
        return count > 0 and (count > 1 or self.number < 0 or not self.recorder_only)

    def can_busy_wait(self, cpu_count: int = _CPU_COUNT) -> bool:
        """Return whether plant and controller may wait awake, which takes two processors.

        A recorder that receives copies on its line needs one; other listeners may need any number.
        """
        return not self.received or (cpu_count > _BUSY_CPU_COUNT and not self.shared)

    def publish(self, data: bytes) -> None:
        """Send CDR bytes to all listeners; nothing is kept for later ones."""
        number, shared = self.number, self.shared
        if number >= 0 and not self._add(number + DDS_FLAG * shared, data):
            shared = True  # too large
        if shared:
            self._handle.publish_raw(data)

    def keep(self, message: Any) -> None:
        """Publish a message of a latched topic, which DDS keeps for later ones."""
        data = serialize_message(message)
        if self.number >= 0:
            self._add(self.number + DDS_FLAG, data)
        self._handle.publish_raw(data)
