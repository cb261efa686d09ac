"""How a testbed looks: robot description, frames and bent appendages, as plain numbers."""

from collections.abc import Callable
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from flexslew_plant.arrays import Matrix, Vector

HEIGHT = 2.0  # of the hub above the floor [m]
POINTS = 21  # along each drawn appendage
GREY, GOLD, FAINT = "0.35 0.37 0.42 1", "0.85 0.65 0.2 1", "0.6 0.6 0.7 0.25"
_STILL = (0.0, 0.0, 0.0, 1.0)


class Frame(NamedTuple):
    """child in parent: translation [m] and unit quaternion (x, y, z, w)."""

    parent: str
    child: str
    translation: tuple[float, float, float]
    rotation: tuple[float, float, float, float]


class Link(NamedTuple):
    """A rigid part of the robot description."""

    name: str
    shape: str  # a geometry of URDF: box, cylinder, sphere
    size: dict[str, object]  # its attributes [m]
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m]
    color: str = GREY  # red, green, blue, opacity


class Joint(NamedTuple):
    """A joint of the robot description."""

    name: str
    kind: str  # a type of URDF: continuous, prismatic, fixed
    parent: str
    child: str
    axis: str = ""
    height: float = 0.0  # of the child above its parent [m]


class Aim(NamedTuple):
    """Where an antenna points, and where it should: unit vectors from the origin of its frame."""

    frame: str
    look: tuple[float, float, float]  # in the frame
    target: tuple[float, float, float]  # in the world


class Scene(NamedTuple):
    """Draws a testbed.

    Args:
        frames: from the positions q to the frames.
        lines: from q to the centre line of each appendage, (points, 3) [m].
        line_frames: the frame of each line.
        robot_description: URDF with straight appendages; the bend is drawn by the lines.
        moving: frames from q and the time [s], where some move by themselves; None: `frames`.
        aims: from the time [s] to where antennas look; None: there are none.
    """

    frames: Callable[[Vector], list[Frame]]
    lines: Callable[[Vector], list[Matrix]]
    line_frames: tuple[str, ...]
    robot_description: str
    moving: Callable[[Vector, float], list[Frame]] | None = None
    aims: Callable[[float], list[Aim]] | None = None

    def frames_at(self, q: Vector, t: float) -> list[Frame]:
        """Return the frames at a time [s]."""
        return self.frames(q) if self.moving is None else self.moving(q, t)


def turntable(
    kind: str, joints: tuple[str, ...], radius: float, length: float, shapes: Matrix
) -> Scene:
    """Return the scene of a hub that turns on a base, with two opposite appendages.

    Frames: world, base (turns with the first joint), hub (pitches with the second, if any).

    Args:
        kind: of the testbed.
        joints: yaw, or yaw and pitch.
        radius: of the hub [m].
        length: of an appendage [m].
        shapes: deflection along it per modal coordinate, shape (modes, POINTS).
    """
    along = np.linspace(0.0, length, POINTS) + radius
    m = len(joints)

    def frames(q: Vector) -> list[Frame]:
        yaw, pitch = float(q[0]), float(q[1]) if m > 1 else 0.0
        turned = (0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2))
        pitched = (0.0, np.sin(pitch / 2), 0.0, np.cos(pitch / 2))
        return [
            Frame("world", "base", (0.0, 0.0, HEIGHT), turned),
            Frame("base", "hub", (0.0, 0.0, 0.0), pitched),
        ]

    def lines(q: Vector) -> list[Matrix]:
        bend, flat = q[m:] @ shapes, np.zeros(POINTS)
        return [
            np.column_stack((along, bend, flat)),
            np.column_stack((-along, -bend, flat)),
        ]

    links = [Link("world", "", {}), *_hub(radius)]
    connections = [Joint(joints[0], "continuous", "world", "base", "0 0 1", HEIGHT)]
    if m > 1:
        connections.append(Joint(joints[1], "continuous", "base", "hub", "0 1 0"))
    else:
        connections.append(Joint("hub_fixed", "fixed", "base", "hub"))
    for name, sign in (("beam_positive", 1.0), ("beam_negative", -1.0)):
        links.append(_boom(name, sign, radius, length))
        connections.append(Joint(f"{name}_clamp", "fixed", "hub", name))
    return Scene(frames, lines, ("hub", "hub"), robot_description(kind, links, connections))


def slider(kind: str, joint: str, radius: float, length: float) -> Scene:
    """Return the scene of a mass that slides, with a spring to a free mass.

    Args:
        kind: of the testbed.
        joint: its name.
        radius: of the driven mass [m].
        length: of the relaxed spring [m].
    """

    def frames(q: Vector) -> list[Frame]:
        return [
            Frame("world", "base", (float(q[0]), 0.0, HEIGHT), _STILL),
            Frame("base", "hub", (0.0, 0.0, 0.0), _STILL),
        ]

    def lines(q: Vector) -> list[Matrix]:
        return [np.outer(np.linspace(0.0, 1.0, POINTS), (length + float(q[1]), 0.0, 0.0))]

    links = [
        Link("world", "", {}),
        *_hub(radius),
        _boom("beam_positive", 1.0, radius, length),
    ]
    connections = [
        Joint(joint, "prismatic", "world", "base", "1 0 0", HEIGHT),
        Joint("hub_fixed", "fixed", "base", "hub"),
        Joint("beam_positive_clamp", "fixed", "hub", "beam_positive"),
    ]
    return Scene(frames, lines, ("hub",), robot_description(kind, links, connections))


