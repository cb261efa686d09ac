"""Nodes that are killed: all others let go of them at once, and nobody is held up by them."""

import os
import re
import signal
from pathlib import Path
from time import monotonic

import pytest
import rclpy
from rclpy.node import Node

from flexslew_lab.run.domain import locked_domain
from flexslew_plant.graph import topics
from flexslew_plant.ros.loop import Loop

from .bystander import Bystander, beside
from .flight import Flight, kill, slew
from .test_pace import watched

LEASE = 20.0  # until DDS itself lets go of one that is silent [wall s]
VICTIMS = ("lqr", "planner", "recorder")


def nodes(bench: Bystander) -> set[str]:
    return set(bench.node.get_node_names())


@pytest.mark.ros
def test_the_killed_leave_the_graph_at_once_and_the_stopped_stay(tmp_path: Path) -> None:
    passed: list[float] = []  # until all have let go [wall s]
    stayed: list[bool] = []

    def act(pids: dict[str, int], domain: int) -> None:
        with beside(domain) as bench:
            bench.until(lambda: {*VICTIMS, "stopped", "pd_feedforward"} <= nodes(bench))
            os.kill(pids["stopped"], signal.SIGSTOP)
            start = monotonic()
            for victim in VICTIMS:
                os.kill(pids[victim], signal.SIGKILL)
            bench.until(lambda: not nodes(bench) & set(VICTIMS))
            passed.append(monotonic() - start)
            stayed.append({"plant", "stopped", "pd_feedforward"} <= nodes(bench))
            os.kill(pids["stopped"], signal.SIGCONT)
            bench.pass_by(100)
        raise KeyboardInterrupt

    more = ", lqr: {}, stopped: {law: lqr}"
    flight = Flight(slew(10_000.0, 1.0, more), tmp_path, 1, act)
    assert flight.outcome.exit_code == 130
    assert stayed == [True]
    assert passed[0] < LEASE / 2, flight.log


@pytest.mark.ros
def test_who_is_stopped_at_the_end_leaves_as_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("flexslew_lab.run.supervisor._EXIT_TIMEOUT", 20.0)
    more = ", stopped: {law: lqr}"
    flight = Flight(slew(more=more), tmp_path, 1, kill("stopped", signal.SIGSTOP))
    assert flight.outcome == (0, ""), flight.log
    assert "does not leave" not in flight.log


@pytest.mark.slow
def test_a_recorder_does_not_wait_for_those_that_have_ended_with_the_plant(tmp_path: Path) -> None:
    passed: list[float] = []  # until it has left [wall s]

    def act(pids: dict[str, int], domain: int) -> None:
        others = "plant", "pd_feedforward", "planner"
        with beside(domain) as bench:
            bench.until(lambda: {*others, "recorder"} <= nodes(bench))
            bench.pass_by(100)  # each has given signs of life
            start = monotonic()
            for victim in others:
                os.kill(pids[victim], signal.SIGKILL)
            bench.until(lambda: not nodes(bench) & {*others, "recorder"})
            passed.append(monotonic() - start)

    flight = Flight(slew(10_000.0, 1.0), tmp_path, 1, act)
    assert flight.outcome.exit_code == 3
    assert passed[0] < LEASE / 2, flight.log


@pytest.mark.ros
def test_one_that_dds_does_not_let_go_is_off_the_graph(monkeypatch: pytest.MonkeyPatch) -> None:
    with locked_domain() as domain:
        rclpy.init(domain_id=domain)
        loop, node = Loop(), rclpy.create_node("held")
        loop.live(node, "recorder")
        with beside(domain) as bench:
            bench.until(lambda: "held" in nodes(bench))
            bench.until(lambda: bool(node.get_publishers_info_by_topic(topics.ALIVE)))
            with monkeypatch.context() as patched:
                patched.setattr(Node, "destroy_node", lambda node: None)
                loop.leave(0, lambda: None)
            signal.alarm(0)
            start = monotonic()
            bench.until(lambda: "held" not in nodes(bench))
            passed = monotonic() - start
        node.destroy_node()
        rclpy.shutdown()
    assert passed < LEASE / 2


@pytest.mark.ros
@pytest.mark.alone
def test_nobody_is_held_up_by_the_killed(tmp_path: Path) -> None:
    killed: list[int] = []  # tick

    def act(pids: dict[str, int], domain: int) -> None:
        killed.clear()
        with beside(domain) as bench:
            bench.pass_by(200)
            for victim in VICTIMS:
                killed.append(bench.tick)
                os.kill(pids[victim], signal.SIGKILL)
                bench.pass_by(2500)
        raise KeyboardInterrupt

    flight, ours = watched(lambda: Flight(slew(1e4, 10.0, ", lqr: {}"), tmp_path, 1, act))
    assert flight.outcome.exit_code == 130
    told = re.findall(r"t = ([\d.]+) s: .* is shifted; ([\d.]+) s in all", flight.log)
    before = [float(total) for time, total in told if float(time) < killed[0] * 0.01]
    late = float(told[-1][1]) if told else 0.0
    # a machine's own hitches are short; one wait for a port that two senders make is 2 s
    assert late - max(before, default=0.0) < 0.5 or not ours, flight.log
