"""A plant that comes slowly, or leaves and comes back; a listener that asks for too much."""

import signal
from collections.abc import Iterator
from pathlib import Path
from time import monotonic
from typing import Any

import pytest
import rclpy
from flexslew_msgs.msg import BenchState, Event, Measurement, Plan, Testbed
from rclpy.duration import Duration
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from flexslew_plant.bench import message_fields
from flexslew_plant.bench.bench import Bench as Plant
from flexslew_plant.bench.records import BenchSettings
from flexslew_plant.direct.names import SETTING
from flexslew_plant.graph.topics import (
    BENCH_STATE,
    EVENTS,
    JOINT_TRAJECTORY,
    MEASUREMENT,
    PLAN,
    TESTBED,
    TOPICS,
)
from flexslew_plant.ros.messages import message_of, stamp
from flexslew_plant.ros.offers import qos

from .flight import fork_server
from .one_by_one import CONTROLLER, PLANNER, PLANT, WAIT, Bench, standing


def announcement() -> Testbed:
    settings = BenchSettings()
    fields = message_fields.testbed_fields(Plant(settings), settings)
    return message_of(Testbed, {"stamp": stamp(0.0), **fields})


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    with standing(Bench, tmp_path) as one:
        yield one


@pytest.mark.slow
def test_controllers_stand_before_the_testbed_of_a_plant_that_came_back(bench: Bench) -> None:
    bench.start("lqr", CONTROLLER, law="lqr")
    bench.start("pd", CONTROLLER, kp="[460.0, 460.0]")
    two = {"bench.active": "lqr", "rate_factor": "5.0", "bench.max_missed": "1000"}
    bench.start("plant", PLANT, **two)
    ready = {"lqr", "pd"}
    bench.until(lambda: {n for n, s in bench.statuses.items() if s.ready} == ready)
    bench.until(lambda: bench.statuses["lqr"].last_tick > 200)
    warning = "incompatible QoS requested: bystander on /measurement"
    bench.until(lambda: warning in bench.log("plant"))  # whenever it was discovered
    bench.end("plant", signal.SIGKILL)
    before = len(bench.log("plant"))

    one = {"bench.testbed.kind": "floating_oscillator", "bench.max_missed": "1000"}
    bench.start("plant", PLANT, rate_factor="5.0", **{"bench.active": "lqr", **one})
    bench.until(lambda: not bench.statuses["pd"].ready)
    assert "kp" in bench.statuses["pd"].reason
    bench.until(lambda: "started at tick 0" in bench.log("plant")[before:])
    flown = bench.statuses["lqr"].last_tick
    bench.until(lambda: bench.statuses["lqr"].ready and bench.statuses["lqr"].last_tick != flown)
    assert "deflection" in bench.statuses["lqr"].settings
    assert bench.runs("lqr")
    assert bench.runs("pd")


