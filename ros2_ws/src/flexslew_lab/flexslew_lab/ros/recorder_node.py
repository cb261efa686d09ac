"""The `recorder` node: everything on the topics of the bench into one MCAP bag."""

import json
from collections.abc import Iterator
from math import inf
from pathlib import Path
from time import monotonic

from flexslew_msgs import msg

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.recording.recording import Recording
from flexslew_lab.log.recording.recording_order import RecordingOrder
from flexslew_lab.log.recording.unfinished import open_bag
from flexslew_lab.ros.rebroadcast import Rebroadcast
from flexslew_lab.ros.recorder.intake import MEASUREMENT_TOPIC, MessageSource
from flexslew_lab.ros.recorder.namesakes import StatusFilter
from flexslew_lab.ros.recorder.recorder_settings import RecorderSettings
from flexslew_plant.events import (
    Fact,
    RecordingEnded,
    RecordingStarted,
    UnexpectedMessage,
    event_of,
)
from flexslew_plant.graph import topics
from flexslew_plant.ros.dead_nodes import GraphCleanup
from flexslew_plant.ros.event_log import EventLog
from flexslew_plant.ros.graph import PlantWatch
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.messages import stamp
from flexslew_plant.ros.node_process import run_node
from flexslew_plant.ros.offers import publisher
from flexslew_plant.ros.parameters import handle_changes, new_node, settings_of

_TAKE_EVERY = 0.005  # [wall s]
_BUSY, _BUSY_EVERY = 20, 0.002  # messages at once: the plant flies fast, and waits for the log
_ENDING = 3.0  # of nodes that are interrupted together with the recorder [wall s]

_NOT_PLANT = "its sender is not the plant of this bench"


class Recorder:
    """Writes the serialised messages as they come."""

    def __init__(self, loop: Loop) -> None:
        self.loop = loop
        self.node = node = new_node("recorder")
        self._alive = loop.live(node, "recorder")
        self._lost_nodes = GraphCleanup(node, self._alive.heartbeats)
        self._settings: RecorderSettings = settings_of(node, RecorderSettings)
        bag = open_bag(Path(self._settings.folder), json.loads(self._settings.metadata))
        self._recording = Recording(bag, lambda words: self._publish_event(RecordingEnded(words)))
        self._events = EventLog(node)
        self._status = publisher(node, topics.RECORDER_STATUS)
        self._rebroadcast = Rebroadcast(node)
        self._order, self._warned = RecordingOrder(node.get_namespace()), set[str]()  # of topics
        self._last_status = self._recording.safe
        self._exit_time = inf  # interrupted: when to leave at the latest [wall s]
        self._next_check = 0.0  # for the plant [wall s]
        self._source = MessageSource(node, loop)
        self._status_filter = StatusFilter(self._alive.heartbeats)
        handle_changes(node, lambda changes: "")
        measurements = self._source.subscriptions[MEASUREMENT_TOPIC]
        leaves = self._settings.exit_with_plant
        self._watch = PlantWatch(loop, node, measurements, self._alive.heartbeats, leaves)
        self._publish_event(RecordingStarted(self._settings.folder))

    def poll(self) -> float:
        """Take what has come and look for the plant; return when to do so again [wall s]."""
        now = monotonic()
        if now >= self._next_check:
            self._lost_nodes.poll(now)  # else it waits for them, where there is no plant to see it
            more_expected = self._source.has_pending(now, self._watch.plant_present)
            self._watch.look(3 if self._recording.stopped else 0, more_expected)
            if self._exit_time < inf and (now >= self._exit_time or not more_expected):
                self.loop.stop(130)
            self._next_check = now + 0.2
        return _BUSY_EVERY if self._take() > _BUSY else _TAKE_EVERY

    def interrupted(self) -> bool:
        """Return whether to stay: an interrupted bench still sends its last messages."""
        if self._exit_time < inf or not self._watch.plant_present:
            return False
        self._exit_time = monotonic() + _ENDING
        return True

    def close(self) -> None:
        """Make the bag whole.

        Raises:
            RecordingStopped: it is not on the disk.
        """
        self._take(last=True)
        self._recording.close()

    def _take(self, last: bool = False) -> int:
        """Write what is due; return how many messages it was."""
        now = monotonic()
        messages = self._order.take(self._received(now, last), now, last)
        for topic in self._order.invalid_topics - self._warned:
            self.node.get_logger().warning(f"left out of the log: a message on {topic} is not one")
        self._warned |= self._order.invalid_topics
        for topic in self._source.plant_only.unknown_items():
            name = TOPICS[topic].name
            self._publish_event(UnexpectedMessage(name, self.node.get_name(), _NOT_PLANT))
        for message in messages:
            self._recording.write(message)
            self._publish_status()
        self._recording.flush(now)
        self._publish_status()
        self._rebroadcast.poll(now, last)
        return len(messages)

    def _received(self, now: float, last: bool) -> Iterator[tuple[str, bytes]]:
        received = self._source.received(now, last)
        for topic, data in self._status_filter.filter_messages(received, now, last):
            self._watch.seen = self._watch.seen or topic == MEASUREMENT_TOPIC
            self._rebroadcast.receive(topic, data)
            yield topic, data

    def _publish_status(self) -> None:
        """Report the safe tick to the plant, which waits rather than lose more than a second."""
        if self._recording.safe == self._last_status:
            return
        self._last_status = epoch, tick = self._recording.safe
        self._status.publish(
            msg.RecorderStatus(
                stamp=stamp(self._order.newest[1] * 1e-9),
                recorder=self.node.get_name(),
                tick=tick,
                epoch=epoch,
                messages=self._recording.messages,
                instance=self._alive.heartbeat.instance,
            )
        )

    def _publish_event(self, what: Fact) -> None:
        epoch, at = self._order.newest
        self._events.tell(event_of(what, self._order.tick, at * 1e-9, epoch, self.node.get_name()))


def main() -> None:
    """Run the node until it is interrupted or the plant is gone."""
    run_node(Recorder)


if __name__ == "__main__":
    main()
