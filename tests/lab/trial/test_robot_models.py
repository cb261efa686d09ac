"""What RViz draws from the description is what /tf says, for the testbed of every shipped trial."""

from functools import cache
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.present import present

from flexslew_lab.trial.sources import example_trials
from flexslew_lab.trial.trial import load_trial
from flexslew_plant.arrays import Matrix
from flexslew_plant.settings import validated
from flexslew_plant.testbeds import TestbedSettings
from flexslew_plant.testbeds.robot_model import Frame

CARTS = {
    "kind": "identified",
    "joints": ["first", "second", "wrist"],
    "joint_units": ["m", "m", "rad"],
    "inertia": [[2.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.5]],
    "appendages": [],
    "free_modes": [],
    "modes": 0,
    "effort_limit": [1.0, 1.0, 1.0],
}
PIVOTS = {  # about an axis beside its origin, pushed along it and against it
    f"pivot_{name}": {
        "kind": "spacecraft",
        "platform": {"motion": "pivot", "axis": [0.0, 0.6, 0.8], "place": [0.3, -0.2, 0.1]},
        "actuators": {"motor": {"kind": "torque", "direction": direction, "limit": 1.0}},
    }
    for name, direction in {"along": [0.0, 0.6, 0.8], "against": [0.0, -0.6, -0.8]}.items()
}
MOVING = ("continuous", "prismatic")
SECTIONS = {"carts": CARTS, **PIVOTS}
TRIALS = {trial.name: trial.path for trial in example_trials()}


@cache
def read_named_testbed(name: str) -> Any:
    """Return the testbed of a section, or of a shipped trial."""
    if name in SECTIONS:
        return validated(TestbedSettings, SECTIONS[name], "here")
    return load_trial(TRIALS[name]).testbed


def _placed(translation: Any, turn: Rotation) -> Matrix:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn.as_matrix(), translation
    return pose


def _told(frame: Frame) -> Matrix:
    return _placed(frame.translation, Rotation.from_quat(frame.rotation))


def _numbers(element: Any, name: str, default: str = "0 0 0") -> list[float]:
    return [float(word) for word in element.get(name, default).split()]


def _walked(joint: Any, positions: dict[str, float]) -> Matrix:
    """Return where the child of a joint is in its parent, by the description alone."""
    origin = joint.find("origin")
    pose = _placed(_numbers(origin, "xyz"), Rotation.from_euler("xyz", _numbers(origin, "rpy")))
    if joint.get("type") == "fixed":
        return pose
    axis, at = np.array(_numbers(joint.find("axis"), "xyz")), positions[joint.get("name")]
    if joint.get("type") == "prismatic":
        return pose @ _placed(at * axis, Rotation.identity())
    return pose @ _placed(np.zeros(3), Rotation.from_rotvec(at * axis))


@pytest.mark.parametrize("name", [*TRIALS, *SECTIONS])
def test_walking_the_description_ends_where_the_frames_are(name: str) -> None:
    testbed = read_named_testbed(name)
    model, scene = testbed.model(), testbed.scene()
    robot = ElementTree.fromstring(scene.robot_description)
    driven = [j.get("name") for j in robot.findall("joint") if j.get("type") in MOVING]
    angles = np.random.default_rng(3).uniform(-1.0, 1.0, len(driven))
    q = model.rest(dict(zip(driven, angles.tolist(), strict=True)))
    read = model.joint_state(np.concatenate((q, np.zeros(model.coordinates))))[0]
    positions = dict(zip(model.joint_names, read.tolist(), strict=True))
    told = {f.child: f for f in (*scene.frames_at(q, 7.0), *scene.fixed)}
    links = {link.get("name") for link in robot.findall("link")}
    assert links == {*told, "world"}
    for joint in robot.findall("joint"):
        frame = told[present(joint.find("child")).attrib["link"]]
        assert frame.parent == present(joint.find("parent")).attrib["link"]
        if joint.get("type") != "floating":
            walked = _walked(joint, positions)
            np.testing.assert_allclose(_told(frame), walked, atol=1e-12, err_msg=frame.child)


@pytest.mark.parametrize("name", [*TRIALS, *SECTIONS])
def test_what_never_moves_is_static_and_what_moves_is_named_by_the_joint_states(name: str) -> None:
    testbed = read_named_testbed(name)
    scene = testbed.scene()
    names = testbed.model().joint_names if scene.joints is None else scene.joints
    robot = ElementTree.fromstring(scene.robot_description)
    still = {frame.child for frame in scene.fixed}
    for joint in robot.findall("joint"):
        child = present(joint.find("child")).attrib["link"]
        assert (child in still) == (joint.get("type") == "fixed")
        assert joint.get("type") not in MOVING or joint.get("name") in names


@pytest.mark.parametrize("name", [*TRIALS, *SECTIONS])
def test_bodies_have_a_mass_and_an_inertia_that_a_body_can_have(name: str) -> None:
    robot = ElementTree.fromstring(read_named_testbed(name).scene().robot_description)
    found = robot.findall("link/inertial")
    assert found
    for body in found:
        assert float(present(body.find("mass")).attrib["value"]) > 0.0
        inertia = present(body.find("inertia"))
        xx, xy, xz, yy, yz, zz = (
            float(inertia.attrib[f"i{axes}"]) for axes in ("xx", "xy", "xz", "yy", "yz", "zz")
        )
        least, middle, most = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        assert least >= -1e-9 * most  # none at all: a point
        assert most <= (least + middle) * (1.0 + 1e-9)


def test_carts_slide_and_only_what_is_in_radians_turns() -> None:
    robot = ElementTree.fromstring(read_named_testbed("carts").scene().robot_description)
    kinds = {joint.get("name"): joint.get("type") for joint in robot.findall("joint")}
    assert kinds == {"first": "prismatic", "second": "prismatic", "wrist": "continuous"}


def test_a_push_at_a_tip_is_no_joint() -> None:
    testbed = read_named_testbed("scole_full")
    assert "mast_tip_x" in testbed.model().joint_names
    assert testbed.scene().joints == ("x", "y", "z", "roll", "pitch", "yaw")
