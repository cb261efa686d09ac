"""Tick rate over DDS against bare ping-pongs of the same messages, interleaved in one run."""

import json
import os
import subprocess
import sys
import tempfile
from array import array
from contextlib import suppress
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any

from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.run.domain import locked_domain
from flexslew_lab.run.processes import NodeProcess, node_processes, parameter_file
from flexslew_lab.run.supervisor import Supervisor
from flexslew_lab.trial.trial import Trial
from flexslew_plant.direct.names import AUTO, DDS, SETTING

TICKS = 20000
ROUNDS = 3


def ping_pong(side: str, raw: bool) -> None:
    """Answer every Measurement with an EffortCommand, or count how many go around.

    Args:
        side: ping or pong.
        raw: the same bytes each time, not messages.
    """
    import rclpy
    from flexslew_msgs import msg
    from rclpy.executors import ExternalShutdownException
    from rclpy.experimental import EventsExecutor
    from rclpy.serialization import serialize_message

    from flexslew_plant.graph.topics import LOOP_DEPTH

    rclpy.init()
    node = rclpy.create_node(side)
    executor = EventsExecutor()
    executor.add_node(node)
    two = array("d", [0.0, 0.0])
    if side == "pong":
        answer = node.create_publisher(msg.EffortCommand, "pong", LOOP_DEPTH)
        fixed = serialize_message(msg.EffortCommand(controller="x", effort=two))

        def pong(question: Any) -> None:
            answer.publish(
                fixed
                if raw
                else msg.EffortCommand(
                    stamp=question.header.stamp, tick=question.tick, controller="x", effort=two
                )
            )

        node.create_subscription(msg.Measurement, "ping", pong, LOOP_DEPTH, raw=raw)
        with suppress(ExternalShutdownException):  # the other side is done
            while os.getppid() != 1:
                executor.spin_once(timeout_sec=0.5)
        return
    ask = node.create_publisher(msg.Measurement, "ping", LOOP_DEPTH)
    count = 0

    def question() -> Any:
        return msg.Measurement(
            tick=count,
            controller="pd_feedforward",
            joint_position=two,
            joint_velocity=two,
            tip_deflection=two,
            root_curvature=two,
            applied_effort=two,
        )

    same = serialize_message(question())

    def again(_: Any) -> None:
        nonlocal count
        count += 1
        if count < TICKS:
            ask.publish(same if raw else question())

    heard = node.create_subscription(msg.EffortCommand, "pong", again, LOOP_DEPTH, raw=raw)
    while not (ask.get_subscription_count() and heard.get_publisher_count()):
        executor.spin_once(timeout_sec=0.05)
    start = perf_counter()
    ask.publish(question())
    while count < TICKS:
        executor.spin_once(timeout_sec=0.5)
    print(json.dumps(TICKS / (perf_counter() - start)))


def _floor(kind: str) -> float:
    with locked_domain() as domain:
        environment = os.environ | {"ROS_DOMAIN_ID": str(domain)}
        command = [sys.executable, __file__, kind]
        pong = subprocess.Popen([*command, "pong"], env=environment)
        try:
            done = subprocess.run(
                [*command, "ping"], env=environment, capture_output=True, text=True, check=True
            )
        finally:
            pong.terminate()
            pong.wait()
    return float(done.stdout)


def _ours(trial: Trial, record: bool, together: bool = False, transport: str = AUTO) -> float:
    os.environ[SETTING] = transport
    with tempfile.TemporaryDirectory() as scratch, locked_domain() as domain:
        folder = Path(scratch)
        processes = node_processes(trial, folder, record, {})
        parameters = folder / "parameters.yaml"
        parameters.write_text(parameter_file(processes))
        if together:
            processes = [NodeProcess("", "flexslew_lab", "single_process", {})]
        said = folder / "nodes.log"
        supervisor = Supervisor(processes, parameters, said, domain, lambda tick, last: None)
        outcome = supervisor.run()
        if outcome.exit_code:
            raise RuntimeError(f"{outcome.message}\n{said.read_text()}")
        if record:
            return TICKS / float(metrics_of(folder / "bag")["wall_time"])
        line = next(line for line in said.read_text().splitlines() if " s wall" in line)
        return TICKS / float(line.split(" ticks in ")[1].split(" s wall")[0])


def figures() -> dict[str, float]:
    """Return ticks per second, medians of interleaved runs, and their ratios to the floor."""
    bare = Trial(duration=TICKS * 0.01, display_rate=0.0)
    several = Trial(
        duration=TICKS * 0.01,
        display_rate=0.0,
        controllers={"pd_feedforward": {}, "output_feedback": {}, "proportional_integral": {}},
    )
    shown = Trial(duration=bare.duration)  # with the display rate that a trial has by itself
    law = "output_feedback"
    estimated = Trial(duration=bare.duration, display_rate=0.0, controllers={law: {}}, active=law)
    runs: dict[str, list[float]] = {}
    for _ in range(ROUNDS):
        runs.setdefault("lockstep_floor_ticks_per_s", []).append(_floor("typed"))
        runs.setdefault("raw_floor_ticks_per_s", []).append(_floor("raw"))
        runs.setdefault("lockstep_ticks_per_s", []).append(_ours(bare, record=True))
        runs.setdefault("direct_ticks_per_s", []).append(_ours(bare, record=False))
        runs.setdefault("dds_ticks_per_s", []).append(_ours(bare, record=True, transport=DDS))
        runs.setdefault("displayed_ticks_per_s", []).append(_ours(shown, record=True))
        runs.setdefault("output_feedback_ticks_per_s", []).append(_ours(estimated, record=True))
        runs.setdefault("three_controllers_ticks_per_s", []).append(_ours(several, record=True))
        runs.setdefault("one_process_ticks_per_s", []).append(_ours(bare, False, together=True))
    result = {name: median(values) for name, values in runs.items()}
    floor, rate = result["lockstep_floor_ticks_per_s"], result["lockstep_ticks_per_s"]
    result["lockstep_ratio"] = rate / floor
    result["one_process_ratio"] = (
        result["one_process_ticks_per_s"] / result["raw_floor_ticks_per_s"]
    )
    result["direct_ratio"] = result["direct_ticks_per_s"] / result["raw_floor_ticks_per_s"]
    result["recorded_ratio"] = rate / result["raw_floor_ticks_per_s"]
    result["displayed_ratio"] = result["displayed_ticks_per_s"] / rate
    result["output_feedback_ratio"] = result["output_feedback_ticks_per_s"] / rate
    result["three_controllers_ratio"] = result["three_controllers_ticks_per_s"] / rate
    return result


if __name__ == "__main__":
    ping_pong(sys.argv[2], raw=sys.argv[1] == "raw")
