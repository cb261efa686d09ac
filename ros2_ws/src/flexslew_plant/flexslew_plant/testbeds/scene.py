"""How the testbeds look: robot description, frames and the bent beams, as plain numbers."""

from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds import Testbed, csa

HEIGHT = 2.0  # of the hub above the floor [m]
POINTS = 21  # along each drawn appendage
GREY, GOLD, GHOST = "0.35 0.37 0.42 1", "0.85 0.65 0.2 1", "0.6 0.6 0.7 0.25"


class Frame(NamedTuple):
    """child in parent: translation [m] and unit quaternion (x, y, z, w)."""

    parent: str
    child: str
    translation: tuple[float, float, float]
    rotation: tuple[float, float, float, float]


class Scene:
    """Draws a testbed. Frames: world, base (turns with the yaw), hub (pitches in the base)."""

    def __init__(self, testbed: Testbed) -> None:
        self._kind = testbed.kind
        self._modes = testbed.modes
        if isinstance(testbed, csa.CsaTestbed):
            beam = csa.beam(testbed)
            self._radius, self._length = testbed.parameters.hub_radius, beam.length
            s = np.linspace(0.0, beam.length, POINTS)
            self._shapes = beam.shape(s)
        else:
            self._radius, self._length = 0.3, 2.0
            s = np.linspace(0.0, self._length, POINTS)
            self._shapes = np.tile((s / self._length) ** 2, (testbed.modes, 1))
        self._along = s + self._radius

    def frames(self, joints: Vector) -> list[Frame]:
        """Return the frames at these joint positions [rad or m]."""
        still = (0.0, 0.0, 0.0, 1.0)
        if self._kind == "floating_oscillator":
            return [
                Frame("world", "base", (float(joints[0]), 0.0, HEIGHT), still),
                Frame("base", "hub", (0.0, 0.0, 0.0), still),
            ]
        pitch = float(joints[1]) if joints.size > 1 else 0.0
        yaw = float(joints[0])
        return [
            Frame(
                "world", "base", (0.0, 0.0, HEIGHT), (0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2))
            ),
            Frame("base", "hub", (0.0, 0.0, 0.0), (0.0, np.sin(pitch / 2), 0.0, np.cos(pitch / 2))),
        ]

    def beams(self, modes: Vector) -> list[Matrix]:
        """Return the centre line of each appendage in the hub frame, (POINTS, 3) [m]."""
        bend = modes @ self._shapes
        if self._kind == "floating_oscillator":
            end = self._length + float(modes[0])
            return [np.outer(np.linspace(0.0, 1.0, POINTS), (end, 0.0, 0.0))]
        flat = np.zeros(POINTS)
        return [
            np.column_stack((self._along, bend, flat)),
            np.column_stack((-self._along, -bend, flat)),
        ]

    def robot_description(self) -> str:
        """Return the URDF: base, hub and straight appendages; the bend is drawn by markers."""
        r, length = self._radius, self._length
        robot = ElementTree.Element("robot", name=self._kind)
        ElementTree.SubElement(robot, "link", name="world")
        _link(robot, "base", "cylinder", (0.0, 0.0, -1.2), GREY, radius=0.7 * r, length=1.6)
        _link(robot, "hub", "box", (0.0, 0.0, 0.0), GOLD, size=f"{2 * r} {1.2 * r} {0.8 * r}")
        sides = {"beam_positive": 1.0, "beam_negative": -1.0}
        if self._kind == "csa":
            _joint(robot, "base_yaw", "continuous", "world", "base", "0 0 1", HEIGHT)
            _joint(robot, "hub_pitch", "continuous", "base", "hub", "0 1 0")
        elif self._kind == "floating_oscillator":
            _joint(robot, "mass", "prismatic", "world", "base", "1 0 0", HEIGHT)
            _joint(robot, "hub_fixed", "fixed", "base", "hub")
            del sides["beam_negative"]
        else:
            _joint(robot, "hub", "continuous", "world", "base", "0 0 1", HEIGHT)
            _joint(robot, "hub_fixed", "fixed", "base", "hub")
        for name, sign in sides.items():
            middle = (sign * (r + length / 2), 0.0, 0.0)
            _link(robot, name, "box", middle, GHOST, size=f"{length} 0.02 0.4")
            _joint(robot, f"{name}_clamp", "fixed", "hub", name)
        return ElementTree.tostring(robot, encoding="unicode", xml_declaration=True)


def _link(
    robot: ElementTree.Element,
    name: str,
    shape: str,
    origin: tuple[float, float, float],
    color: str,
    **size: object,
) -> None:
    visual = ElementTree.SubElement(ElementTree.SubElement(robot, "link", name=name), "visual")
    ElementTree.SubElement(visual, "origin", xyz=" ".join(map(str, origin)))
    geometry = ElementTree.SubElement(visual, "geometry")
    ElementTree.SubElement(geometry, shape, {key: str(value) for key, value in size.items()})
    material = ElementTree.SubElement(visual, "material", name=f"{name}_color")
    ElementTree.SubElement(material, "color", rgba=color)


def _joint(
    robot: ElementTree.Element,
    name: str,
    kind: str,
    parent: str,
    child: str,
    axis: str = "",
    height: float = 0.0,
) -> None:
    joint = ElementTree.SubElement(robot, "joint", name=name, type=kind)
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    ElementTree.SubElement(joint, "origin", xyz=f"0 0 {height}")
    if axis:
        ElementTree.SubElement(joint, "axis", xyz=axis)
    if kind == "prismatic":
        ElementTree.SubElement(
            joint, "limit", lower="-1e3", upper="1e3", effort="1e6", velocity="1e3"
        )
