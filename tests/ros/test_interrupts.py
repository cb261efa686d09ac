"""Signals of a node's process."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from threading import Event

import pytest

from flexslew_lab.run.domain import locked_domain
from flexslew_plant.ros.interrupts import SignalHandler
from tests.present import present


@pytest.fixture
def interrupts() -> Iterator[SignalHandler]:
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    one = SignalHandler()
    one.install()
    yield one
    one.ignore()
    signal.signal(signal.SIGINT, before[0])
    signal.signal(signal.SIGTERM, before[1])


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_that_a_callback_has_swallowed_comes_again(
    interrupts: SignalHandler, number: signal.Signals
) -> None:
    with suppress(KeyboardInterrupt):  # as a compiler's callback does
        os.kill(os.getpid(), number)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            Event().wait(20.0)


def test_a_signal_that_was_taken_does_not_come_again(interrupts: SignalHandler) -> None:
    with suppress(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGINT)
    timer = present(interrupts._repeat_timer)
    interrupts.mark_caught()
    timer.join(20.0)
    assert not timer.is_alive()  # cancelled, it ended without a signal
    assert interrupts._repeat_timer is None


# a node that is interrupted at the one moment when rclpy makes a message of what it heard
HEARS = """
import os, signal
from std_msgs.msg import Empty
import rclpy
from flexslew_plant.ros.node_process import run_node

class Hearing:
    def __init__(self, loop):
        node = rclpy.create_node("hearing")
        node.create_subscription(Empty, "word", lambda message: None, 1)
        self._publisher = node.create_publisher(Empty, "word", 1)
        loop.add(node)
        self._word = Empty()
        Empty.__init__ = self._interrupted

    def _interrupted(self):
        os.kill(os.getpid(), signal.SIGINT)

    def poll(self):
        self._publisher.publish(self._word)
        return 0.01

    def interrupted(self):
        print("was interrupted")

run_node(Hearing)
"""


@pytest.mark.slow
def test_an_interrupt_while_a_message_is_made_is_one() -> None:
    with locked_domain() as domain:
        done = subprocess.run(
            [sys.executable, "-c", HEARS],
            env=os.environ | {"ROS_DOMAIN_ID": str(domain)}, capture_output=True, text=True,
            check=False, timeout=200,
        )  # fmt: skip
    assert (done.returncode, done.stdout.splitlines()) == (130, ["was interrupted"]), done.stderr


@pytest.mark.ros
def test_a_node_that_dds_does_not_let_go_ends_wherever_it_is_held() -> None:
    with locked_domain() as domain:
        planner = subprocess.Popen(
            [sys.executable, "-m", "tests.ros.held_planner_node"],
            env=os.environ | {"ROS_DOMAIN_ID": str(domain)},
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        try:
            line = present(planner.stdout).readline()
            planner.terminate()
            _, told = planner.communicate(timeout=100.0)
        finally:
            planner.kill()
    assert (line, planner.returncode) == ("serves\n", -signal.SIGALRM), told


@pytest.mark.ros
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("moment", ["starting", "running"])
def test_an_interrupt_in_a_text_that_is_run_has_the_exit_code_of_any_other(
    moment: str, number: signal.Signals, tmp_path: Path
) -> None:
    """Dataclasses are made by exec: Python takes what leaves it for unhandled, caught or not."""
    program = f"""
import os
from flexslew_plant.ros.node_process import run_node

def interrupt():
    exec("os.kill(os.getpid(), {int(number)})\\nwhile True: pass")

class Interrupted:
    def __init__(self, loop):
        if "{moment}" == "starting":
            interrupt()

    def poll(self):
        interrupt()

run_node(Interrupted)
"""
    (tmp_path / "interrupted_node.py").write_text(program)
    with locked_domain() as domain:
        done = subprocess.run(
            [sys.executable, "-m", "interrupted_node"], cwd=tmp_path,
            env=os.environ | {"ROS_DOMAIN_ID": str(domain)}, check=False, timeout=200,
        )  # fmt: skip
    assert done.returncode == 130
