"""A spacecraft has the drives of its file; three torques stand in only where it has none."""

from typing import Any

import pytest

from flexslew_plant.settings import plain
from flexslew_plant.testbeds import read_testbed, with_changes

WHEEL = {"axis": [1.0, 0.0, 0.0], "inertia": 0.01, "limit": 1.0}
GYRO = {"axis": [0.0, 0.0, 1.0], "rotor": [0.0, 1.0, 0.0], "momentum": 1.0}
HINGED = {"hinge": {"kind": "driven"}, "body": {"mass": 1.0}}
PUSH = {"kind": "thruster", "direction": [1.0, 0.0, 0.0], "place": [0.0, 1.0, 0.0], "limit": 1.0}


@pytest.mark.parametrize(
    ("given", "drives"),
    [
        ({}, ("roll", "pitch", "yaw")),
        ({"wheels": {"w": WHEEL}}, ("w",)),
        ({"control_moment_gyros": {"g": GYRO}}, ("g",)),
        ({"actuators": {"push": PUSH}}, ("push",)),
        ({"appendages": {"boom": HINGED}}, ("boom_hinge",)),
        ({"wheels": {"w": WHEEL}, "actuators": {"push": PUSH}}, ("push", "w")),
    ],
)
def test_no_drive_is_added_to_those_of_the_file(
    given: dict[str, Any], drives: tuple[str, ...]
) -> None:
    testbed = read_testbed({"kind": "spacecraft", **given}, "test")
    assert testbed.model().joint_names == drives
    assert read_testbed(plain(testbed), "again") == testbed


def test_a_model_that_takes_a_joint_away_takes_its_initial_position_along() -> None:
    given = {"appendages": {"boom": HINGED}, "wheels": {"w": WHEEL}}
    start = {"boom_hinge": 0.2, "w": 0.1}
    testbed = read_testbed({"kind": "spacecraft", **given, "initial": start}, "test")
    fixed = with_changes(testbed, {"appendages": {"boom": {"hinge": {"kind": "fixed"}}}}, "test")
    assert fixed.initial == {"w": 0.1}
    assert with_changes(testbed, {"initial": {"w": 0.3}}, "test").initial == {**start, "w": 0.3}
