"""The `recorder` node: everything on the topics of the bench into one MCAP bag."""

import json
from collections.abc import Iterator
from pathlib import Path
from time import monotonic

from flexslew_msgs import msg

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.recording.recording import Recording
from flexslew_lab.log.recording.recording_order import RecordingOrder
from flexslew_lab.log.recording.unfinished import begun_bag
from flexslew_lab.ros.intake import QUESTIONS, Intake
from flexslew_lab.ros.namesakes import Namesakes
from flexslew_lab.ros.rebroadcast import Rebroadcast
from flexslew_lab.ros.recorder_settings import RecorderSettings
from flexslew_plant.events import Fact, RecordingEnded, RecordingStarted, StrayMessage, event_of
from flexslew_plant.graph import topics
from flexslew_plant.ros.dead_nodes import DeadNodes
from flexslew_plant.ros.event_log import EventLog
from flexslew_plant.ros.graph import PlantWatch
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.messages import stamp
from flexslew_plant.ros.node_process import run_node
from flexslew_plant.ros.offers import publisher
from flexslew_plant.ros.parameters import new_node, serve_changes, settings_of

_TAKE_EVERY = 0.005  # [wall s]
_BUSY, _BUSY_EVERY = 20, 0.002  # messages at once: the plant flies fast, and waits for the log
_ENDING = 3.0  # of a plant that is interrupted together with the recorder [wall s]

_STRANGER = "its sender is not the plant of this bench"


class Recorder:
    """Writes the serialised messages as they come."""

    def __init__(self, loop: Loop) -> None:
        self.loop = loop
        self.node = node = new_node("recorder")
        self._alive = loop.live(node, "recorder")
        self._dead = DeadNodes(node, self._alive.presence)
        self._settings: RecorderSettings = settings_of(node, RecorderSettings)
        begun = begun_bag(Path(self._settings.folder), json.loads(self._settings.metadata))
        self._recording = Recording(begun, self._failed)
        self._events = EventLog(node)
        self._status = publisher(node, topics.RECORDER_STATUS)
        self._rebroadcast = Rebroadcast(node)
        self._order, self._warned = RecordingOrder(node.get_namespace()), set[str]()  # of topics
        self._told = self._recording.safe
        self._leave_at: float | None = None  # interrupted: when to leave at the latest [wall s]
        self._next_look = 0.0  # for the plant [wall s]
        self._intake, self._namesakes = Intake(node, loop), Namesakes(self._alive.presence)
        serve_changes(node, lambda changes: "")
        questions = self._intake.subscriptions[QUESTIONS]
        leaves = self._settings.exit_with_plant
        self._watch = PlantWatch(loop, node, questions, self._alive.presence, leaves)
        self._tell(RecordingStarted(self._settings.folder))

    def poll(self) -> float:
        """Take what has come and look for the plant; return when to do so again [wall s]."""
        now = monotonic()
        if now >= self._next_look:
            self._dead.poll(now)  # else it waits for them, where there is no plant to see it
            stay = self._intake.expects_more(now, self._watch.here)
            self._watch.look(3 if self._recording.stopped else 0, stay)
            self._next_look = now + 0.2
        if self._leave_at is not None and (now >= self._leave_at or not self._watch.here):
            self.loop.stop(130)
        return _BUSY_EVERY if self._take() > _BUSY else _TAKE_EVERY

    def interrupted(self) -> bool:
        """Return whether to stay: an interrupted plant still sends its last messages."""
        if self._leave_at is not None or not self._watch.here:
            return False
        self._leave_at = monotonic() + _ENDING
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
        messages = self._order.take(self._arrived(now, last), now, last)
        for topic in self._order.garbled - self._warned:
            self.node.get_logger().warning(f"left out of the log: a message on {topic} is not one")
        self._warned |= self._order.garbled
        for topic in self._intake.plant_only.strangers():
            self._tell(StrayMessage(TOPICS[topic].name, self.node.get_name(), _STRANGER))
        for message in messages:
            self._recording.write(message)
            self._tell_status()
        self._recording.flush(now)
        self._tell_status()
        self._rebroadcast.poll(now, last)
        return len(messages)

    def _arrived(self, now: float, last: bool) -> Iterator[tuple[str, bytes]]:
        heard = self._intake.arrived(now, last)
        for topic, data in self._namesakes.admit(heard, now, last):
            self._watch.seen = self._watch.seen or topic == QUESTIONS
            self._rebroadcast.hear(topic, data)
            yield topic, data

    def _tell_status(self) -> None:
        """Report the safe tick to the plant, which waits rather than lose more than a second."""
        if self._recording.safe == self._told:
            return
        self._told = epoch, tick = self._recording.safe
        self._status.publish(
            msg.RecorderStatus(
                stamp=stamp(self._order.newest[1] * 1e-9),
                recorder=self.node.get_name(),
                tick=tick,
                epoch=epoch,
                messages=self._recording.messages,
                instance=self._alive.beat.instance,
            )
        )

    def _failed(self, words: str) -> None:
        self._tell(RecordingEnded(words))

    def _tell(self, what: Fact) -> None:
        epoch, at = self._order.newest
        self._events.tell(event_of(what, self._order.tick, at * 1e-9, epoch, self.node.get_name()))


def main() -> None:
    """Run the node until it is interrupted or the plant is gone."""
    run_node(Recorder)


if __name__ == "__main__":
    main()
