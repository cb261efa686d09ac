"""The services of a bench by name, called without waiting; every answer comes as a record."""

from collections.abc import Callable, Mapping
from time import monotonic
from typing import Any, NamedTuple

from flexslew_msgs import action, srv
from rclpy.action import ActionClient
from rclpy.node import Node

from flexslew_lab.console.link import (
    DRAFTED,
    Iterate,
    PlanCallback,
    RequestResult,
    Then,
    plan_outcome,
)
from flexslew_lab.ros.service_request import SERVICES, is_accepted, request_of
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics

TUNE = topics.TUNE.removeprefix("~")  # behind the name of a controller
PATIENCE = 10.0  # with a service that does not answer [wall s]


class _PendingRequest(NamedTuple):
    service: str
    request: Any
    deadline: float  # [wall s]
    then: Then
    future: Any = None  # None: the service has not been found yet


class BenchClient:
    """Sends requests to the bench, and delivers its answers.

    Args:
        node: of this process.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._clients: dict[str, Any] = {}
        self._pending: list[_PendingRequest] = []
        for name, kind in SERVICES.items():  # found by the time they are needed
            self._clients[name] = node.create_client(kind, name)
        self._plan_clients = {
            name: ActionClient(node, action.PlanSlew, name)
            for name in (topics.PLAN_SLEW, topics.DRAFT_PLAN)
        }
        self._goal: Any = None  # that is planned for
        self._plan_requests: list[tuple[str, PlanCallback]] = []  # plans under way, by action

    def ask(self, service: str, values: Mapping[str, Any], then: Then) -> None:
        """Call a service; see console.link.Link.ask."""
        kind = SERVICES.get(service)
        if kind is None and service.endswith(TUNE):
            kind = srv.Tune
        if kind is None:
            then(RequestResult(False, f"the bench has no service {service}"))
            return
        if service not in self._clients:
            self._clients[service] = self._node.create_client(kind, service)
        try:
            request = request_of(kind.Request, values)
        except BadInput as error:
            then(RequestResult(False, str(error)))
            return
        self._pending.append(_PendingRequest(service, request, monotonic() + PATIENCE, then))
        self._send()

    def poll(self, now: float) -> None:
        """Deliver the answers that have come; a planner that has died gives none."""
        self._send()
        for name, then in list(self._plan_requests):
            if not self._plan_clients[name].server_is_ready():
                self._plan_requests.remove((name, then))
                then(RequestResult(False, "the planner has left the graph; ask again"), None)
        for pending in list(self._pending):
            if pending.future is not None and pending.future.done():
                self._pending.remove(pending)
                reply = pending.future.result()
                tick = int(getattr(reply, "tick", 0))
                pending.then(RequestResult(is_accepted(reply), str(reply.message), tick))
            elif now > pending.deadline:
                self._pending.remove(pending)
                if pending.future is not None:
                    self._clients[pending.service].remove_pending_request(pending.future)
                outcome = "offer" if pending.future is None else "answer"
                words = f"the bench did not {outcome} {pending.service} within {PATIENCE:g} s"
                pending.then(RequestResult(False, words))

    def _send(self) -> None:
        """Call the services on the graph by now: requests to others would be lost."""
        for k, pending in enumerate(self._pending):
            client = self._clients[pending.service]
            if pending.future is None and client.service_is_ready():
                self._pending[k] = pending._replace(future=client.call_async(pending.request))

    def plan(
        self,
        name: str,
        goal: action.PlanSlew.Goal,
        progress: Callable[[Iterate], None],
        then: PlanCallback,
    ) -> None:
        """Ask the planner for one plan by the name of its action."""
        if not self._plan_clients[name].server_is_ready():
            then(
                RequestResult(False, "no planner is on the graph; the trial has no plan section"),
                None,
            )
            return

        self._plan_requests.append((name, then))

        def answer(result: RequestResult, plan: Any = None) -> None:
            self._goal = None
            if (name, then) in self._plan_requests:
                self._plan_requests.remove((name, then))
                then(result, plan)

        def iterate(message: Any) -> None:
            f = message.feedback
            progress(Iterate(f.iteration, f.objective, f.norm_terminal_error, f.norm_input))

        def accepted(future: Any) -> None:
            self._goal = future.result()
            if not self._goal.accepted:
                answer(RequestResult(False, "the planner does not take the request"))
                return
            self._goal.get_result_async().add_done_callback(finished)

        def finished(future: Any) -> None:
            result = future.result().result
            ok = result.error_code == result.DONE
            plan = result.plan
            outcome = "published" if name == topics.PLAN_SLEW else DRAFTED
            words = plan_outcome(plan, outcome, result.message) if ok else result.message
            answer(RequestResult(ok, words), plan if ok else None)

        goal_future = self._plan_clients[name].send_goal_async(goal, feedback_callback=iterate)
        goal_future.add_done_callback(accepted)

    def cancel(self) -> None:
        """Give up the plan that is being made, if any."""
        if self._goal is not None:
            self._goal.cancel_goal_async()

    def close(self) -> None:
        """Leave the graph."""
        for planner in self._plan_clients.values():
            planner.destroy()
