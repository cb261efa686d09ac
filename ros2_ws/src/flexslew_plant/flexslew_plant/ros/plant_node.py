"""The `plant` node: the bench behind topics and services. It owns time."""

from time import monotonic

from flexslew_msgs import msg

from flexslew_plant.bench.bench import Bench, Truth
from flexslew_plant.bench.message_fields import testbed_fields
from flexslew_plant.bench.operation.run_state import FINISHED
from flexslew_plant.bench.operation.session import Session
from flexslew_plant.bench.wire import truth_bytes
from flexslew_plant.graph import topics
from flexslew_plant.measurement import EffortCommand, Measurement
from flexslew_plant.ros.alive import NOTICE
from flexslew_plant.ros.event_log import EventLog
from flexslew_plant.ros.graph import unmatched
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.messages import message_of, stamp
from flexslew_plant.ros.node_process import run_node
from flexslew_plant.ros.offers import publisher, subscription
from flexslew_plant.ros.parameters import new_node, settings_of
from flexslew_plant.ros.plant.diagnostics import Diagnostics
from flexslew_plant.ros.plant.display import Display
from flexslew_plant.ros.plant.exchange import Exchange, Neighbour
from flexslew_plant.ros.plant.parameters import CHANGEABLE, PlantParameters
from flexslew_plant.ros.plant.report import PlantReport
from flexslew_plant.ros.plant.services import Services
from flexslew_plant.ros.plant.settings import PlantSettings
from flexslew_plant.ros.realtime import NONE, PLANT, RealTime
from flexslew_plant.ros.statuses import Statuses
from flexslew_plant.ros.told_lines import tell


class Plant:
    """Publishes the records of the session, and passes messages and answers to it.

    Args:
        loop: loop that serves it.
        neighbour: a controller in the same process.
    """

    def __init__(self, loop: Loop, neighbour: Neighbour | None = None) -> None:
        self.loop = loop
        self.node = node = new_node("plant")
        self._alive, outlets = loop.only(node, "plant"), loop.outlets(node)
        self.statuses = Statuses(self._alive.presence, self._on_status)
        self._settings: PlantSettings = settings_of(node, PlantSettings, CHANGEABLE)
        bench = Bench(self._settings.bench)
        self.session = Session(
            bench,
            self._settings.controllers,
            self._settings.rate_factor,
            self._settings.answer_timeout,
            self._settings.autostart,
            self._missing,
            lambda: self._exchange.arrived(),
        )
        self._exchange = Exchange(node, outlets, loop, self.session, self._take, neighbour)
        self.session.presence, self._realtime = self._alive.presence, RealTime()
        self._truth, self._events = outlets.publisher(topics.TRUTH), EventLog(node, outlets)
        self.display = Display(node, outlets, bench, self._settings.display_rate)
        self.session.watched = lambda: self._is_truth_received() or self.display.due(bench.tick)
        subscription(node, topics.CONTROLLER_STATUS, self.statuses.hear)
        subscription(node, topics.RECORDER_STATUS, self._on_recorder)
        progress, heard = self._settings.progress, [self._exchange.questions, self._truth]
        self._report = PlantReport(node, self.session, self._alive, progress, heard)
        self._services = Services(node, self.session, self.statuses, loop, self.display.show_paused)
        self._diagnostics = Diagnostics(node, self.session)
        self._parameters = PlantParameters(node, self.session, self.display, loop)
        fields = {"stamp": stamp(0.0), **testbed_fields(bench, self._settings)}
        publisher(node, topics.TESTBED).publish(message_of(msg.Testbed, fields))

    def poll(self) -> float:
        """Do what is due; return the wall seconds until something can be due again."""
        now = monotonic()
        if self._alive.is_second(now):
            return NOTICE / 4
        self._exchange.look(now)
        wait = self.session.poll(now)
        self._realtime.want(PLANT if self.session.pacing.paced else NONE)
        self._send()
        wait = min(wait, self._exchange.call(wait), self._services.poll(now))
        self._report.poll(now)
        self._diagnostics.poll(now)
        return wait

    def interrupted(self) -> None:
        """Let the session report that the run ends early, and publish that."""
        self.session.interrupted()
        self._send()

    def _send(self) -> None:
        """Publish the records that the session has put out."""
        outbox = self.session.outbox
        while outbox:
            record = outbox.popleft()
            if isinstance(record, Measurement):
                self._exchange.ask(record)
                self.display.sense(record)
            elif isinstance(record, Truth):
                if self._is_truth_received():
                    self._truth.publish(truth_bytes(record))
                self.display.show(record)
            else:
                self._events.tell(record)
        done = self.session.run.state == FINISHED and not self.loop.stopped
        if done and self._settings.exit_when_done:
            if failure := self.session.bench.failure:
                tell(f"error: {failure}")  # for the process that started this node
            self.loop.stop(3 if self.session.bench.faulted else 0)

    def _is_truth_received(self) -> bool:
        """Return whether the truth is published, and has a listener."""
        return self._settings.truth and self._truth.heard

    def _missing(self) -> list[str]:
        """Return the nodes that the first question would not reach."""
        session, now = self.session, monotonic()
        controllers, listeners = session.needed(now), self._settings.wait_for
        if session.bench.tick or session.bench.epoch:  # nodes lost on the way are not waited for
            listeners = tuple(n for n in listeners if not session.presence.silent(n, now))
        shown = [self._truth] * self._settings.truth + self.display.publishers
        heard = [offer.publisher for offer in (self._exchange.questions, *shown)]
        return self._exchange.unheard(controllers) + unmatched(self.node, heard, listeners)

    def _take(self, command: EffortCommand) -> bool:
        if hurry := self.session.take(command, monotonic()):
            self.loop.hurry()
        self._send()
        return hurry

    def _on_status(self, message: msg.ControllerStatus) -> None:
        self._exchange.known(message.controller)
        self.session.hear(message.controller, message.ready, message.reason, message.instance)
        self.session.backlog.heard(message.controller, message.last_tick, message.epoch)

    def _on_recorder(self, message: msg.RecorderStatus) -> None:
        if self.session.presence.counts(message.recorder, message.instance, monotonic()):
            self.session.backlog.heard(message.recorder, message.tick, message.epoch, recorder=True)
        self.loop.hurry()  # the bench may wait for just this


def main() -> None:
    """Run the node until it is done or interrupted."""
    run_node(Plant)


if __name__ == "__main__":
    main()
