"""The services of the bench for the clients of the `live` node, as JSON."""

import json
from collections import deque
from concurrent.futures import Future
from functools import partial
from typing import Any

from rclpy.node import Node

from flexslew_lab.console.link import Told
from flexslew_lab.ros.bench_client import PATIENCE, SERVICES, BenchClient

_KINDS = {"string": "string", "boolean": "boolean", "double": "number"}  # of JSON; else integer
_AT = "builtin_interfaces/Time"


class LiveServices:
    """Hands calls from the server's threads to the node's, and the answers back.

    Args:
        node: of this process.
    """

    def __init__(self, node: Node) -> None:
        self._client = BenchClient(node)
        self._calls: deque[tuple[str, dict[str, Any], Future[Told]]] = deque()

    def offered(self, foxglove: Any) -> list[Any]:
        """Return the services as the server's library takes them."""
        return [self._service(foxglove, name, kind) for name, kind in SERVICES.items()]

    def poll(self, now: float) -> None:
        """Ask the bench for what clients have called, and deliver its answers."""
        while self._calls:
            name, values, answer = self._calls.popleft()
            self._client.ask(name, values, answer.set_result)
        self._client.poll(now)

    def close(self) -> None:
        """Leave the graph."""
        self._client.close()

    def _service(self, foxglove: Any, name: str, kind: Any) -> Any:
        fields = kind.Request.get_fields_and_field_types()
        keys = {
            key: {"type": "number" if of == _AT else _KINDS.get(of, "integer")}
            for key, of in fields.items()
        }
        told = {"ok": {"type": "boolean"}, "message": {"type": "string"}}
        request, response = (
            foxglove.MessageSchema(
                encoding="json",
                schema=foxglove.Schema(
                    name=f"{name}.{part}",
                    encoding="jsonschema",
                    data=json.dumps({"type": "object", "properties": properties}).encode(),
                ),
            )
            for part, properties in (("request", keys), ("response", told))
        )
        schema = foxglove.ServiceSchema(name, request=request, response=response)
        return foxglove.Service(f"/{name}", schema=schema, handler=partial(self._call, name))

    def _call(self, name: str, request: Any) -> bytes:
        """Return the answer to a call; runs in a thread of the server."""
        answer: Future[Told] = Future()
        try:
            values = json.loads(bytes(request.payload) or b"{}")
        except ValueError:
            values = None
        if not isinstance(values, dict):
            return json.dumps({"ok": False, "message": "give a JSON object"}).encode()
        self._calls.append((name, values, answer))
        return json.dumps(answer.result(2.0 * PATIENCE)._asdict()).encode()
