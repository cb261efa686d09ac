"""A publisher that sends to the recorder on a direct line and to all other listeners over DDS."""

import os
from collections.abc import Callable
from typing import Any

from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message

from flexslew_plant.direct.inbox import BOTH

_PROCESSORS = len(os.sched_getaffinity(0))  # of this process
_AWAKE = 2  # of the processors are taken while plant and controller wait awake


class Turns:
    """How often the loop of a node has turned; within one turn the listeners count as constant."""

    def __init__(self) -> None:
        self.count = 0


class Outlet:
    """A publisher of one topic.

    Args:
        publisher: the publisher over DDS.
        add: appends number and CDR to the message to the recorder; returns whether they fit.
        turns: turns of the loop; None: the listeners are counted at each call.

    Attributes:
        number: number of the topic on the line to the recorder; -1: it is not on that line.
        recorder_alone: the recorder had the only subscription at the last check.
    """

    def __init__(
        self,
        publisher: "Publisher[Any]",
        add: Callable[[int, bytes], bool] = lambda number, data: False,
        turns: Turns | None = None,
    ) -> None:
        self.publisher, self._handle, self._add = publisher, publisher.handle, add
        self.number, self.recorder_alone = -1, False
        self._turns = turns
        self._asked: int | None = None  # turn of the last count
        self._count = 0  # subscriptions counted then

    @property
    def count(self) -> int:
        """How many subscriptions DDS serves, counted once per turn of the loop."""
        turn = None if self._turns is None else self._turns.count
        if turn is None or turn != self._asked:
            self._asked = turn
            self._count = int(self._handle.get_subscription_count())  # quicker than the publisher's
        return self._count

    @property
    def heard(self) -> bool:
        """Whether there is any listener."""
        if self.number >= 0:
            return True
        known = self._turns is not None and self._turns.count == self._asked
        return (self._count if known else self.count) > 0

    @property
    def shared(self) -> bool:
        """Whether there is a listener over DDS other than the recorder on its line."""
        count = self.count
        return count > 0 and (count > 1 or self.number < 0 or not self.recorder_alone)

    def may_wait_awake(self, processors: int = _PROCESSORS) -> bool:
        """Return whether plant and controller may wait awake, which takes two processors.

        A recorder that receives copies on its line needs one; other listeners may need any number.
        """
        return not self.heard or (processors > _AWAKE and not self.shared)

    def publish(self, data: bytes) -> None:
        """Send CDR bytes to all listeners; nothing is kept for later ones."""
        number, shared = self.number, self.shared
        if number >= 0 and not self._add(number + BOTH * shared, data):
            shared = True  # too large
        if shared:
            self._handle.publish_raw(data)

    def keep(self, message: Any) -> None:
        """Publish a message of a latched topic, which DDS keeps for later ones."""
        data = serialize_message(message)
        if self.number >= 0:
            self._add(self.number + BOTH, data)
        self._handle.publish_raw(data)
