"""Nodes that are started one by one, each with a log of its own, and what controllers say."""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Any, TypeVar

import rclpy
from flexslew_msgs.msg import ControllerStatus, Measurement

from flexslew_lab.run.domain import locked_domain
from flexslew_plant.direct.names import SETTING
from flexslew_plant.graph.topics import CONTROLLER_STATUS, PLAN, TOPICS
from flexslew_plant.ros.offers import qos

from .flight import fork_server

WAIT = 200.0  # on a busy machine
PLANT, CONTROLLER = "flexslew_plant.ros.plant_node", "flexslew_control.ros.controller_node"
PLANNER = "flexslew_control.ros.planner_node"


class Bench:
    """Nodes that are started one by one, and what their controllers say."""

    def __init__(self, folder: Path, domain: int) -> None:
        self._folder = folder
        self._environment = {"ROS_DOMAIN_ID": str(domain), SETTING: os.environ[SETTING]}
        self.statuses: dict[str, Any] = {}
        self.node = rclpy.create_node("bystander")
        status = qos(TOPICS[CONTROLLER_STATUS], 10)
        self.node.create_subscription(ControllerStatus, CONTROLLER_STATUS, self._hear, status)
        latched = qos(TOPICS[PLAN])  # more than is offered: it will never be served
        self.node.create_subscription(Measurement, "measurement", print, latched)
        self.pids: dict[str, int] = {}

    def _hear(self, status: Any) -> None:
        self.statuses[status.controller] = status

    def start(self, name: str, module: str, **parameters: str) -> None:
        words = [f"{key}:={value}" for key, value in parameters.items()]
        arguments = ["--ros-args", "-r", f"__node:={name}"]
        arguments += [word for pair in words for word in ("-p", pair)]
        with (self._folder / f"{name}.log").open("ab") as said:
            self.pids[name] = fork_server().start(
                module, arguments, self._environment, said.fileno()
            )

    def until(self, condition: Callable[[], bool]) -> None:
        end = monotonic() + WAIT
        while not condition():
            assert monotonic() < end, "it never happened"
            rclpy.spin_once(self.node, timeout_sec=0.05)

    def runs(self, name: str) -> bool:
        return fork_server().exit_code(self.pids[name]) is None

    def end(self, name: str, number: int = signal.SIGINT) -> None:
        if self.runs(name):
            os.kill(self.pids[name], number)
        self.until(lambda: not self.runs(name))

    def log(self, name: str) -> str:
        return (self._folder / f"{name}.log").read_text()


_Bench = TypeVar("_Bench", bound=Bench)


@contextmanager
def standing(kind: Callable[[Path, int], _Bench], folder: Path) -> Iterator[_Bench]:
    """Yield a bench in a domain of its own, and end its nodes."""
    with locked_domain() as domain:
        rclpy.init(domain_id=domain)
        one = kind(folder, domain)
        try:
            yield one
        finally:
            for name in one.pids:
                one.end(name)
            one.node.destroy_node()
            rclpy.shutdown()
