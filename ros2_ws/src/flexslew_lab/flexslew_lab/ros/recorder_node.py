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

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.bag_writer import BagWriter, RecordingStopped
from flexslew_lab.log.cdr import stamp_of
from flexslew_plant import topics
from flexslew_plant.bench.events import Event, Level
from flexslew_plant.ros.node import (
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

_TICK_AND_EPOCH = struct.Struct("<QI")
_BEHIND_HEADER, _BEHIND_STAMP = 20, 12  # with an empty frame
_OF_PLANT = ("/measurement", "/truth")  # their epoch counts
_OF_CREW = ("/effort_command", "/controller_state", "/plan")  # they leave after the plant
_DISPLAYED = ("/clock", "/joint_states", "/appendage_states", "/tf", "/markers")  # they have none
_REPORT_EVERY = 100  # ticks
_TAKE_EVERY = 0.01  # [wall s]
_SILENCE = 10.0  # after which nothing is expected any more [wall s]; DDS repairs every 3 s
_time, _by_time = itemgetter(0, 1), itemgetter(0, 1, 2)


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
        self._last = 0, 0  # newest epoch, and newest simulated time in it [ns]
        self._displayed = dict.fromkeys(_DISPLAYED, (0, 0))  # the same by topic
        self._offset = 0, 0  # epoch that is written, and when it began in log time [ns]
        self._waiting: list[tuple[int, int, int, str, bytes]] = []  # epoch, stamp, rank, topic, CDR
        self._stopped = False
        self._next_look = 0.0
        self._heard = 0.0  # when something came [wall s]
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
            self._watch.look(3 if self._stopped else 0, stay=self._expects_more(now))
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

    def _expects_more(self, now: float) -> bool:
        """Return whether those who leave after the plant may still have something to say."""
        crew = (self._subscriptions[topic].get_publisher_count() for topic in _OF_CREW)
        return now < self._heard + _SILENCE and any(crew)

    def _take_all(self, last: bool = False) -> None:
        """Take what has arrived; write in the order of simulated time what is surely complete.

        The topics of one tick do not arrive at one moment, so what is newer than the newest message
        of the call before waits for the next one.
        """
        horizon = self._last
        fresh: list[tuple[int, int, str, bytes]] = []
        for rank, (topic, subscription) in enumerate(self._subscriptions.items()):
            kind = TOPICS[topic].type
            with subscription.handle:
                take = subscription.handle.take_message
                while (taken := take(subscription.msg_type, True)) is not None:
                    at = stamp_of(kind, taken[0], horizon[1])
                    fresh.append((at, rank, topic, taken[0]))
                    if topic in _OF_PLANT:
                        epoch = _TICK_AND_EPOCH.unpack_from(taken[0], _BEHIND_HEADER)[1]
                        self._last = max(self._last, (epoch, at))
        if fresh:
            self._heard = monotonic()
        self._waiting += [(self._epoch(t, at, data), at, r, t, data) for at, r, t, data in fresh]
        self._waiting.sort(key=_by_time)
        ready = len(self._waiting) if last else bisect_right(self._waiting, horizon, key=_time)
        for epoch, at, _, topic, data in self._waiting[:ready]:
            self._write(epoch, at, topic, data)
        del self._waiting[:ready]

    def _epoch(self, topic: str, at: int, data: bytes) -> int:
        """Return the epoch to which a message belongs; the plant's newest one is known."""
        newest = self._last[0]
        if topic in self._displayed:
            epoch, before = self._displayed[topic]
            epoch = newest if at < before else epoch
            self._displayed[topic] = epoch, at
            return epoch
        if not newest:
            return 0
        if topic in _OF_PLANT or topic == "/controller_state":
            return min(newest, int(_TICK_AND_EPOCH.unpack_from(data, _BEHIND_HEADER)[1]))
        if topic in ("/effort_command", "/events"):
            return min(newest, int(_TICK_AND_EPOCH.unpack_from(data, _BEHIND_STAMP)[1]))
        return newest

    def _write(self, epoch: int, at: int, topic: str, data: bytes) -> None:
        """Write a message; in log time, an epoch begins where the one before has ended."""
        if epoch > self._offset[0]:
            self._offset = epoch, self._writer.last - at
        at += self._offset[1]
        if not self._stopped:
            try:
                self._writer.write(topic, TOPICS[topic].type, data, at)
            except RecordingStopped as error:
                self._stopped = True
                self._say(Level.FAULT, "recording_stopped", str(error))
        if topic == "/measurement":  # also when stopped: the plant need not wait for us
            self._report(*_TICK_AND_EPOCH.unpack_from(data, _BEHIND_HEADER))

    def _report(self, tick: int, epoch: int) -> None:
        """Tell the plant, which holds back rather than lose anything."""
        if tick % _REPORT_EVERY == 0:
            self._status.publish(
                msg.RecorderStatus(
                    stamp=stamp(self._last[1] * 1e-9),
                    recorder=self.node.get_name(),
                    tick=tick,
                    epoch=epoch,
                    messages=self._writer.messages,
                )
            )

    def _say(self, level: Level, kind: str, words: str) -> None:
        event = Event(0, self._last[1] * 1e-9, 0, level, "recorder", kind, words, {})
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
