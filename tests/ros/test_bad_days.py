"""Killed nodes, interruptions and intruders: the others go on and the log is whole."""

import json
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flexslew_msgs import msg
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.checks.check import check_log
from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.replay.resim import resim
from flexslew_lab.run.domain import locked_domain
from flexslew_lab.run.processes import NodeProcess, node_processes, parameter_file
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.run.supervisor import Supervisor
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.direct.names import SETTING
from flexslew_plant.graph import topics
from flexslew_plant.ros.offers import publisher, subscription

from .bystander import beside
from .flight import Flight, fork_server, kill, kill_in_flight, side_by_side, slew


def nobody(tick: int, last: int) -> None:
    """Take no notice of the progress."""


LOST = """
name: lost
duration: 20.0
period: 0.1
integration_steps: 1
answer_timeout: 20.0
testbed: {modes: 12}
controllers: {pd_feedforward: {}}
schedule: [{at: 1.0, disturbance: {base_yaw: 5.0}}]
"""


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[str], Flight]]:
    """Yield what returns a flight in which nodes are killed, by name."""
    folder = tmp_path_factory.mktemp("killed")

    def planner_then_recorder(pids: dict[str, int], domain: int) -> None:
        kill("planner")(pids, domain)
        kill_in_flight("recorder", folder / "2")(pids, domain)

    controller = kill_in_flight("pd_feedforward", folder / "1")
    with side_by_side(
        controller=lambda: Flight(slew(40.0, patience=0.5), folder / "1", 0, controller),
        others=lambda: Flight(slew(40.0), folder / "2", 0, planner_then_recorder),
    ) as flown:
        yield flown


def test_a_killed_controller_ends_in_the_brake_which_takes_the_energy_away(
    killed: Any,
) -> None:
    flight = killed("controller")
    assert flight.outcome.exit_code == 3
    assert flight.metrics["ticks"] == 4000
    bag = BagReader(flight.bag)
    (brake,) = (event.tick for event in bag.overview.events if event.kind == "brake")
    energy = bag.columns("/truth", {"energy"})["energy"][brake + 1 :]
    assert np.diff(energy).max() <= 0.0
    assert energy[-1] < 0.1 * energy[0]


def test_a_killed_planner_disturbs_no_other_node_and_a_killed_recorder_leaves_a_readable_log(
    killed: Any,
) -> None:
    flight = killed("others")
    assert flight.outcome.exit_code == 3
    assert "planner: -9" in flight.outcome.message
    assert "recorder: -9" in flight.outcome.message
    assert "4000 ticks" in flight.log
    assert "heartbeat of the recorder recorder lost" in flight.log
    metrics = flight.metrics
    assert metrics["missed_ticks"] == 0
    assert not metrics["log_complete"]
    assert metrics["ticks"] > 20


def test_an_interrupt_ends_everything_and_leaves_a_whole_log(tmp_path: Path) -> None:
    def interrupt(pids: Any, domain: int) -> None:
        os.kill(os.getpid(), signal.SIGINT)

    flight = Flight(slew(duration=1000.0), tmp_path, 50, interrupt)
    assert flight.outcome.exit_code == 130
    assert flight.metrics["log_complete"]
    assert "interrupted" in flight.events


@pytest.mark.ros
def test_an_interrupt_of_all_nodes_at_once_leaves_the_plant_s_last_words_in_the_log(
    tmp_path: Path,
) -> None:
    def interrupt(pids: Any, domain: int) -> None:
        for pid in pids.values():
            os.kill(pid, signal.SIGINT)

    flight = Flight(slew(duration=1000.0), tmp_path, 50, interrupt)
    assert "interrupted" in flight.events
    assert flight.metrics["log_complete"]


@pytest.mark.ros
def test_two_benches_fly_side_by_side_in_their_namespaces(tmp_path: Path) -> None:
    with locked_domain() as domain:
        flown = {}
        for place in ("bench1", "bench2"):
            folder = tmp_path / place
            folder.mkdir()
            goal = {"bench1": 6.0, "bench2": 5.0}[place]
            trial = slew(duration=goal)
            *others, plant = node_processes(trial, folder, True, {}, namespace=place)
            processes = [*others, plant._replace(name=f"plant_of_{place}")]  # any name will do
            parameters = folder / "parameters.yaml"
            parameters.write_text(parameter_file(processes))
            log = folder / "nodes.log"
            flown[place] = Supervisor(processes, parameters, log, domain, nobody, fork_server())
        outcomes = [supervisor.run() for supervisor in flown.values()]
    assert outcomes == [(0, "")] * 2
    for place, ticks in (("bench1", 600), ("bench2", 500)):
        bag = BagReader(tmp_path / place / "bag")
        assert [finding for finding in check_log(bag.path) if not finding.ok] == []
        assert metrics_of(bag.path)["ticks"] == ticks
        frames = {
            transform.child_frame_id
            for _, _, message in bag.decode_messages(("/tf", "/tf_static"))
            for transform in message.transforms
        }
        assert {frame.rpartition("/")[2] for frame in frames} >= {"base", "hub", "beam_positive"}
        assert all(frame.startswith(f"{place}/") for frame in frames)


