"""The services of the bench for the clients of the `live` node, as JSON."""

import json
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import Any

from flexslew_msgs import action, msg, srv
from rclpy.node import Node

from flexslew_lab.console.link import RequestResult
from flexslew_lab.ros.bench_client import PATIENCE, TUNE, BenchClient
from flexslew_lab.ros.service_request import SERVICES, request_of
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics
from flexslew_plant.ros.offers import subscription

_KINDS = {"string": "string", "boolean": "boolean", "double": "number"}  # of JSON; else integer
_AT = "builtin_interfaces/Time"
_REPLY_FIELDS = {"ok": "boolean", "message": "string", "tick": "uint64"}
_POLL_PERIOD = 0.5  # between two polls for controllers [wall s]
_PLAN_ACTIONS = (topics.PLAN_SLEW, topics.DRAFT_PLAN)
_PLAN_TIMEOUT = 600.0  # how long a plan may take [wall s]


class LiveServices:
    """Hands calls from the server's threads to the node's, and the answers back.

    Args:
        node: of this process.
        foxglove: the library of the server.
    """

    def __init__(self, node: Node, foxglove: Any) -> None:
        self._node, self._foxglove = node, foxglove
        self._client = BenchClient(node)
        self._calls: deque[tuple[str, dict[str, Any], Future[RequestResult]]] = deque()
        self._testbed = msg.Testbed()
        self._known_services: set[str] = set()  # controllers' services that are offered
        self._next_poll = 0.0
        subscription(node, topics.TESTBED, self._on_testbed)

    def all_services(self) -> list[Any]:
        """Return the services as the server's library takes them; an action answers once."""
        plan_services = [self._service(name, action.PlanSlew.Goal) for name in _PLAN_ACTIONS]
        return plan_services + [
            self._service(name, kind.Request) for name, kind in SERVICES.items()
        ]

    def poll(self, now: float, add: Callable[[list[Any]], None] | None) -> None:
        """Ask the bench for what clients have called, and deliver its answers.

        Args:
            now: [wall s].
            add: takes services of controllers that have come; None: nothing is offered.
        """
        while self._calls:
            name, values, answer = self._calls.popleft()
            if name in _PLAN_ACTIONS:
                self._plan(name, values, answer)
            else:
                self._client.ask(name, values, answer.set_result)
        self._client.poll(now)
        if add is not None and now >= self._next_poll:
            self._next_poll = now + _POLL_PERIOD
            found = [self._service(name, srv.Tune.Request) for name in self._new_controllers()]
            if found:
                add(found)

    def close(self) -> None:
        """Leave the graph."""
        self._client.close()

    def _new_controllers(self) -> list[str]:
        space = self._node.get_namespace().rstrip("/") + "/"
        available = {
            name.removeprefix(space)
            for name, kinds in self._node.get_service_names_and_types()
            if kinds == ["flexslew_msgs/srv/Tune"] and name.startswith(space)
        }
        found = sorted(name for name in available - self._known_services if name.endswith(TUNE))
        self._known_services.update(found)
        return found

    def _on_testbed(self, testbed: Any) -> None:
        self._testbed = testbed

    def _plan(self, name: str, values: dict[str, Any], answer: Future[RequestResult]) -> None:
        """Request a plan; without ticks and drives of the client, those of the bench are used."""
        bench = {"period": self._testbed.period, "effort_limit": [*self._testbed.effort_limit]}
        try:
            goal = request_of(action.PlanSlew.Goal, {**bench, **values})
        except BadInput as error:
            answer.set_result(RequestResult(False, str(error)))
            return
        self._client.plan(
            name, goal, lambda news: None, lambda result, plan: answer.set_result(result)
        )

    def _service(self, name: str, request: Any) -> Any:
        fields = request.get_fields_and_field_types()
        keys = {key: _type_of(of) for key, of in fields.items()}
        reply = {key: _type_of(of) for key, of in _REPLY_FIELDS.items()}
        schemas = {
            part: self._foxglove.MessageSchema(
                encoding="json",
                schema=self._foxglove.Schema(
                    name=f"{name}.{part}",
                    encoding="jsonschema",
                    data=json.dumps({"type": "object", "properties": properties}).encode(),
                ),
            )
            for part, properties in (("request", keys), ("response", reply))
        }
        schema = self._foxglove.ServiceSchema(name, **schemas)
        handler = partial(self._call, name)
        return self._foxglove.Service(f"/{name}", schema=schema, handler=handler)

    def _call(self, name: str, request: Any) -> bytes:
        """Return the answer to a call; runs in a thread of the server."""
        answer: Future[RequestResult] = Future()
        try:
            values = json.loads(bytes(request.payload) or b"{}")
        except ValueError:
            values = None
        if not isinstance(values, dict):
            return json.dumps({"ok": False, "message": "give a JSON object"}).encode()
        self._calls.append((name, values, answer))
        patience = _PLAN_TIMEOUT if name in _PLAN_ACTIONS else 2.0 * PATIENCE
        return json.dumps(answer.result(patience)._asdict()).encode()


def _type_of(field: str) -> dict[str, Any]:
    """Return the JSON schema of a field."""
    if field.startswith("sequence<"):
        return {"type": "array", "items": _type_of(field[9:-1])}
    return {"type": "number" if field == _AT else _KINDS.get(field, "integer")}
