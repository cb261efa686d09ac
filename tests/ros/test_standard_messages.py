"""A bench for those without flexslew_msgs: standard messages out, trajectories in."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flexslew_msgs.msg import Event
from flexslew_msgs.srv import SetRate
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import SetParameters
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from sensor_msgs.msg import Imu
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.replay.resim import resim
from flexslew_lab.reproduce.scole_flights import example_values
from flexslew_lab.trial.trial import trial_of_values
from flexslew_plant.graph.topics import EVENTS, JOINT_TRAJECTORY, PLANNED_TRAJECTORY, TOPICS
from flexslew_plant.ros.messages import stamp
from flexslew_plant.ros.offers import qos

from .bystander import Bystander, beside
from .flight import Flight, slew

pytestmark = pytest.mark.ros


def recorded(bag: Path, topic: str) -> list[Any]:
    """Return the messages of a topic, decoded by the bag's own schemas."""
    with next(bag.glob("*.mcap")).open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [ros for *_, ros in reader.iter_decoded_messages(topics=[topic])]


def numbers(vector: Any, axes: str = "xyz") -> list[float]:
    return [getattr(vector, axis) for axis in axes]


def test_the_motion_of_a_free_platform_is_told_in_standard_messages(tmp_path: Path) -> None:
    heard: dict[type, list[Any]] = {Imu: [], Odometry: []}

    def listen(pids: dict[str, int], domain: int) -> None:
        with beside(domain) as bystander:
            for kind, messages in heard.items():
                name = kind.__name__.lower()
                bystander.node.create_subscription(kind, name, messages.append, 10)
            bystander.until(lambda: all(len(messages) > 3 for messages in heard.values()))

    values = example_values("own_spacecraft", {"duration": 4.0, "rate_factor": 2.0})
    flight = Flight(trial_of_values(values, "t"), tmp_path, 10, listen)
    assert flight.outcome.exit_code == 0, flight.log
    truth = BagReader(flight.bag).columns("/truth", {"tick", "position", "velocity", "time"})
    rows = dict(zip(truth["tick"].tolist(), range(len(truth["tick"])), strict=True))

    def row(message: Any) -> int:
        at = message.header.stamp
        return int(rows[round((at.sec + 1e-9 * at.nanosec) / 0.01)])

    odometry, imu = recorded(flight.bag, "/odometry"), recorded(flight.bag, "/imu")
    wrench = recorded(flight.bag, "/wrench")
    assert len(odometry) == len(imu) == len(wrench) == 201  # 50 a second, both ends
    assert {message.header.frame_id for message in imu} == {"platform"}
    for message in odometry + heard[Odometry]:
        q, v = truth["position"][row(message)], truth["velocity"][row(message)]
        pose, twist = message.pose.pose, message.twist.twist
        assert (message.header.frame_id, message.child_frame_id) == ("world", "platform")
        assert numbers(pose.position) + numbers(pose.orientation, "xyzw") == q[:7].tolist()
        assert numbers(twist.linear) + numbers(twist.angular) == v[:6].tolist()
    for message in imu + heard[Imu]:
        q, v = truth["position"][row(message)], truth["velocity"][row(message)]
        assert numbers(message.orientation, "xyzw") == q[3:7].tolist()
        assert numbers(message.angular_velocity) == v[3:6].tolist()
        assert message.linear_acceleration_covariance[0] == -1.0
    pushed = [numbers(m.wrench.force) + numbers(m.wrench.torque) for m in wrench]
    assert np.abs(pushed).max() > 0.0


def trajectory(names: list[str], start: float, *points: dict[str, Any]) -> JointTrajectory:
    message = JointTrajectory(joint_names=names)
    message.header.stamp = stamp(start)
    for values in points:
        after = Duration(nanoseconds=round(1e9 * values.pop("at"))).to_msg()
        message.points.append(JointTrajectoryPoint(time_from_start=after, **values))
    return message


SHAPED = 6.0  # frequency for which the last trajectory is shaped [rad/s]
WRONG_SHAPING = {
    "{shaper: zvx}": "zvx",
    "{goal: {base_yaw: 1.0}}": "shaping: goal: the trajectory has it",
    "zvd": "shaping: give keys of input_shaping",
}


def set_shaping(bystander: Bystander, text: str) -> Any:
    """Return the answer of the planner node to a new value of its parameter `shaping`."""
    parameters = [Parameter("shaping", value=text).to_parameter_msg()]
    return bystander.ask(SetParameters, "planner/set_parameters", parameters=parameters).results[0]


