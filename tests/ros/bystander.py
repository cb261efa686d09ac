"""A node beside a flight: it counts the ticks and asks for what an operator may ask for."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event
from time import monotonic
from typing import Any

import rclpy
from flexslew_msgs.msg import Measurement
from flexslew_msgs.srv import SwitchController
from rclpy.task import Future

from flexslew_lab.log.recording.recording_order import tick_and_epoch
from flexslew_plant.graph.topics import MEASUREMENT, TOPICS
from flexslew_plant.ros.offers import qos

PATIENCE = 200.0  # on a busy machine [wall s]
_BUSY = "import os\nwhile os.getppid() == {}: pass"
_SLEEPER = """
import os, select, sys, time
os.sched_setaffinity(0, [int(sys.argv[1])])
longest, at = 0.0, time.monotonic()
while not select.select([sys.stdin], [], [], 0.002)[0]:
    now = time.monotonic()
    longest, at = max(longest, now - at - 0.002), now
print(longest)
"""


class Bystander:
    """Hears every question of a bench.

    Args:
        domain: ROS_DOMAIN_ID of the bench.
        name: of the node.
    """

    def __init__(self, domain: int, name: str = "bystander") -> None:
        self.received = 0  # questions
        self.tick = -1  # of the newest
        self._context = rclpy.Context()
        self._context.init(domain_id=domain)
        self.node = rclpy.create_node(name, context=self._context)
        self._clients: dict[str, Any] = {}  # by service
        self._executor = rclpy.executors.SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self.node.create_subscription(
            Measurement, MEASUREMENT, self._hear, qos(TOPICS[MEASUREMENT]), raw=True
        )

    def _hear(self, data: bytes) -> None:
        self.received += 1
        self.tick = max(self.tick, tick_and_epoch(data)[0])

    def until(self, condition: Callable[[], bool], told: Callable[[], Any] = str) -> None:
        """Listen until something is true; `told` returns what a failure shows."""
        end = monotonic() + PATIENCE
        while not condition():
            assert monotonic() < end, f"it never happened {told()}"
            self._executor.spin_once(timeout_sec=0.02)

    def listen(self, seconds: float) -> None:
        """Take what comes in one moment, if anything does."""
        self._executor.spin_once(timeout_sec=seconds)

    def pass_by(self, ticks: int) -> int:
        """Return the newest tick after so many ticks."""
        end = self.tick + ticks
        self.until(lambda: self.tick >= end)
        return self.tick

    def ask(self, kind: Any, name: str, **request: Any) -> Any:
        """Return the answer of a service."""
        return self.result(self.begin(kind, name, **request), f"of {name} to {request}")

    def begin(self, kind: Any, name: str, **request: Any) -> Future:
        """Ask for a service; return the future of its answer."""
        if name not in self._clients:
            self._clients[name] = self.node.create_client(kind, name)
        client = self._clients[name]
        assert client.wait_for_service(timeout_sec=PATIENCE), name
        return client.call_async(kind.Request(**request))

    def result(self, future: Future, told: str = "") -> Any:
        """Return what comes of a future; `told` is what a failure shows."""
        self.until(future.done, lambda: told)
        return future.result()

    def swap(self, controller: str) -> None:
        """Have another controller in charge, as soon as it is ready."""

        answer: Any = None

        def swapped() -> bool:
            nonlocal answer
            answer = self.ask(SwitchController, "switch_controller", controller=controller)
            return bool(answer.ok)

        self.until(swapped, lambda: answer)

    def close(self) -> None:
        self.node.destroy_node()
        self._context.try_shutdown()


@contextmanager
def beside(domain: int, name: str = "bystander") -> Iterator[Bystander]:
    """Yield a bystander of the bench in this domain."""
    one = Bystander(domain, name)
    try:
        yield one
    finally:
        one.close()


@contextmanager
def busy(processes: int) -> Iterator[None]:
    """Keep the processors busy with so many processes."""
    command = [sys.executable, "-S", "-c", _BUSY.format(os.getpid())]
    load = [subprocess.Popen(command, start_new_session=True) for _ in range(processes)]
    try:
        yield
    finally:
        for process in load:
            process.kill()
            process.wait()


class Sleepers:
    """On each processor a process that sleeps 2 ms at a time: how long are they kept waiting?"""

    def __init__(self) -> None:
        self._processes = [
            subprocess.Popen(
                [sys.executable, "-S", "-c", _SLEEPER, str(processor)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                start_new_session=True,
            )
            for processor in os.sched_getaffinity(0)
        ]

    def longest(self) -> float:
        """End them; return the longest time that one of them overslept [wall s]."""
        return max(float(process.communicate("")[0]) for process in self._processes)


@contextmanager
def held(pid: int) -> Iterator[None]:
    """Hold a process up."""
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


def stall(pid: int, seconds: float) -> None:
    """Hold a process up for so long [wall s]."""
    with held(pid):
        Event().wait(seconds)