@pytest.mark.ros
@pytest.mark.parametrize(
    ("transport", "reasons", "strays"),
    [
        # where answers come on a socket the tick is over before a lie about it arrives
        ("auto", {"sender", "stale"}, {"plant"}),
        ("dds", {"sender", "stale", "size", "finite"}, {"plant", "pd_feedforward"}),
    ],
)
def test_lies_on_the_command_topic_are_rejected_and_the_run_is_unharmed(
    transport: str,
    reasons: set[str],
    strays: set[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv(SETTING, transport)
    intruder = NodeProcess("intruder", "tests", "intruder", {})
    flight = Flight(slew(duration=100.0), tmp_path, extra=[intruder])
    assert flight.outcome.exit_code == 0
    events = BagReader(flight.bag).overview.events
    assert {event.data["reason"] for event in events if event.kind == "rejected"} >= reasons
    assert {event.data["node"] for event in events if event.kind == "stray"} >= strays
    assert flight.metrics["missed_ticks"] == 0


@pytest.mark.ros
def test_who_is_not_the_plant_neither_enters_the_log_nor_keeps_the_bench(tmp_path: Path) -> None:
    """Messages of the right type, one of the right size and of a tick that was not yet flown.

    Whoever publishes them stays on the graph after the run, as a bag does that is played.
    """
    others: list[Any] = [
        (topics.TRUTH, msg.PlantState(tick=12, position=[9.0, 9.0, 9.0])),
        (topics.TRUTH, msg.PlantState(tick=12, position=[0.0] * 4, velocity=[0.0] * 4)),
        (topics.MEASUREMENT, msg.Measurement(tick=1 << 60, controller="x")),
        (topics.TESTBED, msg.Testbed(kind="csa", joint_names=["x"], settings="{")),
        (topics.JOINT_STATES, JointState(name=["base_yaw"], position=[7.0])),
        (topics.CLOCK, Clock()),
    ]

    def speak(pids: dict[str, int], domain: int) -> None:
        told: set[str] = set()
        stranger = stays.enter_context(beside(domain))
        assert stranger.ask(Trigger, "pause").success
        subscription(stranger.node, topics.EVENTS, lambda event: told.add(event.data))
        ends = [(publisher(stranger.node, name), message) for name, message in others]

        def told_of_all() -> bool:
            for end, message in ends:
                end.publish(message)
            strange = [json.loads(data) for data in told if "is not the plant" in data]
            return {data["topic"] for data in strange} >= {name for name, _ in others}

        stranger.until(told_of_all, lambda: told)
        assert stranger.ask(Trigger, "start").success

    with ExitStack() as stays:
        flight = Flight(slew(duration=16.0, rate=2.0), tmp_path, 10, speak)
    assert flight.outcome == (0, ""), flight.log
    assert "does not leave" not in flight.log
    assert resim(flight.bag).identical
    assert flight.metrics["log_complete"]
    columns = BagReader(flight.bag).columns("/truth", {"tick"})
    assert columns["tick"].tolist() == list(range(1601))
    overview = BagReader(flight.bag).overview
    assert overview.counts["/testbed"] == 1


@pytest.mark.ros
def test_a_node_that_dds_does_not_let_go_is_ended_and_the_run_is_unharmed(tmp_path: Path) -> None:
    flight = Flight(
        slew(duration=1.0), tmp_path, extra=[NodeProcess("stuck", "tests", "stuck", {})]
    )
    assert flight.outcome == (0, ""), flight.log


@pytest.mark.ros
def test_a_run_whose_state_is_lost_ends_in_order(tmp_path: Path) -> None:
    trial = parse_trial(LOST, "test")
    alone = run_trial(trial, "test", tmp_path / "alone", in_process=True, report=False)
    flight = Flight(trial, tmp_path / "ros")
    assert flight.outcome.exit_code == 3
    assert alone.message in flight.outcome.message
    assert flight.events[-2:] == ["not_finite", "finished"]
    metrics = flight.metrics
    assert metrics["log_complete"]
    assert metrics["trajectory_hash"] == alone.metrics["trajectory_hash"]
    for topic, field in (("/truth", "velocity"), ("/measurement", "joint_velocity")):
        assert np.isfinite(BagReader(flight.bag).columns(topic, {field})[field]).all()
    assert resim(flight.bag).identical
