"""The `play` node: a bag back onto the topics, byte for byte."""

from collections.abc import Callable, Sequence, Set
from functools import partial
from time import monotonic
from typing import Any

from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.replay.player import CLOCK, Outgoing, Player, PlaySettings
from flexslew_lab.ros.play_services import PlayServices
from flexslew_plant.errors import BadInput
from flexslew_plant.graph.topics import LOOP_DEPTH, Topic
from flexslew_plant.ros.graph import missing_listeners
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.messages import stamp
from flexslew_plant.ros.node_process import namespace_arguments, run_node
from flexslew_plant.ros.offers import message_class, qos
from flexslew_plant.ros.parameters import new_node, settings_of

_POLL_PERIOD = 0.05  # until the next poll, for what a service has changed [wall s]
_BATCH = 1000  # messages between two waits for acknowledgement
_PATIENCE = Duration(seconds=2)  # with a listener that does not take what it is sent

Report = Callable[[float, float], None]  # simulated time of the player and of the end [s]


class PlayNode:
    """Publishes the messages of its player when they are due.

    Args:
        settings: how to play; None: the parameters of the node.
        report: called with the progress now and then.
        loop: that serves the node.
    """

    def __init__(self, settings: PlaySettings | None, report: Report, loop: Loop) -> None:
        self.loop, self._report = loop, report
        self.node = node = new_node("play")
        loop.add(node)
        self._settings: PlaySettings = settings or settings_of(node, PlaySettings)
        if not self._settings.bag:
            raise BadInput("node play: bag: give the folder of a bag")
        self.player = Player(self._settings)
        self._publishers: dict[str, Publisher[Any]] = {}
        self._publish(set(self.player.topics))
        self._clock: Publisher[Any] | None = None
        if self._settings.clock:
            self._clock = node.create_publisher(Clock, CLOCK, LOOP_DEPTH)
        self._services = PlayServices(node, self.player, self.send, self.after_seek)
        self._waiting: list[str] | None = None  # missing subscribers; None: all are there
        self._pending_count = 0
        self._next_report = self._next_clock = 0.0
        if self._settings.wait_for:
            self._waiting = []

    def poll(self) -> float:
        """Publish what is due; return the wall seconds until the next message."""
        if self._waiting is not None and not self._subscribers_ready():
            return 0.02
        now = monotonic()
        self.send(self.player.due(now, _BATCH))
        self._report_progress(now)
        if self.player.done:
            self._wait_for_subscribers()
            self._report(self.player.time, self.player.last * 1e-9)
            self.loop.stop(0)
            return 0.0
        return min(self.player.wait(monotonic()), self._until_clock(), _POLL_PERIOD)

    def _publish(self, topics: Set[str]) -> None:
        """Offer these topics; a publisher that is there already is forgotten with its history."""
        for topic in topics:
            if topic in self._publishers:
                self.node.destroy_publisher(self._publishers[topic])
            kind = self.player.topics[topic]
            # deeper than the original: a second of playing may be a day of it
            description = Topic(topic, kind, LOOP_DEPTH, topic in self.player.latched)
            self._publishers[topic] = self.node.create_publisher(
                message_class(kind),
                TOPICS[topic].name if topic in TOPICS else topic,
                qos(description),
            )

    def _subscribers_ready(self) -> bool:
        publishers = [p for p in (*self._publishers.values(), self._clock) if p is not None]
        missing = missing_listeners(self.node, publishers, self._settings.wait_for)
        if missing and missing != self._waiting:
            self.node.get_logger().info(f"waiting for {', '.join(missing)}")
        self._waiting = missing or None
        return not missing

    def send(self, messages: Sequence[Outgoing]) -> None:
        """Publish messages."""
        for message in messages:
            self._publishers[message.topic].publish(message.data)
            self._pending_count += 1
            if self._pending_count >= _BATCH:
                self._wait_for_subscribers()

    def _wait_for_subscribers(self) -> None:
        """Let reliable listeners take what is out, before more of it would push it away."""
        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(_PATIENCE)
        self._pending_count = 0

    def _report_progress(self, now: float) -> None:
        """Publish the clock and report the progress where they are due."""
        if self._clock is not None and now >= self._next_clock:
            at = min(self.player.simulated(now) * 1e-9, self.player.time)
            self._clock.publish(Clock(clock=stamp(at)))
            self._next_clock = now + 1.0 / self._settings.clock
        if now >= self._next_report:
            self._report(self.player.time, self.player.last * 1e-9)
            self._next_report = now + 0.2

    def _until_clock(self) -> float:
        return max(0.0, self._next_clock - monotonic()) if self._clock is not None else 0.5

    def after_seek(self) -> None:
        """Offer the latched messages of another place."""
        self._wait_for_subscribers()
        self._publish(self.player.latched)
        self._next_report = 0.0
        self.loop.hurry()


def play(
    settings: PlaySettings, report: Report = lambda time, end: None, namespace: str = ""
) -> None:
    """Play a bag from this process into a namespace, then exit; see PlaySettings."""
    run_node(partial(PlayNode, settings, report), args=namespace_arguments(namespace))


def main() -> None:
    """Run the node with the parameters of PlaySettings."""
    run_node(partial(PlayNode, None, lambda time, end: None))


if __name__ == "__main__":
    main()
