"""The `controller` node: any law behind the one question of the bench."""

import sys
from functools import partial
from pathlib import Path
from time import monotonic

from flexslew_msgs import msg

from flexslew_control.controllers import CONTROLLERS, DEFAULT, build_controller, with_file
from flexslew_control.controllers.host import ControllerHost
from flexslew_control.law import plant_description
from flexslew_control.message_fields import received_plan
from flexslew_control.ros.announcer import StatusPublisher
from flexslew_control.ros.answering import AnswerServer
from flexslew_control.ros.controller_settings import ControllerNodeSettings
from flexslew_control.ros.tuning import Tuning
from flexslew_control.ros.turn import wait_until_unique
from flexslew_plant.bench.operation.run_state import RUNNING
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics
from flexslew_plant.own_code import Trust
from flexslew_plant.ros.event_log import EventLog
from flexslew_plant.ros.graph import PlantWatch
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.node_process import run_node
from flexslew_plant.ros.offers import subscription
from flexslew_plant.ros.parameters import declared, new_node, parameters_of
from flexslew_plant.ros.realtime import RealTime, priority_of

_POLL_PERIOD = 0.02  # between two polls at the graph while not ready [wall s]


class ControllerNode:
    """Answers `measurement` on `effort_command` when it is named.

    Args:
        law: that it runs, unless its parameter `law` names another one.
        loop: that serves it.
        by_call: the plant shares the process and calls `answering` instead.
    """

    def __init__(self, law: str, loop: Loop, by_call: bool = False) -> None:
        self.node = node = new_node(law)
        given = parameters_of(node)
        node_values = {
            k: given.pop(k) for k in ControllerNodeSettings.__annotations__ if k in given
        }
        self._settings = declared(node, ControllerNodeSettings, {"law": law, **node_values})
        self._alive = wait_until_unique(loop, node, self._settings.exit_with_plant)
        given = with_file(self._settings.law, given, f"node {node.get_name()}")
        self._host = ControllerHost(node.get_name(), given)
        self._next_check, self._state = 0.0, ""  # [wall s]; of the bench
        self._realtime = RealTime()
        outlets = loop.direct_publishers(node)
        self._events = EventLog(node, outlets)
        instance = self._alive.heartbeat.instance
        answering = self.answering = AnswerServer(
            node, outlets, loop, self._host, self._observed, instance, by_call
        )
        s = self._settings
        self._status = StatusPublisher(node, self._host, s.law, self._alive, answering, s.wait_for)
        answering.missing_listeners = self._status.missing_listeners
        testbed = subscription(node, topics.TESTBED, self._on_testbed)
        self._watch = PlantWatch(loop, node, testbed, self._alive.heartbeats, s.exit_with_plant)
        subscription(node, topics.PLAN, self._on_plan)
        subscription(node, topics.BENCH_STATE, self._on_bench_state)
        self._tuning = Tuning(node, self._host, s.law, self._answer_pending, self._status.describe)

    def poll(self) -> float:
        """Look at the graph; return the wall seconds until the next look."""
        now = monotonic()
        if now >= self._next_check:
            self._status.look()
            self.answering.inactive = self._status.previous is not None
            self._watch.look()
            self.answering.look(now)
            self._next_check = now + (_POLL_PERIOD if self._status.reason else 0.2)
        return min(self._next_check - now, self.answering.fly())

    def _on_testbed(self, message: msg.Testbed) -> None:
        trust = Trust.of((self._settings.law, *self._settings.trust))
        try:
            plant = plant_description(message.settings, "/testbed", trust)
        except BadInput as error:
            self._host.ignored(topics.TESTBED, str(error))
            self._publish_events()
            return
        self._watch.seen = True
        self.answering.restart(message.period)
        name, s = self._host.name, self._settings
        self._host.notify(
            lambda values: build_controller(
                name, s.law, values, plant, f"node {name}", s.requires_plan
            ),
            len(message.appendage_names),
        )
        self.answering.look(monotonic())
        self._status.describe(new_bench=True)

    def _on_plan(self, message: msg.Plan) -> None:
        try:
            plan, of_flight = received_plan(message, f"topic {topics.PLAN}")
            rejection = self._host.adopt(plan, of_flight, message.epoch)
        except BadInput as error:
            self.node.get_logger().warning(str(error))
            return
        if rejection is not None and not self.answering.inactive:
            self._events.tell(self._host.plan_refused(message.hash, rejection))
        self._status.notify(always=True)

    def _on_bench_state(self, message: msg.BenchState) -> None:
        self._host.run_ends = message.last_tick
        if message.epoch > self._host.epoch:
            self._host.begin_epoch(message.epoch)
            self._status.describe()
        if message.state == RUNNING != self._state:
            self.answering.expect()
        self._state = message.state
        priority = priority_of(message.active == self._host.name, message.rate_factor)
        self._realtime.set_priority(priority)

    def _answer_pending(self) -> bool:
        """Answer a question that waits; return whether there was one."""
        self._alive.poll(monotonic())
        return self.answering.serve()

    def _publish_events(self) -> None:
        """Publish the events of the host."""
        while self._host.events:
            self._events.tell(self._host.events.popleft())

    def _observed(self, tick: int) -> None:
        if self._host.events:
            self._publish_events()
            self._status.describe()
        else:
            self._status.seen(tick)


def main() -> None:
    """Run the law that the parameter `law` names, else the one that the executable is called by."""
    called = Path(sys.argv[0]).name
    run_node(partial(ControllerNode, called if called in CONTROLLERS else DEFAULT))


if __name__ == "__main__":
    main()