@pytest.fixture(scope="module")
def sent(tmp_path_factory: pytest.TempPathFactory) -> tuple[Flight, list[JointTrajectory]]:
    """Return a flight to which trajectories are sent in a pause, and what is heard as planned."""
    heard: list[JointTrajectory] = []

    def send(pids: dict[str, int], domain: int) -> None:
        with beside(domain) as bystander:
            assert bystander.ask(Trigger, "pause").success
            profile = qos(TOPICS[PLANNED_TRAJECTORY])
            node = bystander.node
            node.create_subscription(JointTrajectory, PLANNED_TRAJECTORY, heard.append, profile)
            events: list[Event] = []
            node.create_subscription(Event, EVENTS, events.append, qos(TOPICS[EVENTS]))

            def told(count: int) -> bool:
                return [event.kind for event in events].count("plan_refused") == count

            ours = node.create_publisher(JointTrajectory, JOINT_TRAJECTORY, 10)
            bystander.until(lambda: bool(heard) and ours.get_subscription_count() == 1)
            wrong = trajectory(["elbow"], 8.0, {"at": 1.0, "positions": [0.1]})
            odd = trajectory(["hub_pitch"], 8.0, {"at": 1.0, "positions": [0.1, 0.2]})
            twice = trajectory(["hub_pitch"] * 2, 8.0, {"at": 1.0, "positions": [0.1, 0.2]})
            nobody = trajectory([], 8.0, {"at": 1.0})
            for count, message in enumerate((wrong, odd, twice, nobody), 1):
                ours.publish(message)
                bystander.until(partial(told, count))
            rest = {"velocities": [0.0, 0.0], "effort": [0.0, 0.0]}
            ours.publish(
                trajectory(
                    ["hub_pitch", "base_yaw"],
                    8.0,
                    {"at": 2.0, "positions": [0.07, 0.15], "velocities": [0.01, 0.03],
                     "effort": [1.0, 2.0]},
                    {"at": 4.0, "positions": [0.1, 0.2], **rest},
                )
            )  # fmt: skip
            bystander.until(lambda: len(heard) == 2)
            for text, words in WRONG_SHAPING.items():
                refused = set_shaping(bystander, text)
                assert not refused.successful
                assert words in refused.reason
            assert set_shaping(bystander, f"{{shaper: zvd, frequencies: [{SHAPED}]}}").successful
            end = {"positions": [0.25], "velocities": [0.0]}
            ours.publish(trajectory(["base_yaw"], 13.0, {"at": 1.0, **end}))
            bystander.until(lambda: len(heard) == 3)
            assert bystander.ask(SetRate, "set_rate", rate_factor=0.0).ok
            assert bystander.ask(Trigger, "start").success

    trial = slew(duration=16.0, rate=1.0, extra="max_missed: 1000")
    return Flight(trial, tmp_path_factory.mktemp("sent"), 10, send), heard


def test_a_trajectory_becomes_a_plan_that_is_flown(
    sent: tuple[Flight, list[JointTrajectory]],
) -> None:
    flight, _ = sent
    assert flight.outcome.exit_code == 0, flight.log
    names = {"tick", "reference_position", "feedforward"}
    state = BagReader(flight.bag).columns("/controller_state", names)
    at = dict(zip(state["tick"].tolist(), state["reference_position"].tolist(), strict=True))
    assert at[799] == pytest.approx([0.1, 0.05])  # the plan before
    assert at[1000] == pytest.approx([0.15, 0.07])
    assert at[1200] == at[1299] == pytest.approx([0.2, 0.1])
    s, h = 0.25, 2.0  # cubic with rates: Hermite's basis at a quarter of the second piece
    basis = 2 * s**3 - 3 * s**2 + 1, h * (s**3 - 2 * s**2 + s), -2 * s**3 + 3 * s**2
    assert at[1050] == pytest.approx(
        [np.dot(basis, (0.15, 0.03, 0.2)), np.dot(basis, (0.07, 0.01, 0.1))]
    )
    given = dict(zip(state["tick"].tolist(), state["feedforward"].tolist(), strict=True))
    assert given[1000] == pytest.approx([2.0 - 0.005, 1.0 - 0.0025])
    assert resim(flight.bag).identical


def test_a_plan_is_told_as_a_trajectory(sent: tuple[Flight, list[JointTrajectory]]) -> None:
    flight, heard = sent
    first, ours, _ = heard
    assert first.joint_names == ours.joint_names == ["base_yaw", "hub_pitch"]
    assert ours.header.stamp == stamp(8.0)
    assert len(first.points) == 501
    assert len(ours.points) == 401
    middle, last = ours.points[200], ours.points[-1]
    assert middle.time_from_start == Duration(seconds=2).to_msg()
    assert middle.positions.tolist() == pytest.approx([0.15, 0.07])
    assert middle.velocities.tolist() == pytest.approx([0.03, 0.01])
    assert last.positions.tolist() == pytest.approx([0.2, 0.1])
    told = recorded(flight.bag, "/planned_trajectory")
    assert [len(message.points) for message in told] == [501, 401, 206]


def test_a_trajectory_is_shaped_as_the_planner_is_set(
    sent: tuple[Flight, list[JointTrajectory]],
) -> None:
    flight, heard = sent
    shaped = np.array([point.positions for point in heard[-1].points])
    t = 0.01 * np.arange(len(shaped))
    delays = np.pi / SHAPED * np.arange(3.0)
    s = np.clip(t[:, None] - delays, 0.0, 1.0)
    path = (3.0 * s**2 - 2.0 * s**3) @ [0.25, 0.5, 0.25]
    assert shaped[:, 0] == pytest.approx(0.2 + 0.05 * path, abs=1e-9)
    assert shaped[:, 1] == pytest.approx(0.1, abs=1e-12)
    state = BagReader(flight.bag).columns("/controller_state", {"tick", "reference_position"})
    assert state["reference_position"][-1] == pytest.approx([0.25, 0.1])


def test_a_trajectory_that_cannot_be_flown_is_refused_in_words(
    sent: tuple[Flight, list[JointTrajectory]],
) -> None:
    flight, _ = sent
    events = BagReader(flight.bag).overview.events
    refused = [event.message for event in events if event.kind == "plan_refused"]
    assert len(refused) == 4
    for names in ("['hub_pitch', 'hub_pitch']", "[]"):
        assert any(f"joint_names: {names} is not allowed: one joint" in line for line in refused)
    assert any("elbow is not a joint of the testbed; allowed: " in line for line in refused)
    assert any("points.0.positions: [0.1, 0.2] is not allowed: one" in line for line in refused)
