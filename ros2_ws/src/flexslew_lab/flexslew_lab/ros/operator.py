"""Requests of an operator to a running bench, as short-lived service clients.

Only messages are imported here: an answer takes well under a second.
"""

import atexit
import getpass
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from time import monotonic, sleep
from typing import Any

import rclpy
from flexslew_msgs import srv
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from flexslew_lab.ros.service_request import SERVICES, is_accepted, request_of
from flexslew_plant.errors import FlexslewError
from flexslew_plant.graph import topics
from flexslew_plant.graph.graph_names import require_name
from flexslew_plant.network import require_loopback
from flexslew_plant.refusal import Refusal, Reply
from flexslew_plant.ros.start import start_ros

PATIENCE = 5.0  # for the plant to be found and to answer [wall s]
_connections: dict[tuple[int, str], tuple[list[Node], float]] = {}  # by domain and namespace
_MIN_NODES, _OTHERS = 2, 1.0  # nodes that look for every bench; for one more to be seen [wall s]
_RETRY = 0.25  # until another node tries to connect, then twice that, and so on [wall s]


class Operator:
    """One connection to a bench.

    Args:
        domain: ROS_DOMAIN_ID of the bench.
        namespace: of its names; empty: none.
        patience: until the bench must be found and must have answered [wall s].
    """

    def __init__(self, domain: int, namespace: str, patience: float) -> None:
        self._domain, self._namespace, self._patience = domain, namespace, patience
        # nodes on the graph, all with one name; and when to add another if none is known
        self.nodes, self._next_node_time = _connections.pop((domain, namespace), ([], 0.0))
        self._who = _user()

    def act(self, action: str) -> Reply:
        """Start, pause, reset, brake or release the brake."""
        return self._request(topics.OPERATE, action=action)

    def act_everywhere(self, action: str) -> Iterator[tuple[str, Reply]]:
        """Yield the namespace of each bench on the graph, and its answer to an action.

        A connection to one namespace sends the action to the bench in it alone.

        Raises:
            FlexslewError: there is none.
        """
        if self._namespace:
            yield f"/{self._namespace}", self.act(action)
            return
        requested, end = set[str](), monotonic() + self._patience
        self.nodes += [_new_node(self._domain, "") for _ in range(_MIN_NODES - len(self.nodes))]
        while monotonic() <= end:
            for place in sorted(self._places(topics.OPERATE) - requested):
                requested.add(place)
                try:
                    yield place, self._request(topics.OPERATE, f"{place}/", action=action)
                except FlexslewError as error:  # the others are called all the same
                    yield place, Reply(refused=Refusal(str(error)))
                end = min(end, monotonic() + _OTHERS)
            sleep(0.02)
        if not requested:
            raise FlexslewError(f"no bench is on ROS_DOMAIN_ID {self._domain}")

    def step(self, ticks: int) -> Reply:
        """Advance a paused bench by some ticks."""
        return self._request(topics.STEP, ticks=ticks)

    def inject(self, fault: str, at: float) -> Reply:
        """Break or disturb something, as YAML in a schedule has it, at a simulated time [s]."""
        return self._request(topics.INJECT_FAULT, fault=fault, at=at)

    def retarget(self, target: str, at: float) -> Reply:
        """Give an appendage a new target, as YAML in a schedule has it, at a simulated time [s]."""
        return self._request(topics.RETARGET, target=target, at=at)

    def controllers(self) -> tuple[str, list[dict[str, Any]]]:
        """Return the active controller and the status of every controller."""
        reply = self._call(
            srv.ListControllers, topics.LIST_CONTROLLERS, srv.ListControllers.Request()
        )
        keys = ("controller", "law", "ready", "reason", "last_tick", "plan_hash")
        return reply.active, [{key: getattr(c, key) for key in keys} for c in reply.controllers]

    def switch(self, controller: str, at: float, strict: bool, max_effort_step: float) -> Reply:
        """Give the bench to another controller.

        Args:
            controller: name of the next controller.
            at: simulated time [s]; 0: the next tick.
            strict: refuse a step of the effort above max_effort_step.
            max_effort_step: [N m or N].
        """
        return self._request(
            topics.SWITCH_CONTROLLER,
            controller=controller,
            at=at,
            strict=strict,
            max_effort_step=max_effort_step,
            timeout=self._patience / 10.0,
        )

    def close(self) -> None:
        """Leave the graph."""
        _destroy_nodes(self.nodes)

    def _request(self, service: str, place: str = "", **values: Any) -> Reply:
        """Call a service, here or at an absolute place, with plain values; return its answer."""
        kind = SERVICES[service]
        request = request_of(kind.Request, {**values, "who": self._who})
        reply = self._call(kind, place + service, request)
        words = str(reply.message)
        return Reply(words) if is_accepted(reply) else Reply(refused=Refusal(words))

    def _call(self, kind: Any, name: str, request: Any) -> Any:
        node, client = self._find_node(kind, name)
        executor = SingleThreadedExecutor(context=node.context)
        future = client.call_async(request)
        rclpy.spin_until_future_complete(node, future, executor, self._patience)
        if not future.done():
            raise FlexslewError(f"the bench did not answer {name} within {self._patience:g} s")
        return future.result()

    def _find_node(self, kind: Any, name: str) -> tuple[Node, Any]:
        """Return a node that the bench has discovered, and its client.

        Once in ten times a newcomer misses the answer to its announcement and would have to wait
        for the plant's next one, up to 3 s; another newcomer most likely does not.
        """
        clients = [(node, node.create_client(kind, name)) for node in self.nodes]
        now, wait = monotonic(), _RETRY
        end, retry_time = now + self._patience, self._next_node_time or now + wait * bool(clients)
        self._next_node_time = 0.0
        while True:
            for node, client in clients:
                if client.service_is_ready():
                    return node, client
            now = monotonic()
            if now > end:
                raise FlexslewError(f"no bench offers {name}; {self._hint(name)}")
            if now >= retry_time:
                self.nodes.append(_new_node(self._domain, self._namespace))
                clients.append((self.nodes[-1], self.nodes[-1].create_client(kind, name)))
                retry_time, wait = now + wait, 2.0 * wait
            sleep(0.002)

    def _hint(self, service: str) -> str:
        """Return how a bench is found, where none offers a service here."""
        others = ", ".join(sorted(place.strip("/") for place in self._places(service)))
        if others:
            return f"benches are in other namespaces: --namespace {others}"
        return "is one running, and with the same ROS_DOMAIN_ID?"

    def _places(self, service: str) -> set[str]:
        """Return in which namespaces a service is on the graph; "" is none."""
        return {
            name.removesuffix(f"/{service}")
            for node in self.nodes
            for name, _ in node.get_service_names_and_types()
            if name.endswith(f"/{service}") and node.count_services(name)  # else clients only
        }


