from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from tests.present import present

from flexslew_plant.settings import validated
from flexslew_plant.testbeds import WITH_EQUATIONS, TestbedSettings
from flexslew_plant.testbeds.csa import CsaTestbed

# q is as long as v; the free platform, where it is not, has tests of its own
SAME_LENGTHS = [kind for kind in WITH_EQUATIONS if kind != "spacecraft"]


def section_of(kind: Any) -> Any:
    return validated(TestbedSettings, {"kind": kind}, "here")


@pytest.mark.parametrize("kind", SAME_LENGTHS)
def test_the_description_is_a_tree_whose_moving_joints_are_the_testbeds(kind: Any) -> None:
    robot = ElementTree.fromstring(section_of(kind).scene().robot_description)
    assert robot.tag == "robot"
    moving = {j.get("name") for j in robot.findall("joint") if j.get("type") != "fixed"}
    assert moving == set(section_of(kind).model().joint_names)
    links = [link.get("name") for link in robot.findall("link")]
    parents = {
        present(j.find("child")).get("link"): present(j.find("parent")).get("link")
        for j in robot.findall("joint")
    }
    assert len(set(links)) == len(links)
    assert set(links) - set(parents) == {"world"}
    assert set(parents.values()) <= set(links)


@pytest.mark.parametrize("kind", SAME_LENGTHS)
def test_prismatic_and_revolute_joints_have_limits(kind: Any) -> None:
    robot = ElementTree.fromstring(section_of(kind).scene().robot_description)
    for joint in robot.findall("joint"):
        if joint.get("type") in ("prismatic", "revolute"):
            assert joint.find("limit") is not None


@pytest.mark.parametrize("kind", SAME_LENGTHS)
def test_frames_are_those_of_the_description_and_quaternions_are_unit(kind: Any) -> None:
    scene, joints = section_of(kind).scene(), section_of(kind).model().joints
    frames = scene.frames(np.array([2.3, -0.7])[:joints])
    if kind not in ("identified", "linear"):  # which may have any number of joints
        assert [(f.parent, f.child) for f in frames] == [("world", "base"), ("base", "hub")]
    assert [f.parent for f in frames] == ["world", *[f.child for f in frames[:-1]]]
    for frame in frames:
        assert np.linalg.norm(frame.rotation) == pytest.approx(1.0, abs=1e-15)


def test_yaw_turns_about_z_and_pitch_about_y() -> None:
    base, hub = CsaTestbed().scene().frames(np.array([0.8, -0.3]))
    np.testing.assert_allclose(base.rotation, [0.0, 0.0, np.sin(0.4), np.cos(0.4)])
    np.testing.assert_allclose(hub.rotation, [0.0, np.sin(-0.15), 0.0, np.cos(0.15)])


def test_beams_start_at_the_hub_and_end_at_the_tip_deflection() -> None:
    bed = CsaTestbed(modes=3)
    modes = np.array([0.4, -0.05, 0.02])
    tips = bed.model().appendages.tip @ modes
    beams = bed.scene().lines(np.concatenate((np.zeros(2), modes)))
    assert len(beams) == len(tips) == 2
    for beam, tip, side in zip(beams, tips, (1.0, -1.0), strict=True):
        np.testing.assert_allclose(beam[0], [side * 1.0, 0.0, 0.0], atol=1e-14)
        np.testing.assert_allclose(beam[-1], [side * 31.0, tip, 0.0], atol=1e-13)


def test_curvature_at_the_root_is_that_of_the_drawn_beam() -> None:
    bed = CsaTestbed(modes=1)
    drawn = bed.scene().lines(np.array([0.0, 0.0, 1.0]))[0]
    step = drawn[1, 0] - drawn[0, 0]
    # clamped: y = curvature s^2 / 2 near the root
    near = 2.0 * drawn[1, 1] / step**2
    assert bed.model().appendages.curvature[0, 0] == pytest.approx(near, rel=0.05)
