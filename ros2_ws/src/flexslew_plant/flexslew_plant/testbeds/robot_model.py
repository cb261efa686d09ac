"""A testbed's rigid parts as a robot description (URDF): links with inertia, and joints."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from flexslew_plant.arrays import Matrix, Vector

Triple = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # x, y, z, w
NO_ROTATION: Quaternion = (0.0, 0.0, 0.0, 1.0)
GREY, GOLD, FAINT = "0.35 0.37 0.42 1", "0.85 0.65 0.2 1", "0.6 0.6 0.7 0.25"
_FAR, _STRONG, _FAST = "1e3", "1e6", "1e3"  # URDF requires bounds; the bench has its own


class Frame(NamedTuple):
    """child in parent: translation [m] and unit quaternion (x, y, z, w)."""

    parent: str
    child: str
    translation: Triple
    rotation: Quaternion


Pose = tuple[Matrix, Vector]  # rotation (3, 3), translation (3,) [m]


def world_poses(frames: Iterable[Frame]) -> dict[str, Pose]:
    """Return where frames are in the world, parents before their children."""
    poses: dict[str, Pose] = {}
    for frame in frames:
        turn, at = poses.setdefault(frame.parent, (np.eye(3), np.zeros(3)))
        in_parent = Rotation.from_quat(frame.rotation).as_matrix()
        poses[frame.child] = turn @ in_parent, at + turn @ np.asarray(frame.translation)
    return poses


class Inertial(NamedTuple):
    """How a link resists: mass, centre of mass in the link [m], inertia about it [kg m^2]."""

    mass: float
    center: Triple
    inertia: tuple[float, float, float, float, float, float]  # xx, xy, xz, yy, yz, zz


class Link(NamedTuple):
    """A rigid part of the robot description."""

    name: str
    shape: str = ""  # a geometry of URDF: box, cylinder, sphere; none: it is not seen
    size: Mapping[str, object] | None = None  # its attributes [m]
    origin: Triple = (0.0, 0.0, 0.0)  # of the shape [m]
    color: str = GREY  # red, green, blue, opacity
    inertial: Inertial | None = None


class Joint(NamedTuple):
    """A joint of the robot description."""

    name: str
    kind: str  # a type of URDF: continuous, prismatic, fixed, floating
    parent: str
    child: str
    axis: str = ""
    place: Triple = (0.0, 0.0, 0.0)  # of the child in its parent [m]
    turned: Quaternion = NO_ROTATION  # how the child is turned there


def inertial(mass: float, first: Matrix, origin_inertia: Matrix) -> Inertial | None:
    """Return the inertial of a body; none where it has no mass.

    Args:
        mass: [kg].
        first: first moment, mass times the centre of mass, shape (3,) [kg m].
        origin_inertia: inertia about the origin of the link, shape (3, 3) [kg m^2].
    """
    if mass <= 0.0:
        return None
    x, y, z = (first / mass).tolist()
    center = np.array([x, y, z])
    i = origin_inertia - mass * (center @ center * np.eye(3) - np.outer(center, center))
    return Inertial(
        mass, (x, y, z), (*i[0].tolist(), float(i[1, 1]), float(i[1, 2]), float(i[2, 2]))
    )


def principal(mass: float, inertia: Triple, center: Triple = (0.0, 0.0, 0.0)) -> Inertial:
    """Return the inertial of a body with the principal axes of its link."""
    xx, yy, zz = inertia
    return Inertial(mass, center, (xx, 0.0, 0.0, yy, 0.0, zz))


def fixed_frames(joints: list[Joint]) -> tuple[Frame, ...]:
    """Return the frames of the links that never move in their parents."""
    return tuple(Frame(j.parent, j.child, j.place, j.turned) for j in joints if j.kind == "fixed")


def robot_description(name: str, links: list[Link], joints: list[Joint]) -> str:
    """Return the URDF of these links and joints."""
    robot = ElementTree.Element("robot", name="".join(c if c.isalnum() else "_" for c in name))
    for link in links:
        _add_link(robot, link)
    for joint in joints:
        _add_joint(robot, joint)
    return ElementTree.tostring(robot, encoding="unicode", xml_declaration=True)


def _add_link(robot: ElementTree.Element, link: Link) -> None:
    element = ElementTree.SubElement(robot, "link", name=link.name)
    if link.inertial is not None:
        mass, center, inertia = link.inertial
        body = ElementTree.SubElement(element, "inertial")
        ElementTree.SubElement(body, "origin", xyz=_text(center))
        ElementTree.SubElement(body, "mass", value=repr(mass))
        names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        values = {name: repr(value) for name, value in zip(names, inertia, strict=True)}
        ElementTree.SubElement(body, "inertia", values)
    if not link.shape:
        return
    visual = ElementTree.SubElement(element, "visual")
    ElementTree.SubElement(visual, "origin", xyz=_text(link.origin))
    geometry = ElementTree.SubElement(visual, "geometry")
    size = {key: str(value) for key, value in (link.size or {}).items()}
    ElementTree.SubElement(geometry, link.shape, size)
    material = ElementTree.SubElement(visual, "material", name=f"{link.name}_color")
    ElementTree.SubElement(material, "color", rgba=link.color)


def _add_joint(robot: ElementTree.Element, joint: Joint) -> None:
    element = ElementTree.SubElement(robot, "joint", name=joint.name, type=joint.kind)
    ElementTree.SubElement(element, "parent", link=joint.parent)
    ElementTree.SubElement(element, "child", link=joint.child)
    angles = Rotation.from_quat(joint.turned).as_euler("xyz").tolist()  # about fixed axes: URDF's
    ElementTree.SubElement(element, "origin", xyz=_text(joint.place), rpy=_text(angles))
    if joint.axis:
        ElementTree.SubElement(element, "axis", xyz=joint.axis)
    if joint.kind == "prismatic":
        bounds = {"lower": f"-{_FAR}", "upper": _FAR, "effort": _STRONG, "velocity": _FAST}
        ElementTree.SubElement(element, "limit", bounds)


def _text(numbers: Triple | list[float]) -> str:
    return " ".join(map(repr, numbers))
