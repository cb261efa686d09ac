"""The `controller` node: any law behind the one question of the bench."""

import sys
from functools import partial
from pathlib import Path
from time import monotonic

from builtin_interfaces.msg import Time
from flexslew_msgs import msg

from flexslew_control.controllers import CONTROLLERS, build_controller, settings_text
from flexslew_control.controllers.controller import Answer
from flexslew_control.controllers.host import ControllerHost
from flexslew_control.law import described
from flexslew_control.message_fields import answer_fields, plan_of
from flexslew_control.ros.tuning import Tuning
from flexslew_plant import topics
from flexslew_plant.bench.wire import Stamp, command_bytes, measurement_from
from flexslew_plant.errors import BadInput
from flexslew_plant.ros.event_log import EventLog
from flexslew_plant.ros.graph import PlantWatch, publishers_of, unmatched
from flexslew_plant.ros.loop import Loop, run_node
from flexslew_plant.ros.messages import message_of, stamp
from flexslew_plant.ros.offers import publisher, subscription
from flexslew_plant.ros.parameters import declared, new_node, parameters_of
from flexslew_plant.settings import section

_LOOK = 0.02  # between two looks at the graph while not ready [wall s]
_RENEW = 100  # ticks between two status messages


@section
class ControllerNodeSettings:
    """The parameters of the node; those of the law stand beside them."""

    law: str = "pd_feedforward"  # a key of CONTROLLERS, or package.module.Class of your own
    requires_plan: bool = False  # not ready without a plan
    wait_for: tuple[str, ...] = ()  # nodes that must listen to its answers before it is ready
    exit_with_plant: bool = False  # end the process when the plant is gone


class ControllerNode:
    """Answers `measurement` on `effort_command` when it is named."""

    def __init__(self, law: str, loop: Loop) -> None:
        self.node = node = new_node(law)
        self._alive = loop.live(node, "controller")
        given = parameters_of(node)
        own = {k: given.pop(k) for k in ControllerNodeSettings.__annotations__ if k in given}
        self._settings = declared(node, ControllerNodeSettings, {"law": law, **own})
        self._host = ControllerHost(node.get_name(), given)
        self._period = 0.01
        self._last_reason: str | None = None
        self._settings_text = ""
        self._next_look = 0.0
        self._plan_hash = ""  # of the newest plan
        self._elder = ""  # why this one steps back for another one of its name
        self._heard = False  # by all who must listen to its answers
        self._last_status_tick = 0
        self._events = EventLog(node)
        self._state = publisher(node, topics.CONTROLLER_STATE)
        self._command = publisher(node, topics.EFFORT_COMMAND)
        self._status = publisher(node, topics.CONTROLLER_STATUS)
        self._measurement = subscription(node, topics.MEASUREMENT, self._on_measurement, raw=True)
        self._watch = PlantWatch(loop, self._measurement, self._settings.exit_with_plant)
        subscription(node, topics.TESTBED, self._on_testbed)
        subscription(node, topics.PLAN, self._on_plan)
        self._tuning = Tuning(node, self._host, self._settings.law)

    def poll(self) -> float:
        """Look at the graph; return the wall seconds until the next look."""
        now = monotonic()
        if now >= self._next_look:
            self._step_back()
            self._announce()
            self._watch.look()
            self._next_look = now + (_LOOK if self._last_reason else 0.2)
        return self._next_look - now

    def close(self) -> None:
        """Leave the graph."""
        self.node.destroy_node()

    def _step_back(self) -> None:
        """Say nothing while an older node of this name is alive: the bench could not tell whom."""
        elder, self._elder = self._elder, self._alive.elder
        if self._elder and not elder:
            self.node.get_logger().error(f"{self._elder}; this one steps back")

    def _reason(self) -> str:
        if self._elder or self._host.reason:
            return self._elder or self._host.reason
        if self._heard:
            return ""
        plant = publishers_of(self.node, self._measurement)
        missing = unmatched(self.node, [self._command], [*plant, *self._settings.wait_for])
        missing += unmatched(self.node, [self._state], self._settings.wait_for)
        self._heard = bool(plant) and not missing
        return f"not heard by {', '.join(sorted(set(missing)) or ['a plant'])}" * (not self._heard)

    def _announce(self, always: bool = False) -> None:
        reason = self._reason()
        if (reason == self._last_reason and not always) or self._elder:
            return
        self._last_reason = reason
        host = self._host
        self._last_status_tick = host.last_tick
        self._status.publish(
            msg.ControllerStatus(
                stamp=stamp(host.last_tick * self._period),
                controller=host.name,
                law=self._settings.law,
                ready=not reason,
                reason=reason,
                last_tick=host.last_tick,
                epoch=host.epoch,
                plan_hash=self._plan_hash,
                settings=self._settings_text,
            )
        )

    def _on_testbed(self, message: msg.Testbed) -> None:
        self._period, self._heard = message.period, False
        plant = described(message.settings, "/testbed")
        self._host.announce(
            lambda values: build_controller(
                self._host.name,
                self._settings.law,
                values,
                plant,
                f"node {self._host.name}",
                self._settings.requires_plan,
            ),
            len(message.appendage_names),
        )
        self._describe()

    def _describe(self) -> None:
        """Announce what is computed from the settings that hold now."""
        host = self._host
        if host.controller is not None:
            self._settings_text = settings_text(host.controller, self._settings.law, host.values)
        self._announce(always=True)

    def _on_plan(self, message: msg.Plan) -> None:
        try:
            refused = self._host.adopt(plan_of(message, f"topic {topics.PLAN}"))
        except BadInput as error:
            self.node.get_logger().warning(str(error))
            return
        self._plan_hash = message.hash
        if refused:
            self.node.get_logger().warning(f"plan refused: {refused}")
        self._announce(always=True)

    def _on_measurement(self, data: bytes) -> None:
        host = self._host
        question, at = measurement_from(data, self._period)
        answer = host.observe(question)
        if answer is not None and not self._elder:
            self._command.publish(command_bytes(answer.command, at))
            self._publish_state(answer, at)
        if host.events:
            self._events.tell(host.events.popleft())
            self._describe()
        elif question.tick >= self._last_status_tick + _RENEW or question.tick == 0:
            self._announce(always=True)

    def _publish_state(self, answer: Answer, at: Stamp) -> None:
        state = message_of(msg.ControllerState, answer_fields(answer))
        state.header.stamp = Time(sec=at.sec, nanosec=at.nanosec)
        self._state.publish(state)


def main() -> None:
    """Run the law that the parameter `law` names, else the one that the executable is called by."""
    called = Path(sys.argv[0]).name
    run_node(partial(ControllerNode, called if called in CONTROLLERS else "pd_feedforward"))


if __name__ == "__main__":
    main()
