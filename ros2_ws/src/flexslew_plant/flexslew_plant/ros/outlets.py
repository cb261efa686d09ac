"""Publishers that send to the recorder on a direct line and to all other listeners over DDS."""

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
_LOOK = 0.1  # between two checks for other listeners [wall s]
_KEPT = 16 * LOOP_DEPTH  # for a recorder that is held up; the plant waits for it long before that
_TOGETHER = 1 << 13  # sent at once while ticks follow each other, a few of them [B]
_LEAVING = 5.0  # for a recorder that takes nothing [wall s]


class Outlets:
    """Calls the recorder of the bench until it answers, and then sends messages to it directly.

    The recorder also subscribes over DDS. Nothing is published there for the recorder alone.

    Args:
        node: node that publishes.
    """

    def __init__(self, node: Node) -> None:
        self._node, self._direct = node, direct(os.environ)
        questions = node.resolve_topic_name(topics.MEASUREMENT)
        self._address = address(node.context.get_domain_id(), questions, RECORDER)
        self._turns = Turns()
        self._offers: list[Outlet] = []
        self._heard: list[Outlet] = []  # topics of the recorder's line, by their numbers
        self._parts: list[bytes] = []  # of the next message on the line
        self._size = 0  # of these [B]
        self._line: DirectLine | None = None
        self._listens = "", ""  # node and namespace that subscribe over DDS for the recorder
        self._next = 0.0  # time of the next call or check [wall s]

    def publisher(self, name: str) -> Outlet:
        """Return a publisher of a topic of the table."""
        self._offers.append(Outlet(publisher(self._node, name), self._add, self._turns))
        return self._offers[-1]

    def look(self, now: float) -> None:
        """Call the recorder, or check for other listeners, if it is time [wall s]."""
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
                line.receive()  # which detects that the recorder is gone
                self._choose()

    def turn(self) -> None:
        """Let the listeners be counted again: at each turn of the loop, or on demand."""
        self._turns.count += 1

    def send(self) -> None:
        """Send what was published since the last call; the loop sends before it waits."""
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
        """Receive the list of topics that the recorder records."""
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
        """Forget the line: the recorder is gone, or another process answered."""
        self._line, self._listens, self._heard = None, ("", ""), []
        for offer in self._offers:
            offer.number = -1

    def _send_over_dds(self, message: bytes) -> None:
        """Publish over DDS what the lost recorder did not get, for the recorder that follows it."""
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
