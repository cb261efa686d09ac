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
from flexslew_plant.ros.alive import NODE_WAIT_TIME
from flexslew_plant.ros.event_log import EventLog
from flexslew_plant.ros.graph import missing_listeners
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.messages import message_of, stamp
from flexslew_plant.ros.node_process import run_node
from flexslew_plant.ros.offers import publisher, subscription
from flexslew_plant.ros.parameters import new_node, settings_of
from flexslew_plant.ros.plant.diagnostics import Diagnostics
from flexslew_plant.ros.plant.display import Display
from flexslew_plant.ros.plant.exchange import ControllerLink, LocalController
from flexslew_plant.ros.plant.parameters import DYNAMIC_PARAMETERS, PlantParameters
from flexslew_plant.ros.plant.report import PlantReport
from flexslew_plant.ros.plant.services import Services
from flexslew_plant.ros.plant.settings import PlantSettings
from flexslew_plant.ros.realtime import NONE, PLANT, RealTime
from flexslew_plant.ros.statuses import StatusMonitor
from flexslew_plant.ros.told_lines import write_line


class Plant:
    """Publishes the records of the session, and passes messages and answers to it.

    Args:
        loop: loop that serves it.
        local_controller: a controller in the same process.
    """

    def __init__(self, loop: Loop, local_controller: LocalController | None = None) -> None:
        self.loop = loop
        self.node = node = new_node("plant")
        self._alive, direct = loop.only(node, "plant"), loop.direct_publishers(node)
        self.statuses = StatusMonitor(self._alive.heartbeats, self._on_status)
        self._settings: PlantSettings = settings_of(node, PlantSettings, DYNAMIC_PARAMETERS)
        s, bench = self._settings, Bench(self._settings.bench)
        running = s.rate_factor, s.answer_timeout, s.autostart
        self.session = Session(
            bench, s.controllers, *running, self._missing, lambda: self._link.received()
        )
        self._link = ControllerLink(node, direct, loop, self.session, self._take, local_controller)
        self.close = bench.close  # a plant with a brake is braked
        self.session.heartbeats, self._realtime = self._alive.heartbeats, RealTime()
        self._truth = direct.publisher(topics.TRUTH)
        self._events = EventLog(node, direct)
        self.display = Display(node, direct, bench, self._settings.display_rate)
        self.session.monitored = lambda: self._is_truth_received() or self.display.due(bench.tick)
        subscription(node, topics.CONTROLLER_STATUS, self.statuses.receive)
        subscription(node, topics.RECORDER_STATUS, self._on_recorder)
        required = [self._link.measurements, self._truth]
        self._report = PlantReport(node, self.session, self._alive, s.progress, required)
        self._services = Services(node, self.session, self.statuses, loop, self.display.refresh)
        self._diagnostics = Diagnostics(node, self.session)
        self._parameters = PlantParameters(node, self.session, self.display, loop)
        fields = {"stamp": stamp(0.0), **testbed_fields(bench, self._settings)}
        publisher(node, topics.TESTBED).publish(message_of(msg.Testbed, fields))

    def poll(self) -> float:
        """Do what is due; return the wall seconds until something can be due again."""
        now = monotonic()
        if self._alive.is_second(now):
            return NODE_WAIT_TIME / 4
        self._link.look(now)
        wait = self.session.poll(now)
        self._realtime.set_priority(PLANT if self.session.tick_timer.real_time else NONE)
        self._send()
        wait = min(wait, self._link.call(wait), self._services.poll(now))
        self._report.poll(now)
        self._diagnostics.poll(now)
        return wait

    def interrupted(self) -> None:
        """Let the session report that the run ends early, and publish that."""
        self.session.interrupted()
        self._send()

    def _send(self) -> None:
        """Publish the records that the session has put out."""
        outbox = self.session.outgoing
        while outbox:
            record = outbox.popleft()
            if isinstance(record, Measurement):
                self._link.ask(record)
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
                write_line(f"error: {failure}")  # for the process that started this node
            self.loop.stop(3 if self.session.bench.faulted else 0)

    def _is_truth_received(self) -> bool:
        """Return whether the truth is published, and has a listener."""
        return self._settings.truth and self._truth.received

    def _missing(self) -> list[str]:
        """Return the nodes that the first question would not reach."""
        session, now = self.session, monotonic()
        controllers, listeners = session.needed(now), self._settings.wait_for
        if session.bench.tick or session.bench.epoch:  # nodes lost on the way are not waited for
            listeners = tuple(n for n in listeners if not session.heartbeats.inactive(n, now))
        truth = [self._truth] * self._settings.truth
        outputs = (self._link.measurements, *truth, *self.display.publishers)
        required = [output.publisher for output in outputs]
        missing = missing_listeners(self.node, required, listeners)
        return self._link.without_link(controllers) + missing

    def _take(self, command: EffortCommand) -> bool:
        if poll_now := self.session.take(command, monotonic()):
            self.loop.hurry()
        self._send()
        return poll_now

    def _on_status(self, message: msg.ControllerStatus) -> None:
        self._link.add_controller(message.controller)
        self.session.receive(message.controller, message.ready, message.reason, message.instance)
        self.session.node_progress.received(message.controller, message.last_tick, message.epoch)

    def _on_recorder(self, message: msg.RecorderStatus) -> None:
        if self.session.heartbeats.counts(message.recorder, message.instance, monotonic()):
            progress = self.session.node_progress
            progress.received(message.recorder, message.tick, message.epoch, recorder=True)
        self.loop.hurry()  # the bench may wait for just this


def main() -> None:
    """Run the node until it is done or interrupted."""
    run_node(Plant)


if __name__ == "__main__":
    main()
