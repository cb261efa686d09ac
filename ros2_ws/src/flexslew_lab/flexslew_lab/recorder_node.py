"""The `recorder` node: everything on the topics of the bench into one MCAP bag."""

import json
import struct
from bisect import bisect_right
from importlib import import_module
from operator import itemgetter
from pathlib import Path
from time import monotonic
from typing import Any

from flexslew_msgs import msg
from rclpy.qos import QoSProfile

from flexslew_lab.bag_layout import TOPICS
from flexslew_lab.bag_writer import BagWriter, RecordingStopped
from flexslew_lab.cdr import stamp_of
from flexslew_plant import topics
from flexslew_plant.events import Event, Level
from flexslew_plant.ros_node import (
    LOOP,
    Loop,
    PlantWatch,
    event_message,
    latched,
    new_node,
    run_node,
    settings_of,
    stamp,
)
from flexslew_plant.settings import section

_TICK_AND_EPOCH = struct.Struct("<QI")  # of a Measurement, behind the header with its empty frame
_REPORT_EVERY = 100  # ticks
_TAKE_EVERY = 0.01  # [wall s]
_time, _by_time = itemgetter(0), itemgetter(0, 1)


@section
class RecorderSettings:
    """The parameters of the node."""

    folder: str = "flexslew_bag"  # of the bag; must not hold one yet
    metadata: str = "{}"  # of the run (trial, versions, ...), JSON, text to text
    exit_with_plant: bool = False  # close the bag and end the process when the plant is gone


class Recorder:
    """Writes the serialised messages as they come."""

    def __init__(self, loop: Loop) -> None:
        self.node = node = new_node("recorder")
        loop.add(node)
        self._settings: RecorderSettings = settings_of(node, RecorderSettings)
        self._writer = BagWriter(Path(self._settings.folder), json.loads(self._settings.metadata))
        self._events = node.create_publisher(msg.Event, topics.EVENTS, latched(100))
        self._status = node.create_publisher(msg.RecorderStatus, topics.RECORDER_STATUS, latched(1))
        self._last = 0  # newest simulated time of any message [ns]
        self._waiting: list[tuple[int, int, str, bytes]] = []  # stamp, rank of topic, topic, CDR
        self._stopped = False
        self._next_look = 0.0
        # The ears are not on the loop: taking many messages at once costs the bench far less than
        # waking up for each of them.
        self._ears = new_node(f"{node.get_name()}_ears", own_parameters=False)
        self._subscriptions = {
            topic: self._ears.create_subscription(
                _message_class(kind.type),
                topic,
                lambda _: None,
                _qos(kind.latched, kind.depth),
                raw=True,
            )
            for topic, kind in TOPICS.items()
        }
        measurement = self._subscriptions["/measurement"]
        self._watch = PlantWatch(loop, measurement, self._settings.exit_with_plant)
        self._say(Level.INFO, "recording", f"recording into {self._settings.folder}")

    def poll(self) -> float:
        """Take what has come and look for the plant; return when to do so again [wall s]."""
        now = monotonic()
        if now >= self._next_look:
            self._watch.look(3 if self._stopped else 0)
            self._next_look = now + 0.2
        self._take_all()
        return _TAKE_EVERY

    def close(self) -> None:
        """Make the bag whole."""
        self._take_all(last=True)
        try:
            self._writer.close({"messages": str(self._writer.messages)})
        except RecordingStopped as error:
            self.node.get_logger().error(str(error))
        self._ears.destroy_node()
        self.node.destroy_node()

    def _take_all(self, last: bool = False) -> None:
        """Take what has arrived; write in the order of simulated time what is surely complete.

        The topics of one tick do not arrive at one moment, so what is newer than the newest message
        of the call before waits for the next one.
        """
        horizon = self._last
        for rank, (topic, subscription) in enumerate(self._subscriptions.items()):
            kind = TOPICS[topic].type
            with subscription.handle:
                take = subscription.handle.take_message
                while (taken := take(subscription.msg_type, True)) is not None:
                    at = stamp_of(kind, taken[0], horizon)
                    self._waiting.append((at, rank, topic, taken[0]))
                    self._last = max(self._last, at)
        self._waiting.sort(key=_by_time)
        ready = len(self._waiting) if last else bisect_right(self._waiting, horizon, key=_time)
        for at, _, topic, data in self._waiting[:ready]:
            self._write(at, topic, data)
        del self._waiting[:ready]

    def _write(self, at: int, topic: str, data: bytes) -> None:
        if self._stopped:
            return
        try:
            self._writer.write(topic, TOPICS[topic].type, data, at)
            if topic == "/measurement":
                self._report(*_TICK_AND_EPOCH.unpack_from(data, 20))
        except RecordingStopped as error:
            self._stopped = True
            self._say(Level.FAULT, "recording_stopped", str(error))

    def _report(self, tick: int, epoch: int) -> None:
        """Tell the plant, which holds back rather than lose anything."""
        if tick % _REPORT_EVERY == 0:
            self._status.publish(
                msg.RecorderStatus(
                    stamp=stamp(self._last * 1e-9),
                    recorder=self.node.get_name(),
                    tick=tick,
                    epoch=epoch,
                    messages=self._writer.messages,
                )
            )

    def _say(self, level: Level, kind: str, words: str) -> None:
        event = Event(0, self._last * 1e-9, 0, level, "recorder", kind, words, {})
        self._events.publish(event_message(event))
        self.node.get_logger().info(words)


def _message_class(kind: str) -> Any:
    package, _, name = kind.split("/")
    return getattr(import_module(f"{package}.msg"), name)


def _qos(is_latched: bool, depth: int) -> QoSProfile:
    if is_latched:
        return latched(max(depth, 100))
    return LOOP


def main() -> None:
    """Run the node until it is interrupted or the plant is gone."""
    run_node(Recorder)


if __name__ == "__main__":
    main()