@pytest.mark.ros
@pytest.mark.parametrize("transport", ["auto", "dds"])
def test_who_publishes_questions_and_is_no_plant_is_not_waited_for(
    transport: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(SETTING, transport)
    with standing(Bench, tmp_path) as bench:
        player = bench.node.create_publisher(Measurement, MEASUREMENT, qos(TOPICS[MEASUREMENT]))
        bench.start("pd", CONTROLLER)
        bench.until(lambda: player.get_subscription_count() == 1)
        bench.start("plant", PLANT, rate_factor="5.0", **{"bench.active": "pd"})
        bench.until(lambda: "pd" in bench.statuses and bench.statuses["pd"].last_tick > 20)
        assert bench.statuses["pd"].ready


@pytest.mark.ros
def test_a_controller_that_knows_the_testbed_before_it_meets_the_questions_stays(
    bench: Bench,
) -> None:
    """DDS tells of a plant's topics one by one; who leaves with the plant left before it came."""
    plant = bench.node.create_publisher(Testbed, TESTBED, qos(TOPICS[TESTBED]))
    bench.start("pd", CONTROLLER, exit_with_plant="true")
    plant.publish(announcement())
    bench.until(lambda: "pd" in bench.statuses and "testbed" not in bench.statuses["pd"].reason)
    end = monotonic() + 2.0  # ten looks
    bench.until(lambda: monotonic() > end)
    assert bench.runs("pd")
    bench.node.destroy_publisher(plant)
    bench.until(lambda: not bench.runs("pd"))


@pytest.mark.ros
def test_after_a_reset_who_was_started_in_flight_hears_the_plan_of_tick_0(bench: Bench) -> None:
    """Of the plans of a flight a newcomer hears the latest, which a reset drops."""
    plant, state = (bench.node.create_publisher(kind, name, qos(TOPICS[name]))
                    for kind, name in ((Testbed, TESTBED), (BenchState, BENCH_STATE)))  # fmt: skip
    asks = bench.node.create_publisher(JointTrajectory, JOINT_TRAJECTORY, 10)
    plant.publish(announcement())
    state.publish(BenchState(state="waiting", last_tick=90_000))
    bench.start(
        "planner", PLANNER, plan="'{method: reference_only, goal: {base_yaw: 0.1}, start: 0.5}'"
    )
    heard: list[Any] = []
    bench.node.create_subscription(Plan, PLAN, heard.append, qos(TOPICS[PLAN]))
    bench.until(lambda: len(heard) == 1)

    state.publish(BenchState(state="paused", stamp=stamp(100.0), tick=10_000, last_tick=90_000))
    bench.until(lambda: asks.get_subscription_count() == 1)
    there = JointTrajectoryPoint(positions=[0.3], time_from_start=Duration(seconds=5).to_msg())
    asks.publish(JointTrajectory(joint_names=["base_yaw"], points=[there]))
    bench.until(lambda: len(heard) == 2)
    bench.start("pd", CONTROLLER)

    def following(number: int) -> bool:
        status = bench.statuses.get("pd")
        return status is not None and bool(status.plan_hash == heard[number].hash)

    bench.until(lambda: following(1))
    state.publish(BenchState(state="waiting", epoch=1, last_tick=90_000))
    bench.until(lambda: len(heard) == 3 and following(0))
    assert heard[2].hash == heard[0].hash != heard[1].hash
    bench.until(lambda: bench.statuses["pd"].reason == "not received by a plant")  # that is all
    assert following(0)


OWN = "'{method: reference_only, goal: {base_yaw: 0.1}, start: 0.5}'"


class Fake:
    """A plant that says where the bench is, and what is heard of the planner's plans."""

    def __init__(self, bench: Bench) -> None:
        self._bench, node = bench, bench.node
        plant = node.create_publisher(Testbed, TESTBED, qos(TOPICS[TESTBED]))
        self._state = node.create_publisher(BenchState, BENCH_STATE, qos(TOPICS[BENCH_STATE]))
        self._asks = node.create_publisher(JointTrajectory, JOINT_TRAJECTORY, 10)
        plant.publish(announcement())
        self.flies()
        self.plans, self.events = self.listen(), list[Any]()
        node.create_subscription(Event, EVENTS, self.events.append, qos(TOPICS[EVENTS]))

    def listen(self) -> list[Any]:
        heard: list[Any] = []
        self._bench.node.create_subscription(Plan, PLAN, heard.append, qos(TOPICS[PLAN]))
        return heard

    def flies(self) -> None:
        self._state.publish(BenchState(state="paused", stamp=stamp(100.0), tick=10_000))

    def resets(self) -> None:
        self._state.publish(BenchState(state="paused", epoch=1))

    def asks(self, goal: float, at: float) -> None:
        """Ask for a plan until one comes at this time: the planner may hear of it later [s]."""
        self._bench.until(lambda: self._asks.get_subscription_count() == 1)
        there = JointTrajectoryPoint(positions=[goal], time_from_start=Duration(seconds=9).to_msg())
        again, end = 0.0, monotonic() + WAIT
        while not self.plans or self.plans[-1].stamp != stamp(at):
            assert monotonic() < end, "it never happened"
            if monotonic() >= again:  # one that comes before they have met is lost
                self._asks.publish(JointTrajectory(joint_names=["base_yaw"], points=[there]))
                again = monotonic() + 3.0
            rclpy.spin_once(self._bench.node, timeout_sec=0.05)


@pytest.mark.ros
def test_after_a_reset_without_a_plan_of_tick_0_nobody_hears_those_of_the_flight_before(
    bench: Bench,
) -> None:
    fake = Fake(bench)
    bench.start("planner", PLANNER)
    fake.asks(0.2, at=100.0)
    bench.start("another", PLANNER, plan=OWN)  # which leaves before it publishes anything
    bench.until(lambda: not bench.runs("another"))
    assert fork_server().exit_code(bench.pids["another"]) == 2
    assert "another planner called planner is on the graph" in bench.log("another")
    fake.resets()
    fake.asks(0.3, at=0.0)
    late = fake.listen()
    bench.until(lambda: bool(late))
    assert {plan.hash for plan in late} == {fake.plans[-1].hash}
    assert fake.plans[0].hash != fake.plans[-1].hash


@pytest.mark.ros
def test_a_planner_that_is_started_in_flight_keeps_the_plan_of_its_parameters_for_a_reset(
    bench: Bench,
) -> None:
    """Controllers that follow another one would refuse it, and not be ready."""
    fake = Fake(bench)
    bench.start("planner", PLANNER, plan=OWN)
    bench.until(lambda: any("flown after a reset" in event.data for event in fake.events))
    assert not fake.plans
    fake.resets()
    bench.until(lambda: len(fake.plans) == 1)
    assert fake.plans[0].stamp == stamp(0.0)
