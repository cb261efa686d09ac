"""The services of a bench by name, called without waiting; every answer comes as a record."""

from collections.abc import Callable, Mapping
from time import monotonic
from typing import Any, NamedTuple

from flexslew_msgs import action, srv
from rclpy.action import ActionClient
from rclpy.node import Node

from flexslew_lab.console.link import Iterate, Then, Told
from flexslew_lab.ros.service_request import request_of
from flexslew_plant import topics
from flexslew_plant.errors import BadInput

SERVICES: dict[str, Any] = {
    topics.OPERATE: srv.Operate,
    topics.STEP: srv.Step,
    topics.SET_RATE: srv.SetRate,
    topics.NOTE: srv.Note,
    topics.SWITCH_CONTROLLER: srv.SwitchController,
    topics.INJECT_FAULT: srv.InjectFault,
    topics.END_FAULT: srv.EndFault,
}
TUNE = topics.TUNE.removeprefix("~")  # behind the name of a controller
PATIENCE = 10.0  # with a service that does not answer [wall s]


class _Asked(NamedTuple):
    service: str
    future: Any
    deadline: float  # [wall s]
    then: Then


class BenchClient:
    """Asks and delivers.

    Args:
        node: of this process.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._clients: dict[str, Any] = {}
        self._asked: list[_Asked] = []
        for name, kind in SERVICES.items():  # found by the time they are needed
            self._clients[name] = node.create_client(kind, name)
        self._planner = ActionClient(node, action.PlanSlew, topics.PLAN_SLEW)
        self._goal: Any = None  # that is planned for

    def ask(self, service: str, values: Mapping[str, Any], then: Then) -> None:
        """Call a service; see console.link.Link.ask."""
        kind = SERVICES.get(service)
        if kind is None and service.endswith(TUNE):
            kind = srv.Tune
        if kind is None:
            then(Told(False, f"the bench has no service {service}"))
            return
        if service not in self._clients:
            self._clients[service] = self._node.create_client(kind, service)
        client = self._clients[service]
        try:
            request = request_of(kind, values)
        except BadInput as error:
            then(Told(False, str(error)))
            return
        future = client.call_async(request)
        self._asked.append(_Asked(service, future, monotonic() + PATIENCE, then))

    def poll(self, now: float) -> None:
        """Deliver the answers that have come."""
        for asked in list(self._asked):
            if asked.future.done():
                self._asked.remove(asked)
                reply = asked.future.result()
                ok = bool(reply.ok or getattr(reply, "scheduled", False))
                asked.then(Told(ok, str(reply.message)))
            elif now > asked.deadline:
                self._asked.remove(asked)
                asked.future.cancel()
                words = f"the bench did not answer {asked.service} within {PATIENCE:g} s"
                asked.then(Told(False, words))

    def plan(self, goal: action.PlanSlew.Goal, told: Callable[[Iterate], None], then: Then) -> None:
        """Ask the planner; one plan at a time."""
        if not self._planner.server_is_ready():
            then(Told(False, "no planner is on the graph; the trial has no plan section"))
            return

        def iterate(message: Any) -> None:
            f = message.feedback
            told(Iterate(f.iteration, f.objective, f.norm_terminal_error, f.norm_input))

        def accepted(future: Any) -> None:
            self._goal = future.result()
            if not self._goal.accepted:
                then(Told(False, "the planner does not take the request"))
                return
            self._goal.get_result_async().add_done_callback(finished)

        def finished(future: Any) -> None:
            self._goal = None
            result = future.result().result
            ok = result.error_code == result.DONE
            plan = result.plan
            words = f"{plan.method}: {plan.duration:g} s from {plan.start:g} s on is published"
            then(Told(ok, words if ok else result.message))

        self._planner.send_goal_async(goal, feedback_callback=iterate).add_done_callback(accepted)

    def cancel(self) -> None:
        """Give up the plan that is being made, if any."""
        if self._goal is not None:
            self._goal.cancel_goal_async()

    def close(self) -> None:
        """Leave the graph."""
        self._planner.destroy()