def schematic(
    kind: str, joints: tuple[str, ...], appendages: tuple[str, ...], tip: Matrix
) -> Scene:
    """Return a scene for any testbed: its joints as a stack of turning hubs, straight appendages.

    Args:
        kind: of the testbed.
        joints: names, each turning the next hub about the vertical.
        appendages: names; drawn from the last hub, evenly around it.
        tip: deflection of the tips per modal coordinate, shape (appendages, modes).
    """
    m, radius, length = len(joints), 0.3, 2.0
    hubs = [f"{name}_link" for name in joints]
    s = np.linspace(0.0, 1.0, POINTS)
    angles = 2.0 * np.pi * np.arange(len(appendages)) / max(len(appendages), 1)

    def frames(q: Vector) -> list[Frame]:
        places = [(0.0, 0.0, HEIGHT), *[(0.0, 0.0, 0.5)] * (m - 1)]
        return [
            Frame(parent, child, place, (0.0, 0.0, np.sin(turn / 2), np.cos(turn / 2)))
            for parent, child, place, turn in zip(
                ("world", *hubs), hubs, places, q[:m].tolist(), strict=False
            )
        ]

    def lines(q: Vector) -> list[Matrix]:
        out = []
        for angle, bend in zip(angles, tip @ q[m:], strict=True):
            forward, aside = (
                np.array([np.cos(angle), np.sin(angle), 0.0]),
                np.array([-np.sin(angle), np.cos(angle), 0.0]),
            )
            out.append(np.outer(radius + length * s, forward) + np.outer(bend * s**2, aside))
        return out

    links = [Link("world", "", {})]
    links += [Link(hub, "cylinder", {"radius": radius, "length": 0.4}) for hub in hubs]
    connections = [
        Joint(name, "continuous", parent, child, "0 0 1", HEIGHT if parent == "world" else 0.5)
        for name, parent, child in zip(joints, ("world", *hubs), hubs, strict=False)
    ]
    return Scene(
        frames,
        lines,
        (hubs[-1],) * len(appendages),
        robot_description(kind, links, connections),
    )


def robot_description(name: str, links: list[Link], joints: list[Joint]) -> str:
    """Return the URDF of these links and joints."""
    robot = ElementTree.Element("robot", name="".join(c if c.isalnum() else "_" for c in name))
    for link in links:
        _add_link(robot, link)
    for joint in joints:
        _add_joint(robot, joint)
    return ElementTree.tostring(robot, encoding="unicode", xml_declaration=True)


def _hub(radius: float) -> list[Link]:
    r = radius
    return [
        Link("base", "cylinder", {"radius": 0.7 * r, "length": 1.6}, (0.0, 0.0, -1.2)),
        Link("hub", "box", {"size": f"{2 * r} {1.2 * r} {0.8 * r}"}, color=GOLD),
    ]


def _boom(name: str, sign: float, radius: float, length: float) -> Link:
    middle = (sign * (radius + length / 2), 0.0, 0.0)
    return Link(name, "box", {"size": f"{length} 0.02 0.4"}, middle, FAINT)


def _add_link(robot: ElementTree.Element, link: Link) -> None:
    element = ElementTree.SubElement(robot, "link", name=link.name)
    if not link.shape:
        return
    visual = ElementTree.SubElement(element, "visual")
    ElementTree.SubElement(visual, "origin", xyz=" ".join(map(str, link.origin)))
    geometry = ElementTree.SubElement(visual, "geometry")
    size = {key: str(value) for key, value in link.size.items()}
    ElementTree.SubElement(geometry, link.shape, size)
    material = ElementTree.SubElement(visual, "material", name=f"{link.name}_color")
    ElementTree.SubElement(material, "color", rgba=link.color)


def _add_joint(robot: ElementTree.Element, joint: Joint) -> None:
    element = ElementTree.SubElement(robot, "joint", name=joint.name, type=joint.kind)
    ElementTree.SubElement(element, "parent", link=joint.parent)
    ElementTree.SubElement(element, "child", link=joint.child)
    ElementTree.SubElement(element, "origin", xyz=f"0 0 {joint.height}")
    if joint.axis:
        ElementTree.SubElement(element, "axis", xyz=joint.axis)
    if joint.kind == "prismatic":
        bounds = {"lower": "-1e3", "upper": "1e3", "effort": "1e6", "velocity": "1e3"}
        ElementTree.SubElement(element, "limit", bounds)
