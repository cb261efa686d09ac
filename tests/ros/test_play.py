"""A bag played back onto the topics and recorded again is the same bag."""

import os
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from flexslew_msgs.msg import Event, Plan
from flexslew_msgs.srv import Seek, Step
from std_srvs.srv import Trigger

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.run.domain import locked_domain
from flexslew_lab.run.processes import NodeProcess, node_processes, parameter_file
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.run.supervisor import Supervisor
from flexslew_plant.graph.topics import EVENTS, TOPICS
from flexslew_plant.ros.offers import qos

from .flight import fork_server, slew


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("flown") / "run"
    run_trial(slew(duration=6.0), "test", folder, in_process=True, report=False)
    return folder / "bag"


class Playing:
    """The play node, named as the node whose end is the end of a run, and a recorder."""

    def __init__(self, bag: Path, folder: Path, act: Any = None, **settings: Any) -> None:
        folder.mkdir()
        self.bag = folder / "bag"
        listeners = node_processes(slew(), folder, True, {})[-1].parameters["wait_for"]
        play = {"bag": str(bag), "wait_for": listeners, **settings}
        record = {"folder": str(self.bag), "metadata": '{"trial": "{}"}', "exit_with_plant": True}
        processes = [
            NodeProcess("recorder", "flexslew_lab", "recorder", record),
            NodeProcess("plant", "flexslew_lab", "play", play),
        ]
        parameters = folder / "parameters.yaml"
        parameters.write_text(parameter_file(processes))
        with locked_domain() as domain:
            log = folder / "nodes.log"
            it = Supervisor(
                processes, parameters, log, domain, lambda tick, last: None, fork_server()
            )
            if act is not None:
                os.environ["ROS_DOMAIN_ID"] = str(domain)
                try:
                    act()
                finally:
                    del os.environ["ROS_DOMAIN_ID"]
            self.outcome = it.run()
        self.log = log.read_text()


def by_topic(bag: Any) -> Any:
    found = defaultdict(list)
    for message in BagReader(bag).messages():
        if b"recorder\0" not in message.data:  # its own words
            padding = b"\0" * (-len(message.data) % 4)  # DDS rounds up
            found[message.topic].append(message.data + padding)
    return found


def test_played_and_recorded_again_every_message_is_the_same(flown: Any, tmp_path: Path) -> None:
    playing = Playing(flown, tmp_path / "again", rate=0.0)
    assert playing.outcome.exit_code == 0, playing.log
    original, again = by_topic(flown), by_topic(playing.bag)
    assert {t: len(m) for t, m in again.items() if t in original} == {
        t: len(m) for t, m in original.items()
    }
    for topic, messages in original.items():
        assert again[topic] == messages, topic


def call(kind: Any, name: Any, request: pytest.FixtureRequest) -> Any:
    rclpy.init()
    node = rclpy.create_node("operator")
    try:
        client = node.create_client(kind, name)
        assert client.wait_for_service(timeout_sec=20.0)
        future = client.call_async(request)
        rclpy.spin_until_future_complete(node, future, timeout_sec=20.0)
        return future.result()
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


@pytest.mark.ros
def test_pause_step_seek_and_resume_over_services(flown: Any, tmp_path: Path) -> None:
    def operate() -> None:
        answers.append(call(Seek, "/plant/seek", Seek.Request(time=Time(sec=7))))
        answers.append(call(Seek, "/plant/seek", Seek.Request(time=Time(sec=3))))
        answers.append(call(Step, "/plant/step", Step.Request(ticks=10)))
        answers.append(call(Trigger, "/plant/resume", Trigger.Request()))

    answers: list[Any] = []
    playing = Playing(
        flown, tmp_path / "again", operate, paused=True, rate=20.0,
        topics=["/truth", "/measurement"],
    )  # fmt: skip
    assert playing.outcome.exit_code == 0, playing.log
    refused, seek, step, resume = answers
    assert not refused.ok
    assert "7 s is outside of the bag, which is played from 0 s to 6 s" in refused.message
    assert seek.ok
    assert seek.message == "next at 3.000 s"
    assert (step.ok, step.tick) == (True, 310)
    assert resume is not None, playing.log
    assert resume.success
    ticks = BagReader(playing.bag).columns("/truth", {"tick"})["tick"]
    assert ticks.tolist() == list(range(300, 601))


def late_listener(expected: Any) -> tuple[Any, Any]:
    """Return plans and events of a listener that comes now, once it has heard enough."""
    rclpy.init()
    node = rclpy.create_node("late")
    plans: list[Any] = []
    events: list[Any] = []
    try:
        node.create_subscription(Plan, "/plan", plans.append, qos(TOPICS[EVENTS]))
        node.create_subscription(Event, "/events", events.append, qos(TOPICS[EVENTS]))
        client = node.create_client(Trigger, "/plant/pause")
        while not (plans and len([e for e in events if e.source == "plant"]) >= expected):
            rclpy.spin_once(node, timeout_sec=20.0)
        # a way there and back, in which what is too much would arrive, too
        assert client.wait_for_service(timeout_sec=20.0)
        future = client.call_async(Trigger.Request())
        rclpy.spin_until_future_complete(node, future, timeout_sec=20.0)
        assert future.done()
        return len(plans), [e.kind for e in events if e.source == "plant"]
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


@pytest.mark.ros
def test_after_a_seek_a_late_listener_knows_what_was_known_there_and_no_more(
    tmp_path: Path,
) -> None:
    extra = "schedule: [{at: 1.0, until: 3.0, disturbance: {base_yaw: 1.0}}]"
    folder = tmp_path / "flown"
    run_trial(slew(duration=6.0, extra=extra), "test", folder, in_process=True, report=False)
    events = BagReader(folder / "bag").overview.events
    assert [(e.kind, e.time) for e in events] == [
        ("started", 0.0), ("disturbance", 1.0), ("disturbance", 3.0), ("finished", 6.0),
    ]  # fmt: skip

    def operate() -> None:
        for time in (5, 2, 4):
            answers.append(call(Seek, "/plant/seek", Seek.Request(time=Time(sec=time))))
            known = [event.kind for event in events if event.time < time]
            heard.append((late_listener(len(known)), (1, known)))
        answers.append(call(Trigger, "/plant/resume", Trigger.Request()))

    answers: list[Any] = []
    heard: list[Any] = []
    playing = Playing(folder / "bag", tmp_path / "again", operate, paused=True, rate=0.0)
    assert playing.outcome.exit_code == 0, playing.log
    assert [told for told, _ in heard] == [known for _, known in heard]
    ticks = BagReader(playing.bag).columns("/truth", {"tick"})["tick"]
    assert ticks.tolist() == list(range(400, 601))


@pytest.mark.ros
def test_a_part_of_the_bag_with_a_clock_of_its_own(flown: Any, tmp_path: Path) -> None:
    playing = Playing(
        flown, tmp_path / "again", rate=20.0, start=1.0, duration=2.0, clock=1000.0,
        topics=["/truth", "/measurement"],
    )  # fmt: skip
    assert playing.outcome.exit_code == 0, playing.log
    again = BagReader(playing.bag)
    ticks = again.columns("/truth", {"tick"})["tick"]
    assert ticks.tolist() == list(range(100, 300))
    clock = again.columns("/clock")
    seconds = clock["clock.sec"] + clock["clock.nanosec"] * 1e-9
    assert len(seconds) > 10
    assert (np.diff(seconds) >= 0.0).all()
    assert 1.0 <= seconds[0] <= seconds[-1] <= 3.0 + 1e-6
