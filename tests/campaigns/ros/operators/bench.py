"""A bench in an operator's hands: what it shows, what it answers, who of its nodes lives."""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from time import monotonic
from typing import Any

from flexslew_msgs import action, msg, srv
from rclpy.action import ActionClient
from rclpy.task import Future

from flexslew_plant.graph import topics
from flexslew_plant.refusal import NO_TESTBED
from flexslew_plant.ros.offers import subscription
from tests.ros.bystander import Bystander, beside
from tests.ros.flight import again, fork_server
from tests.ros.one_by_one import CONTROLLER, PLANNER

PLANNER_NODE = "planner"
NOTHING = action.PlanSlew.Goal(request="{")  # which is refused
ANSWER = 2.0  # of a newcomer, until it is asked again [wall s]


class OperatedBench:
    """What two operators see of a bench, and its processes.

    Args:
        first, second: their nodes; the first one listens.
        pids: of the bench's nodes, by name.
        folder: of the flight.
        domain: ROS_DOMAIN_ID of the bench.

    Attributes:
        state: of the bench, as it was told last.
        dead: who was killed and not started again.
    """

    def __init__(
        self,
        first: Bystander,
        second: Bystander,
        pids: dict[str, int],
        folder: Path,
        domain: int,
    ) -> None:
        self.first, self.second = first, second
        self._pids, self._folder, self._domain = dict(pids), folder, domain
        self.state = msg.BenchState()
        self.dead = set[str]()
        self._killed = set[bytes]()  # the endpoints of the last one
        self._statuses: dict[str, msg.ControllerStatus] = {}  # as they told last
        subscription(first.node, topics.BENCH_STATE, self._on_state)
        subscription(first.node, topics.CONTROLLER_STATUS, self._on_status)
        self._actions = {
            name: ActionClient(first.node, action.PlanSlew, name)
            for name in (topics.PLAN_SLEW, topics.DRAFT_PLAN)
        }
        first.until(
            lambda: bool(self.state.state) and {*self.controllers} <= {*self._statuses},
            lambda: f"states: {self.state}; statuses: {[*self._statuses]}",
        )

    def _on_state(self, state: msg.BenchState) -> None:
        self.state = state

    def _on_status(self, status: msg.ControllerStatus) -> None:
        self._statuses[status.controller] = status

    @property
    def controllers(self) -> list[str]:
        """All controllers of the bench, by name."""
        return sorted(self._pids.keys() - {"plant", "recorder", PLANNER_NODE})

    @property
    def alive(self) -> list[str]:
        """The controllers that were not killed, or were started again."""
        return [name for name in self.controllers if name not in self.dead]

    def ready(self) -> tuple[str, set[str]]:
        """Return who is in charge, and who could be."""
        reply = self.first.ask(srv.ListControllers, topics.LIST_CONTROLLERS)
        return reply.active, {each.controller for each in reply.controllers if each.ready}

    def both(
        self, kind: Any, name: str, one: dict[str, Any], other: dict[str, Any]
    ) -> tuple[Any, Any]:
        """Return the answers to what both operators ask of a service at the same moment."""
        asked = self.first.begin(kind, name, **one), self.second.begin(kind, name, **other)

        def answered() -> bool:
            self.second.listen(0.0)
            return all(future.done() for future in asked)

        self.first.until(answered, lambda: (name, one, other))
        return asked[0].result(), asked[1].result()

    def plan(self, name: str, request: str, cancel: bool = False) -> action.PlanSlew.Result:
        """Return what comes of a goal of an action, which is cancelled at once or not."""
        client = self._actions[name]
        self.first.until(client.server_is_ready, lambda: f"{name} is not served")
        goal = action.PlanSlew.Goal(request=request, who="ann")
        handle = self.first.result(client.send_goal_async(goal), request)
        assert handle.accepted
        result = handle.get_result_async()
        if cancel:
            self.first.result(handle.cancel_goal_async(), f"cancel {request}")
        return self.first.result(result, request).result

    def kill(self, name: str) -> None:
        """Kill a node, as kill -9 does."""
        self._killed = {bytes(end.endpoint_gid) for end in self._ends() if end.node_name == name}
        os.kill(self._pids[name], signal.SIGKILL)
        self.dead.add(name)

    def _ends(self) -> list[Any]:
        """Return who gives signs of life, as the graph has it."""
        return list(self.first.node.get_publishers_info_by_topic(topics.ALIVE))

    def let_go(self) -> None:
        """Wait until the node that was killed last has left the graph: else it might be asked."""
        self.first.until(
            lambda: not self._killed & {bytes(end.endpoint_gid) for end in self._ends()},
            lambda: f"the graph keeps the dead: {self._ends()}",
        )

    def start_again(self, name: str) -> None:
        """Start a node again that was killed, and wait until it takes part."""
        before = 0 if name == PLANNER_NODE else self._statuses[name].instance
        module = PLANNER if name == PLANNER_NODE else CONTROLLER
        self._pids[name] = again(name, module, self._folder, self._domain)
        self.dead.discard(name)
        self.let_go()
        if name == PLANNER_NODE:
            self._meet_planner()
        else:
            self._meet_controller(name, before)

    def _meet_planner(self) -> None:
        for client in self._actions.values():
            self.first.until(client.server_is_ready, lambda: "no planner is met")
            _answered(self.first, partial(client.send_goal_async, NOTHING))
        while self.plan(topics.DRAFT_PLAN, NOTHING.request).message == str(NO_TESTBED):
            self.first.listen(0.05)  # until it has heard what stands there

    def _meet_controller(self, name: str, before: int) -> None:
        def knows() -> bool:
            status = self._statuses[name]
            return status.instance not in (0, before) and status.reason != str(NO_TESTBED)

        self.first.until(knows, lambda: f"{name} knows of no testbed")
        for operator in (self.first, self.second):
            _answered(operator, partial(operator.begin, srv.Tune, f"{name}/tune"))  # to nothing

    def end(self) -> dict[str, int]:
        """Interrupt the plant, with which all others leave; return the exit codes by name."""
        os.kill(self._pids["plant"], signal.SIGINT)
        server = fork_server()

        def codes() -> dict[str, int | None]:
            return {name: server.exit_code(pid) for name, pid in self._pids.items()}

        self.first.until(lambda: None not in codes().values(), codes)
        return {name: code for name, code in codes().items() if code is not None}


def _answered(operator: Bystander, ask: Callable[[], Future]) -> None:
    """Ask until an answer comes: DDS drops answers to those whom a newcomer has not met yet."""
    asked, again = ask(), monotonic() + ANSWER

    def answered() -> bool:
        nonlocal asked, again
        if not asked.done() and monotonic() > again:
            asked, again = ask(), monotonic() + ANSWER
        return bool(asked.done())

    operator.until(answered, lambda: "a newcomer does not answer")


@contextmanager
def operated(pids: dict[str, int], folder: Path, domain: int) -> Iterator[OperatedBench]:
    """Yield a bench with two operators beside it."""
    with beside(domain) as first, beside(domain, "second") as second:
        yield OperatedBench(first, second, pids, folder, domain)
