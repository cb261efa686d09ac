"""A bag played back onto the topics and recorded again is the same bag."""

import os
from collections import defaultdict
from pathlib import Path

import pytest
import rclpy
from flexslew_msgs.srv import Step
from std_srvs.srv import Trigger

from flexslew_lab.bag_reader import BagReader
from flexslew_lab.domain import own_domain
from flexslew_lab.processes import NodeProcess, node_processes, parameter_file
from flexslew_lab.run import run_trial
from flexslew_lab.supervisor import Supervisor

from .flight import slew


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flown") / "run"
    run_trial(slew(duration=6.0), "test", folder, in_process=True, report=False)
    return folder / "bag"


class Playing:
    """The play node, named as the node whose end is the end of a run, and a recorder."""

    def __init__(self, bag: Path, folder: Path, act=None, **settings):
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
        with own_domain() as domain:
            log = folder / "nodes.log"
            it = Supervisor(processes, parameters, log, domain, lambda tick, last: None)
            if act is not None:
                os.environ["ROS_DOMAIN_ID"] = str(domain)
                try:
                    act()
                finally:
                    del os.environ["ROS_DOMAIN_ID"]
            self.outcome = it.run()
        self.log = log.read_text()


def by_topic(bag):
    found = defaultdict(list)
    for message in BagReader(bag).messages():
        if b"recorder\0" not in message.data:  # its own words
            padding = b"\0" * (-len(message.data) % 4)  # DDS rounds up
            found[message.topic].append(message.data + padding)
    return found


def test_played_and_recorded_again_every_message_is_the_same(flown, tmp_path):
    playing = Playing(flown, tmp_path / "again", rate=0.0)
    assert playing.outcome.exit_code == 0, playing.log
    original, again = by_topic(flown), by_topic(playing.bag)
    assert {t: len(m) for t, m in again.items() if t in original} == {
        t: len(m) for t, m in original.items()
    }
    for topic, messages in original.items():
        assert again[topic] == messages, topic


def call(kind, name, request):
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


def test_pause_step_seek_and_resume_over_services(flown, tmp_path):
    def operate():
        answers.append(call(Step, "/plant/seek", Step.Request(ticks=300)))
        answers.append(call(Step, "/plant/step", Step.Request(ticks=10)))
        answers.append(call(Trigger, "/plant/resume", Trigger.Request()))

    answers = []
    playing = Playing(
        flown, tmp_path / "again", operate, paused=True, rate=20.0,
        topics=["/truth", "/measurement"],
    )  # fmt: skip
    assert playing.outcome.exit_code == 0, playing.log
    seek, step, resume = answers
    assert (seek.ok, seek.tick) == (True, 300)
    assert (step.ok, step.tick) == (True, 310)
    assert resume.success
    ticks = BagReader(playing.bag).columns("/truth", {"tick"})["tick"]
    assert ticks.tolist() == list(range(300, 601))