def _new_node(domain: int, namespace: str) -> Node:
    context = rclpy.Context()
    start_ros(context=context, domain_id=domain)
    node = rclpy.create_node(
        "operator",
        context=context,
        namespace=namespace,
        start_parameter_services=False,
        enable_rosout=False,
        enable_logger_service=False,
    )
    require_loopback()
    return node


def join_graph(domain: int) -> None:
    """Join the graph of a bench without a namespace, for the first connection to it."""
    nodes = [_new_node(domain, "")]
    _connections[domain, ""] = nodes, monotonic() + _RETRY
    atexit.register(_destroy_nodes, nodes)


def _destroy_nodes(nodes: list[Node]) -> None:
    while nodes:
        node = nodes.pop()
        node.destroy_node()
        node.context.try_shutdown()


@contextmanager
def connected(domain: int, namespace: str = "", patience: float = PATIENCE) -> Iterator[Operator]:
    """Yield a connection to the bench of a domain.

    Args:
        domain: ROS_DOMAIN_ID of the bench.
        namespace: of its names; empty: none.
        patience: until it must be found and must have answered [wall s].

    Raises:
        FlexslewError: from the connection's calls, where there is no bench.
    """
    if namespace.strip("/"):
        require_name(namespace.strip("/"), "--namespace")
    operator = Operator(domain, namespace.strip("/"), patience)
    try:
        yield operator
    finally:
        operator.close()


def _user() -> str:
    with suppress(KeyError, OSError):  # an id without a name
        return getpass.getuser()
    return ""
