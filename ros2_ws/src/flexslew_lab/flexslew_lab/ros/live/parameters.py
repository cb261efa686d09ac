"""The parameters of all nodes of the bench for the clients of the `live` node."""

from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future
from math import isfinite
from typing import Any

from rcl_interfaces.msg import ParameterEvent
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import qos_profile_parameter_events

from flexslew_lab.ros.bench_client import PATIENCE

_POLL_PERIOD = 0.5  # between two polls at the graph [wall s]
_KIND = "rcl_interfaces/srv/SetParameters"
_SERVICE = "/set_parameters"


class LiveParameters:
    """Holds all parameters by `/node.parameter`, and sets them; server threads may call it.

    Args:
        node: of this process.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._clients: dict[str, AsyncParameterClient] = {}  # by node
        self._request_times: dict[str, float] = {}  # node to time of the last request [wall s]
        self._known_nodes: set[str] = set()  # nodes that have sent their parameters
        self._values: dict[str, Any] = {}
        self._changed: set[str] = set()
        self._requests: deque[tuple[str, Any, Future[str]]] = deque()
        self._next_poll = 0.0
        node.create_subscription(
            ParameterEvent, "/parameter_events", self._on_event, qos_profile_parameter_events
        )

    def poll(self, now: float) -> dict[str, Any]:
        """Look for nodes and set what was requested; return what has changed since the last."""
        while self._requests:
            self._set(*self._requests.popleft())
        if now >= self._next_poll:
            self._next_poll = now + _POLL_PERIOD
            self._find_nodes(now)
        changed, self._changed = self._changed, set()
        return {name: self._values[name] for name in sorted(changed)}

    def values(self, names: Sequence[str]) -> dict[str, Any]:
        """Return parameters by name, those that are known; no names: all of them."""
        known = dict(self._values)
        return {name: known[name] for name in names or sorted(known) if name in known}

    def set(self, name: str, value: Any) -> str:
        """Set a parameter; return why not, or an empty text. Not for the node's own thread."""
        answer: Future[str] = Future()
        self._requests.append((name, value, answer))
        try:
            return answer.result(PATIENCE)
        except TimeoutError:
            return f"{name}: its node did not answer within {PATIENCE:g} s"

    def _find_nodes(self, now: float) -> None:
        for name, kinds in self._node.get_service_names_and_types():
            node = name.removesuffix(_SERVICE)
            if (
                kinds != [_KIND]
                or node in self._known_nodes
                or node == self._node.get_fully_qualified_name()
            ):
                continue
            if node not in self._clients:
                self._clients[node] = AsyncParameterClient(self._node, node)
            client = self._clients[node]
            if (
                client.services_are_ready()
                and now >= self._request_times.get(node, -PATIENCE) + PATIENCE
            ):
                self._request_times[node] = now
                self._request_parameters(node, client)

    def _request_parameters(self, node: str, client: AsyncParameterClient) -> None:
        """Ask a node for all that it has."""

        def on_list(future: Any) -> None:
            names = list(future.result().result.names)

            def got(future: Any) -> None:
                self._known_nodes.add(node)
                pairs = zip(names, future.result().values, strict=True)
                self._keep({f"{node}.{name}": value for name, value in pairs})

            client.get_parameters(names).add_done_callback(got)

        client.list_parameters().add_done_callback(on_list)

    def _on_event(self, event: ParameterEvent) -> None:
        if event.node in self._clients:
            new_values = (*event.new_parameters, *event.changed_parameters)
            self._keep({f"{event.node}.{one.name}": one.value for one in new_values})

    def _keep(self, new_values: dict[str, Any]) -> None:
        """Take values by name, all at once: server threads see none or all of a node."""
        found = {
            name: _plain(parameter_value_to_python(value)) for name, value in new_values.items()
        }
        self._values.update(found)
        self._changed |= found.keys()

    def _set(self, name: str, value: Any, answer: Future[str]) -> None:
        node, _, parameter_name = name.partition(".")
        if name not in self._values:
            answer.set_result(f"{name}: there is no such parameter")
            return
        try:
            parameter = Parameter(parameter_name, value=_typed(value, self._values[name]))
        except (TypeError, ValueError) as error:
            answer.set_result(f"{name}: {value!r:.60} is not allowed: {error}")
            return

        def done(future: Any) -> None:
            [result] = future.result().results
            if result.successful:
                self._keep({name: parameter.get_parameter_value()})
            answer.set_result("" if result.successful else f"{name}: {result.reason}")

        self._clients[node].set_parameters([parameter]).add_done_callback(done)


def _plain(value: Any) -> Any:
    """Return a value as JSON can have it: arrays as lists, what is no number as text."""
    if isinstance(value, float) and not isfinite(value):
        return str(value)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if all(not isinstance(one, float) or isfinite(one) for one in value):
        return list(value)
    return [str(one) for one in value]


def _typed(value: Any, now: Any) -> Any:
    """Return a value in the type of the parameter: JSON has no difference between 2 and 2.0."""
    if isinstance(value, list) and isinstance(now, list):
        return [_typed(one, now[0] if now else one) for one in value]
    number = isinstance(value, int) and not isinstance(value, bool)
    return float(value) if number and isinstance(now, float) else value
