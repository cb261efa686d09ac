"""The `controller` node: any law behind the one question of the bench."""

from functools import partial
from time import monotonic
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from flexslew_msgs import msg

from flexslew_control.controllers import build_controller, settings_text
from flexslew_control.controllers.controller import Answer, Controller
from flexslew_control.ros.plan_message import plan_of
from flexslew_plant import topics
from flexslew_plant.bench.wire import Stamp, command_bytes, measurement_from
from flexslew_plant.ros.node import (
    LOOP,
    Loop,
    PlantWatch,
    declared,
    doubles,
    latched,
    new_node,
    parameters_of,
    run_node,
    stamp,
    unmatched,
)
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
        loop.add(node)
        given = parameters_of(node)
        own = {k: given.pop(k) for k in ControllerNodeSettings.__annotations__ if k in given}
        self._settings = declared(node, ControllerNodeSettings, {"law": law, **own})
        self._law_values: dict[str, Any] = given
        self._name: str = node.get_name()
        self._controller: Controller | None = None
        self._appendages = 0  # of the bench
        self._plan: msg.Plan | None = None
        self._plan_refused = ""
        self._last_reason: str | None = None
        self._settings_text = ""
        self._next_look = 0.0
        self._heard = False  # by all who must listen to its answers
        self._last_status_tick = 0
        self._epoch = 0
        self._state = node.create_publisher(msg.ControllerState, topics.CONTROLLER_STATE, LOOP)
        self._command = node.create_publisher(msg.EffortCommand, topics.EFFORT_COMMAND, LOOP)
        self._status = node.create_publisher(
            msg.ControllerStatus, topics.CONTROLLER_STATUS, latched(1)
        )
        measurement = node.create_subscription(
            msg.Measurement, topics.MEASUREMENT, self._on_measurement, LOOP, raw=True
        )
        self._watch = PlantWatch(loop, measurement, self._settings.exit_with_plant)
        node.create_subscription(msg.Testbed, topics.TESTBED, self._on_testbed, latched(1))
        node.create_subscription(msg.Plan, topics.PLAN, self._on_plan, latched(1))

    def poll(self) -> float:
        """Look at the graph; return the wall seconds until the next look."""
        now = monotonic()
        if now >= self._next_look:
            self._announce()
            self._watch.look()
            self._next_look = now + (_LOOK if self._last_reason else 0.2)
        return self._next_look - now

    def close(self) -> None:
        """Leave the graph."""
        self.node.destroy_node()

    def _reason(self) -> str:
        if self._controller is None:
            return "no testbed announced yet"
        if self._controller.reason:
            return self._plan_refused or self._controller.reason
        if self._heard:
            return ""
        missing = unmatched(self.node, [self._command], ["plant", *self._settings.wait_for])
        missing += unmatched(self.node, [self._state], self._settings.wait_for)
        self._heard = not missing
        return f"not heard by {', '.join(sorted(set(missing)))}" if missing else ""

    def _announce(self, always: bool = False) -> None:
        reason = self._reason()
        if reason == self._last_reason and not always:
            return
        self._last_reason = reason
        controller = self._controller
        tick = max(controller.last_tick, 0) if controller else 0
        self._last_status_tick = tick
        self._status.publish(
            msg.ControllerStatus(
                stamp=stamp(tick * controller.period if controller else 0.0),
                controller=self._name,
                law=self._settings.law,
                ready=not reason,
                reason=reason,
                last_tick=tick,
                epoch=self._epoch,
                plan_hash=self._plan.hash if self._plan else "",
                settings=self._settings_text,
            )
        )

    def _on_testbed(self, message: msg.Testbed) -> None:
        self._controller = build_controller(
            self._name,
            self._settings.law,
            self._law_values,
            tuple(message.joint_names),
            message.period,
            tuple(message.effort_limit),
            f"node {self._name}",
            self._settings.requires_plan,
        )
        self._settings_text = settings_text(self._controller, self._settings.law, self._law_values)
        self._appendages = len(message.appendage_names)
        self._controller.warm(self._appendages)
        self._adopt()

    def _on_plan(self, message: msg.Plan) -> None:
        self._plan = message
        self._adopt()

    def _adopt(self) -> None:
        if self._controller is not None and self._plan is not None:
            self._plan_refused = self._controller.adopt(plan_of(self._plan))
            if self._controller.last_tick < 0:
                self._controller.warm(self._appendages)  # on the plan that it will follow
            if self._plan_refused:
                self.node.get_logger().warning(f"plan refused: {self._plan_refused}")
        self._announce(always=True)

    def _on_measurement(self, data: bytes) -> None:
        controller = self._controller
        if controller is None:
            return
        question, at = measurement_from(data, controller.period)
        self._epoch = question.epoch
        answer = controller.observe(question)
        if answer is not None:
            self._command.publish(command_bytes(answer.command, at))
            self._publish_state(answer, at)
        if question.tick >= self._last_status_tick + _RENEW or question.tick == 0:
            self._announce(always=True)

    def _publish_state(self, answer: Answer, at: Stamp) -> None:
        command, reference, estimate = answer.command, answer.reference, answer.estimate
        state = msg.ControllerState(
            tick=command.tick,
            epoch=command.epoch,
            controller=self._name,
            reference_position=doubles(reference.position),
            reference_velocity=doubles(reference.velocity),
            feedforward=doubles(reference.effort),
            estimate_position=doubles(estimate.position),
            estimate_velocity=doubles(estimate.velocity),
            estimate_disturbance=doubles(estimate.disturbance),
            covariance_diagonal=doubles(np.diagonal(estimate.covariance)),
            innovation=doubles(estimate.innovation),
            nis=estimate.nis,
            effort=doubles(command.effort),
            term_names=list(answer.terms),
            terms=doubles(np.concatenate(list(answer.terms.values()))) if answer.terms else [],
        )
        state.header.stamp = Time(sec=at.sec, nanosec=at.nanosec)
        self._state.publish(state)


def _main(law: str) -> None:
    run_node(partial(ControllerNode, law))


def main() -> None:
    """Run the law that the parameter `law` names."""
    _main("pd_feedforward")


def pd_feedforward() -> None:
    """Run PD + feedforward."""
    _main("pd_feedforward")


def output_feedback() -> None:
    """Run output feedback control."""
    _main("output_feedback")


def proportional_integral() -> None:
    """Run the disturbance-accommodating PI law."""
    _main("proportional_integral")


def lqr() -> None:
    """Run the linear-quadratic regulator."""
    _main("lqr")


def collocated_pid() -> None:
    """Run the collocated PID."""
    _main("collocated_pid")


if __name__ == "__main__":
    main()
