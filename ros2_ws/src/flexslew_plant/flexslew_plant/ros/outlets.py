"""Publishers whose messages go to the recorder past DDS, and to everybody else over it."""

import os
from collections.abc import Callable
from math import inf
from time import monotonic, sleep
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message

from flexslew_plant import topics
from flexslew_plant.direct.inbox import BOTH, HEARD, NAMESPACE, NODE, PART, TOPICS, split
from flexslew_plant.direct.line import LARGEST, DirectLine, call, facts
from flexslew_plant.direct.names import RECORDER, address, direct
from flexslew_plant.ros.offers import publisher
from flexslew_plant.topics import LOOP_DEPTH

_AGAIN = 0.2  # until the recorder is called again [wall s]
_LOOK = 0.1  # who else listens [wall s]
_KEPT = 16 * LOOP_DEPTH  # for a recorder that is held up; the plant waits for it long before
_LEAVING = 5.0  # for a recorder that takes nothing [wall s]
PROCESSORS = len(os.sched_getaffinity(0))  # of this process
_AWAKE = 2  # of them are taken while plant and controller wait awake


class Outlets:
    """Calls the recorder of the bench until it answers; what is published then goes to it directly.

    The recorder hears over DDS as well. Nothing is published there for its sake alone.

    Args:
        node: that publishes.
    """

    def __init__(self, node: Node) -> None:
        self._node, self._direct = node, direct(os.environ)
        questions = node.resolve_topic_name(topics.MEASUREMENT)
        self._address = address(node.context.get_domain_id(), questions, RECORDER)
        self._offers: list[Outlet] = []
        self._heard: list[Outlet] = []  # by the recorder on the line, by their numbers
        self._parts: list[bytes] = []  # of the next message on the line
        self._size = 0  # of these [B]
        self._line: DirectLine | None = None
        self._listens = "", ""  # for the recorder over DDS: a node and its namespace
        self._next = 0.0  # call or look [wall s]

    def publisher(self, name: str) -> "Outlet":
        """Return a publisher of a topic of the table."""
        self._offers.append(Outlet(publisher(self._node, name), self._add))
        return self._offers[-1]

    def look(self, now: float) -> None:
        """Call, or look who else listens, if it is time [wall s]."""
        line = self._line
        if line is None:
            if self._direct and now >= self._next:
                self._next = now + _AGAIN
                self._line = call(self._address, _KEPT)
                if self._line is not None:
                    names = [offer.publisher.topic_name for offer in self._offers]
                    self._line.say({TOPICS: names})
        elif line.closed:
            self._let_go()
        elif not self._listens[0]:
            self._begin(line)
        else:
            self.send()
            line.flush()
            if now >= self._next:
                self._next = now + _LOOK
                line.receive()  # which tells when the recorder is gone
                self._choose()

    def send(self) -> None:
        """Send what was published since the last time."""
        if self._parts:
            message = b"".join(self._parts)
            self._parts.clear()
            self._size = 0
            if self._line is not None:
                self._line.send(message)
                if self._line.closed:
                    self._send_over_dds(message)

    def close(self) -> None:
        """Stay until the recorder has taken everything."""
        self.send()
        line, unsent, until = self._line, inf, monotonic() + _LEAVING
        while line is not None and line.unsent and monotonic() < until:
            if line.unsent < unsent:
                unsent, until = line.unsent, monotonic() + _LEAVING
            line.flush()
            sleep(0.001)

    def _add(self, number: int, data: bytes) -> bool:
        """Publish a part with the next message; return False if it is too large for one."""
        data += bytes(-len(data) % 4)  # as DDS does: both copies are the same bytes
        size = PART.size + len(data)
        if size > LARGEST:
            return False
        if self._size + size > LARGEST:
            self.send()
        self._parts += (PART.pack(number, len(data)), data)
        self._size += size
        return True

    def _begin(self, line: DirectLine) -> None:
        """Learn which topics the recorder hears."""
        data = line.receive()
        if data is None:
            return
        said, by_name = facts(data), {offer.publisher.topic_name: offer for offer in self._offers}
        heard, node, place = said.get(HEARD), said.get(NODE), said.get(NAMESPACE)
        known = isinstance(heard, list) and all(str(name) in by_name for name in heard)
        if not (known and isinstance(node, str) and isinstance(place, str)):
            line.close()
            return
        self._listens, self._next = (node, place), 0.0
        self._heard = [by_name[str(name)] for name in heard or ()]
        for number, offer in enumerate(self._heard):
            offer.number = number

    def _let_go(self) -> None:
        """The recorder is gone, or this is none."""
        self._line, self._listens, self._heard = None, ("", ""), []
        for offer in self._offers:
            offer.number = -1

    def _send_over_dds(self, message: bytes) -> None:
        """Publish what has not gone there: a recorder that follows a lost one hears it."""
        heard = self._heard
        self._let_go()
        for number, data in split(message):
            if number < BOTH:
                heard[number].publish(data)

    def _choose(self) -> None:
        for offer in self._heard:
            if not offer.shared:
                continue
            infos = self._node.get_subscriptions_info_by_topic(offer.publisher.topic_name)
            listening = [(info.node_name, info.node_namespace) for info in infos]
            offer.recorder_alone = listening == [self._listens]


class Outlet:
    """A publisher of one topic.

    Args:
        publisher: over DDS.
        add: to what goes to the recorder: number and CDR; returns whether it fits.

    Attributes:
        number: of the topic on the line to the recorder; -1: it is not heard there.
        recorder_alone: when it was looked at, the one subscription was the recorder's.
    """

    def __init__(
        self,
        publisher: "Publisher[Any]",
        add: Callable[[int, bytes], bool] = lambda number, data: False,
    ) -> None:
        self.publisher, self._handle, self._add = publisher, publisher.handle, add
        self.number, self.recorder_alone = -1, False

    @property
    def count(self) -> int:
        """How many subscriptions DDS serves; every tick asks, so by the handle: that is quicker."""
        return int(self._handle.get_subscription_count())

    @property
    def heard(self) -> bool:
        """Anybody listens."""
        return self.number >= 0 or self.count > 0

    @property
    def shared(self) -> bool:
        """Somebody listens over DDS who is not the recorder on its line."""
        count = self.count
        return count > 1 or (count == 1 and not (self.number >= 0 and self.recorder_alone))

    def leaves(self, processors: int) -> bool:
        """Return whether who hears copies can do without two of these processors.

        A recorder that hears them past DDS needs one, anybody else more than can be told.
        """
        return not self.heard or (processors > _AWAKE and not self.shared)

    def publish(self, data: bytes) -> None:
        """Send CDR bytes to all who listen; nothing is kept for later ones."""
        number, shared = self.number, self.shared
        if number >= 0 and not self._add(number + BOTH * shared, data):
            shared = True  # too large
        if shared:
            self._handle.publish_raw(data)

    def publish_if_heard(self, message: Callable[[], bytes]) -> None:
        """Write and publish a message where somebody listens."""
        if self.heard:
            self.publish(message())

    def keep(self, message: Any) -> None:
        """Publish a message of a latched topic, which DDS keeps for later ones."""
        data = serialize_message(message)
        if self.number >= 0:
            self._add(self.number + BOTH, data)
        self._handle.publish_raw(data)
