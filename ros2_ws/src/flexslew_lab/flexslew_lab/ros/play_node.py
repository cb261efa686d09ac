"""The `play` node: a bag back onto the topics, byte for byte."""

from collections.abc import Callable, Sequence, Set
from functools import partial
from time import monotonic
from typing import Any

from flexslew_msgs import srv
from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.replay.player import CLOCK, Outgoing, Player, PlaySettings
from flexslew_plant.errors import BadInput
from flexslew_plant.ros.graph import unmatched
from flexslew_plant.ros.loop import Loop, run_node, within
from flexslew_plant.ros.messages import seconds_of, stamp
from flexslew_plant.ros.offers import message_class, qos
from flexslew_plant.ros.parameters import new_node, settings_of
from flexslew_plant.topics import LOOP_DEPTH, Topic

_LOOK = 0.05  # until the next poll, for what a service has changed [wall s]
_LOT = 1000  # messages between two looks at whether all were heard
_PATIENCE = Duration(seconds=2)  # with a listener that does not take what it is sent

Report = Callable[[float, float], None]  # simulated time of the player and of the end [s]


class PlayNode:
    """Publishes what its player says is due.

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
        self._player = Player(self._settings)
        self._period = self._player.period  # services count in ticks of the recorded bench
        self._publishers: dict[str, Publisher[Any]] = {}
        self._publish(set(self._player.topics))
        self._clock: Publisher[Any] | None = None
        if self._settings.clock:
            self._clock = node.create_publisher(Clock, CLOCK, LOOP_DEPTH)
        node.create_service(Trigger, "~/pause", self._on_pause)
        node.create_service(Trigger, "~/resume", self._on_resume)
        node.create_service(srv.Step, "~/step", self._on_step)
        node.create_service(srv.Seek, "~/seek", self._on_seek)
        self._waiting: list[str] | None = None  # for whom; None: not any more
        self._unheard = 0
        self._next_report = self._next_clock = 0.0
        if self._settings.wait_for:
            self._waiting = []

    def poll(self) -> float:
        """Publish what is due; return the wall seconds until the next message."""
        if self._waiting is not None and not self._all_there():
            return 0.02
        now = monotonic()
        self._send(self._player.due(now, _LOT))
        self._tell(now)
        if self._player.done:
            self._hear_out()
            self._report(self._player.time, self._player.last * 1e-9)
            self.loop.stop(0)
            return 0.0
        return min(self._player.wait(monotonic()), self._until_clock(), _LOOK)

    def close(self) -> None:
        """Leave the graph."""
        self.node.destroy_node()

    def _publish(self, topics: Set[str]) -> None:
        """Offer these topics; a publisher that is there already is forgotten with its history."""
        for topic in topics:
            if topic in self._publishers:
                self.node.destroy_publisher(self._publishers[topic])
            kind = self._player.topics[topic]
            # deeper than the original: a second of playing may be a day of it
            offer = Topic(topic, kind, LOOP_DEPTH, topic in self._player.latched)
            self._publishers[topic] = self.node.create_publisher(
                message_class(kind), TOPICS[topic].name if topic in TOPICS else topic, qos(offer)
            )

    def _all_there(self) -> bool:
        missing = unmatched(self.node, list(self._publishers.values()), self._settings.wait_for)
        if missing and missing != self._waiting:
            self.node.get_logger().info(f"waiting for {', '.join(missing)}")
        self._waiting = missing or None
        return not missing

    def _send(self, messages: Sequence[Outgoing]) -> None:
        for message in messages:
            self._publishers[message.topic].publish(message.data)
            self._unheard += 1
            if self._unheard >= _LOT:
                self._hear_out()

    def _hear_out(self) -> None:
        """Let reliable listeners take what is out, before more of it would push it away."""
        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(_PATIENCE)
        self._unheard = 0

    def _tell(self, now: float) -> None:
        """Publish the clock and report the progress where they are due."""
        if self._clock is not None and now >= self._next_clock:
            at = min(self._player.simulated(now) * 1e-9, self._player.time)
            self._clock.publish(Clock(clock=stamp(at)))
            self._next_clock = now + 1.0 / self._settings.clock
        if now >= self._next_report:
            self._report(self._player.time, self._player.last * 1e-9)
            self._next_report = now + 0.2

    def _until_clock(self) -> float:
        return max(0.0, self._next_clock - monotonic()) if self._clock is not None else 0.5

    def _tick(self) -> int:
        return round(self._player.time / self._period)

    def _on_pause(self, _: Trigger.Request, reply: Trigger.Response) -> Trigger.Response:
        self._player.pause()
        reply.success, reply.message = True, f"paused at {self._player.time:.3f} s"
        return reply

    def _on_resume(self, _: Trigger.Request, reply: Trigger.Response) -> Trigger.Response:
        self._player.resume()
        reply.success, reply.message = True, f"going on from {self._player.time:.3f} s"
        return reply

    def _on_step(self, request: srv.Step.Request, reply: srv.Step.Response) -> srv.Step.Response:
        if not self._player.paused:
            reply.tick, reply.message = self._tick(), "not paused; call pause first"
            return reply
        until = (self._tick() + max(1, request.ticks)) * self._period
        messages = self._player.step(until - 0.5 * self._period)
        self._send(messages)
        reply.ok, reply.tick = True, self._tick()
        reply.message = f"{len(messages)} messages, next at {self._player.time:.3f} s"
        return reply

    def _on_seek(self, request: srv.Seek.Request, reply: srv.Seek.Response) -> srv.Seek.Response:
        try:
            time = self._player.seek(seconds_of(request.time))
        except BadInput as error:
            reply.message = str(error)
            return reply
        self._hear_out()
        self._publish(self._player.latched)
        self._next_report = 0.0
        self.loop.hurry()
        reply.ok, reply.message = True, f"next at {time:.3f} s"
        return reply


def play(
    settings: PlaySettings, report: Report = lambda time, end: None, namespace: str = ""
) -> None:
    """Play a bag from this process into a namespace, then exit; see PlaySettings."""
    run_node(partial(PlayNode, settings, report), args=within(namespace))


def main() -> None:
    """Run the node with the parameters of PlaySettings."""
    run_node(partial(PlayNode, None, lambda time, end: None))


if __name__ == "__main__":
    main()
