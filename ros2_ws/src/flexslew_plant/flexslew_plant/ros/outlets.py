"""Publishers whose messages go to the recorder past DDS, and to everybody else over it."""

import os
from math import inf
from time import monotonic, sleep

from rclpy.node import Node

from flexslew_plant.direct.inbox import BOTH, HEARD, NAMESPACE, NODE, PART, TOPICS, split
from flexslew_plant.direct.line import LARGEST, DirectLine, call, facts
from flexslew_plant.direct.names import RECORDER, address, direct
from flexslew_plant.graph import topics
from flexslew_plant.graph.topics import LOOP_DEPTH
from flexslew_plant.ros.offers import publisher
from flexslew_plant.ros.outlet import Outlet, Turns

_AGAIN = 0.2  # until the recorder is called again [wall s]
_LOOK = 0.1  # who else listens [wall s]
_KEPT = 16 * LOOP_DEPTH  # for a recorder that is held up; the plant waits for it long before
_TOGETHER = 1 << 13  # sent at once while ticks follow each other, a few of them [B]
_LEAVING = 5.0  # for a recorder that takes nothing [wall s]


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
        self._turns = Turns()
        self._offers: list[Outlet] = []
        self._heard: list[Outlet] = []  # by the recorder on the line, by their numbers
        self._parts: list[bytes] = []  # of the next message on the line
        self._size = 0  # of these [B]
        self._line: DirectLine | None = None
        self._listens = "", ""  # for the recorder over DDS: a node and its namespace
        self._next = 0.0  # call or look [wall s]

    def publisher(self, name: str) -> Outlet:
        """Return a publisher of a topic of the table."""
        self._offers.append(Outlet(publisher(self._node, name), self._add, self._turns))
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

    def turn(self) -> None:
        """Ask DDS anew who listens: the loop turns, or somebody waits for just that."""
        self._turns.count += 1

    def send(self) -> None:
        """Send what was published since the last time: the loop does before it waits."""
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
        if self._size > _TOGETHER:
            self.send()
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
