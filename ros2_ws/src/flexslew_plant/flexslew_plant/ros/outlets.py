"""Publishers that send to the recorder on a direct line and to all other listeners over DDS."""

import os
from math import inf
from time import monotonic, sleep

from rclpy.node import Node

from flexslew_plant.direct.inbox import DDS_FLAG, NAMESPACE, NODE, PART, RECEIVED, TOPICS, split
from flexslew_plant.direct.line import LARGEST, DirectLine, call, facts
from flexslew_plant.direct.names import RECORDER, address, direct
from flexslew_plant.graph import topics
from flexslew_plant.graph.topics import LOOP_DEPTH
from flexslew_plant.ros.offers import publisher
from flexslew_plant.ros.outlet import DirectPublisher, LoopCounter

_RETRY_PERIOD = 0.2  # until the recorder is called again [wall s]
_CHECK_PERIOD = 0.1  # between two checks for other listeners [wall s]
_KEPT = 16 * LOOP_DEPTH  # for a recorder that is held up; the plant waits for it long before that
_BATCH_BYTES = 1 << 13  # sent at once while ticks follow each other, a few of them [B]
_CLOSE_TIMEOUT = 5.0  # for a recorder that takes nothing [wall s]


class DirectPublishers:
    """Calls the recorder of the bench until it answers, and then sends messages to it directly.

    The recorder also subscribes over DDS. Nothing is published there for the recorder alone.

    Args:
        node: node that publishes.
    """

    def __init__(self, node: Node) -> None:
        self._node, self._direct = node, direct(os.environ)
        measurement_topic = node.resolve_topic_name(topics.MEASUREMENT)
        self._address = address(node.context.get_domain_id(), measurement_topic, RECORDER)
        self._loop_counter = LoopCounter()
        self._publishers: list[DirectPublisher] = []
        self._recorded: list[
            DirectPublisher
        ] = []  # topics of the recorder's line, by their numbers
        self._parts: list[bytes] = []  # of the next message on the line
        self._size = 0  # of these [B]
        self._line: DirectLine | None = None
        self._recorder = "", ""  # node and namespace that subscribe over DDS for the recorder
        self._next = 0.0  # time of the next call or check [wall s]

    def publisher(self, name: str) -> DirectPublisher:
        """Return a publisher of a topic of the table."""
        self._publishers.append(
            DirectPublisher(publisher(self._node, name), self._add, self._loop_counter)
        )
        return self._publishers[-1]

    def look(self, now: float) -> None:
        """Call the recorder, or check for other listeners, if it is time [wall s]."""
        line = self._line
        if line is None:
            if self._direct and now >= self._next:
                self._next = now + _RETRY_PERIOD
                self._line = call(self._address, _KEPT)
                if self._line is not None:
                    names = [
                        topic_publisher.publisher.topic_name for topic_publisher in self._publishers
                    ]
                    self._line.notify({TOPICS: names})
        elif line.closed:
            self._disconnect()
        elif not self._recorder[0]:
            self._begin(line)
        else:
            self.send()
            line.flush()
            if now >= self._next:
                self._next = now + _CHECK_PERIOD
                line.receive()  # which detects that the recorder is gone
                self._choose()

    def turn(self) -> None:
        """Let the listeners be counted again: at each turn of the loop, or on demand."""
        self._loop_counter.count += 1

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
        line, remaining, until = self._line, inf, monotonic() + _CLOSE_TIMEOUT
        while line is not None and line.queue_size and monotonic() < until:
            if line.queue_size < remaining:
                remaining, until = line.queue_size, monotonic() + _CLOSE_TIMEOUT
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
        if self._size > _BATCH_BYTES:
            self.send()
        return True

    def _begin(self, line: DirectLine) -> None:
        """Receive the list of topics that the recorder records."""
        data = line.receive()
        if data is None:
            return
        reply, by_name = (
            facts(data),
            {
                topic_publisher.publisher.topic_name: topic_publisher
                for topic_publisher in self._publishers
            },
        )
        recorded, node, place = reply.get(RECEIVED), reply.get(NODE), reply.get(NAMESPACE)
        known = isinstance(recorded, list) and all(str(name) in by_name for name in recorded)
        if not (known and isinstance(node, str) and isinstance(place, str)):
            line.close()
            return
        self._recorder, self._next = (node, place), 0.0
        self._recorded = [by_name[str(name)] for name in recorded or ()]
        for number, topic_publisher in enumerate(self._recorded):
            topic_publisher.number = number

    def _disconnect(self) -> None:
        """Forget the line: the recorder is gone, or another process answered."""
        self._line, self._recorder, self._recorded = None, ("", ""), []
        for topic_publisher in self._publishers:
            topic_publisher.number = -1

    def _send_over_dds(self, message: bytes) -> None:
        """Publish over DDS what the lost recorder did not get, for the recorder that follows it."""
        recorded = self._recorded
        self._disconnect()
        for number, data in split(message):
            if number < DDS_FLAG:
                recorded[number].publish(data)

    def _choose(self) -> None:
        for topic_publisher in self._recorded:
            if not topic_publisher.shared:
                continue
            infos = self._node.get_subscriptions_info_by_topic(topic_publisher.publisher.topic_name)
            listening = [(info.node_name, info.node_namespace) for info in infos]
            topic_publisher.recorder_only = listening == [self._recorder]
