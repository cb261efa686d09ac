"""A craft that finds its attitude itself, over ROS 2: the same bits, and its sensors' messages."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flexslew_msgs.srv import SetRate
from geometry_msgs.msg import QuaternionStamped
from sensor_msgs.msg import Imu

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.replay.check import check
from flexslew_lab.replay.resim import resim
from flexslew_lab.reproduce.scole_flights import example_values
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import trial_of_values
from flexslew_plant.graph.topics import SENSORS_ATTITUDE, SENSORS_IMU, TOPICS
from flexslew_plant.ros.offers import qos

from .bystander import beside
from .flight import Flight, patient

PERIOD = 0.05
SENSORS = {
    "gyro": {"kind": "gyro", "angle_random_walk": 2e-6, "bias": [1e-5, -2e-5, 1e-5]},
    "tracker": {"kind": "star_tracker", "across": 5e-6, "interval": 0.2, "delay": 0.1},
}
FOUND = {"kp": [30.0], "kd": [70.0], "attitude": {}}
FROZEN = {"kind": "sensor_freeze", "channel": "tip_deflection", "of": "gyro_x"}
CHANGES: dict[str, Any] = {
    "duration": 6.0,
    "period": PERIOD,
    "goal_tolerance": 2.0,  # it has only begun to turn
    "allow_faults": True,
    "plan": {"method": "reference_only", "goal": {"to": [0.1, 0.0, 1.0]}, "duration": 40.0},
    "controllers": {
        "pd_feedforward": FOUND,
        "pid": {"law": "collocated_pid", **FOUND, "attitude": {"modes": {}}, "ki": [3.0]},
    },
    "schedule": [{"at": 4.0, "until": 4.5, "fault": FROZEN}, {"at": 5.0, "switch": "pid"}],
}


def trial_with(**changes: Any) -> Any:
    values = example_values("three_axes", {"testbed": {"sensors": SENSORS}}) | CHANGES | changes
    return trial_of_values(values, "t")


@pytest.mark.slow
def test_sensors_estimator_fault_and_swap_are_the_same_bits(tmp_path: Path) -> None:
    trial = trial_with()
    flight = Flight(patient(trial), tmp_path / "ros")
    assert flight.outcome.exit_code == 0, flight.log
    here = run_trial(trial, "t", tmp_path / "here", in_process=True, report=False)
    assert flight.metrics["trajectory_hash"] == here.metrics["trajectory_hash"]
    assert flight.metrics["switches"] == flight.metrics["faults"] == 1
    assert resim(flight.bag).identical
    assert check(flight.bag, "pd_feedforward").ok
    assert check(flight.bag, "pid").ok
    over_ros, in_process = BagReader(flight.bag), BagReader(tmp_path / "here/bag")
    assert over_ros.overview.cut is None
    assert over_ros.overview.plans[0].orientation.tobytes() == (
        in_process.overview.plans[0].orientation.tobytes()
    )
    fields = ("reference_orientation", "estimate_orientation")
    rows = [bag.columns("/controller_state", {"tick", *fields}) for bag in (over_ros, in_process)]
    # a question that is asked again is answered again
    each = [np.unique(found["tick"], return_index=True) for found in rows]
    assert each[0][0].tobytes() == each[1][0].tobytes()
    for name in fields:
        one, other = (found[name][first] for found, (_, first) in zip(rows, each, strict=True))
        assert one.shape[1] == 4
        assert one.tobytes() == other.tobytes()


@pytest.mark.ros
def test_gyro_and_star_tracker_are_heard_in_standard_messages(tmp_path: Path) -> None:
    heard: dict[type, list[Any]] = {Imu: [], QuaternionStamped: []}

    def listen(pids: dict[str, int], domain: int) -> None:
        with beside(domain) as bystander:
            for kind, at in ((Imu, SENSORS_IMU), (QuaternionStamped, SENSORS_ATTITUDE)):
                profile = qos(TOPICS[at])
                bystander.node.create_subscription(kind, at, heard[kind].append, profile)
            bystander.until(lambda: all(len(messages) > 3 for messages in heard.values()))
            assert bystander.ask(SetRate, "set_rate", rate_factor=0.0).ok

    paced = trial_with(rate_factor=1.0, duration=10.0, max_missed=1000, schedule=[])
    flight = Flight(paced, tmp_path, 5, listen)
    assert flight.outcome.exit_code == 0, flight.log
    ((_, _, fixed),) = BagReader(flight.bag).decode_messages(("/tf_static",))
    mounted = {frame.child_frame_id: frame for frame in fixed.transforms}
    for name in ("gyro", "tracker"):  # in body axes
        assert mounted[name].header.frame_id == "platform"
        assert mounted[name].transform.rotation.w == 1.0
    rows = BagReader(flight.bag).columns("/measurement", {"tick", "tip_deflection"})
    read = dict(zip(rows["tick"].tolist(), rows["tip_deflection"][:, -7:], strict=True))
    for message in heard[Imu] + heard[QuaternionStamped]:
        at = message.header.stamp
        reading = read[round((at.sec + 1e-9 * at.nanosec) / PERIOD)]
        if isinstance(message, Imu):
            assert message.header.frame_id == "gyro"
            assert message.orientation_covariance[0] == -1.0
            w = message.angular_velocity
            np.testing.assert_array_equal([w.x, w.y, w.z], reading[:3])
        else:
            assert message.header.frame_id == "tracker"
            q = message.quaternion
            np.testing.assert_array_equal([q.x, q.y, q.z, q.w], reading[3:])
            assert q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w > 0.99
