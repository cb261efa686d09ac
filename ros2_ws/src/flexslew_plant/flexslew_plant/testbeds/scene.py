"""The drawing of a testbed: robot description, frames and bent appendages, as plain numbers."""

from collections.abc import Callable
from math import cos, sin
from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.robot_model import (
    FAINT,
    GOLD,
    NO_ROTATION,
    Frame,
    Inertial,
    Joint,
    Link,
    Triple,
    fixed_frames,
    principal,
    robot_description,
)

HEIGHT = 2.0  # of the hub above the floor [m]
POINTS = 21  # along each drawn appendage
SPACING = 1.5  # between two carts at zero [m]
_UP: Triple = (0.0, 0.0, HEIGHT)


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
        fixed: frames of the description that never move in their parents; `frames` may have them.
        joints: which of the model's are joints to ROS; None: all. A push at a tip is none.
        body: the frame of the platform; none: the first or, in a chain, the last of `frames`.
    """

    frames: Callable[[Vector], list[Frame]]
    lines: Callable[[Vector], list[Matrix]]
    line_frames: tuple[str, ...]
    robot_description: str
    moving: Callable[[Vector, float], list[Frame]] | None = None
    aims: Callable[[float], list[Aim]] | None = None
    fixed: tuple[Frame, ...] = ()
    joints: tuple[str, ...] | None = None
    body: str = ""

    def frames_at(self, q: Vector, t: float) -> list[Frame]:
        """Return the frames at a time [s]."""
        return self.frames(q) if self.moving is None else self.moving(q, t)


def turntable(
    kind: str,
    joints: tuple[str, ...],
    radius: float,
    length: float,
    shapes: Matrix,
    inertias: tuple[Triple, ...],
    appendage: Inertial,
) -> Scene:
    """Return the scene of a hub that turns on a base, with two opposite appendages.

    Frames: world, base (turns with the first joint), hub (pitches with the second, if any). These
    models have no mass of base and hub: theirs is that of a ball of the hub's size with the largest
    of the inertias.

    Args:
        kind: of the testbed.
        joints: yaw, or yaw and pitch.
        radius: of the hub [m].
        length: of an appendage [m].
        shapes: deflection along it per modal coordinate, shape (modes, POINTS).
        inertias: of the links that the joints turn, about x, y and z [kg m^2].
        appendage: its inertial, seen from its root, along x.
    """
    rest_line = np.zeros((POINTS, 3))
    rest_line[:, 0] = np.linspace(0.0, length, POINTS) + radius
    mirror = np.array([-1.0, -1.0, 1.0])
    m = len(joints)

    def frames(q: Vector) -> list[Frame]:
        yaw, pitch = float(q[0]), float(q[1]) if m > 1 else 0.0
        rotation = (0.0, 0.0, sin(yaw / 2), cos(yaw / 2))
        pitch_rotation = (0.0, sin(pitch / 2), 0.0, cos(pitch / 2))
        return [
            Frame("world", "base", (0.0, 0.0, HEIGHT), rotation),
            Frame("base", "hub", (0.0, 0.0, 0.0), pitch_rotation),
        ]

    def lines(q: Vector) -> list[Matrix]:
        deflection_line = rest_line.copy()
        deflection_line[:, 1] = q[m:].dot(shapes)
        return [deflection_line, deflection_line * mirror]

    seen = max(radius, 0.05 * length)
    inertials = [principal(max(each) / (0.4 * seen**2), each) for each in inertias]
    links = [Link("world"), *_hub(seen, *inertials)]
    connections = [Joint(joints[0], "continuous", "world", "base", "0 0 1", _UP)]
    if m > 1:
        connections.append(Joint(joints[1], "continuous", "base", "hub", "0 1 0"))
    else:
        connections.append(Joint("hub_fixed", "fixed", "base", "hub"))
    for name, sign in (("beam_positive", 1.0), ("beam_negative", -1.0)):
        x = sign * (radius + appendage.center[0])
        offset_body = appendage._replace(center=(x, 0.0, 0.0))
        links.append(_beam_link(name, sign, radius, length, offset_body))
        connections.append(Joint(f"{name}_clamp", "fixed", "hub", name))
    robot = robot_description(kind, links, connections)
    return Scene(frames, lines, ("hub", "hub"), robot, fixed=fixed_frames(connections))


def slider(kind: str, joint: str, radius: float, length: float, masses: tuple[float, ...]) -> Scene:
    """Return the scene of a mass that slides, with a spring to a free mass, if there is one.

    Args:
        kind: of the testbed.
        joint: its name.
        radius: of the driven mass [m].
        length: of the relaxed spring [m].
        masses: the driven one and, if any, the free one [kg].
    """

    def frames(q: Vector) -> list[Frame]:
        return [
            Frame("world", "base", (float(q[0]), 0.0, HEIGHT), NO_ROTATION),
            Frame("base", "hub", (0.0, 0.0, 0.0), NO_ROTATION),
        ]

    def lines(q: Vector) -> list[Matrix]:
        return [np.outer(np.linspace(0.0, 1.0, POINTS), (length + float(q[1]), 0.0, 0.0))]

    cart_body, *free = (principal(mass, _ball(mass, radius)) for mass in masses)
    links = [Link("world"), *_hub(radius, cart_body)]
    connections = [
        Joint(joint, "prismatic", "world", "base", "1 0 0", _UP),
        Joint("hub_fixed", "fixed", "base", "hub"),
    ]
    for mass in free:
        offset_body = mass._replace(center=(radius + length, 0.0, 0.0))
        links.append(_beam_link("beam_positive", 1.0, radius, length, offset_body))
        connections.append(Joint("beam_positive_clamp", "fixed", "hub", "beam_positive"))
    robot, fixed = robot_description(kind, links, connections), fixed_frames(connections)
    if not free:
        return Scene(frames, lambda q: [], (), robot, fixed=fixed)
    return Scene(frames, lines, ("hub",), robot, fixed=fixed)


def schematic(
    kind: str,
    joints: tuple[str, ...],
    appendages: tuple[str, ...],
    tip: Matrix,
    units: tuple[str, ...] = (),
    inertias: tuple[float, ...] = (),
) -> Scene:
    """Return a scene for any testbed: turning hubs in a stack, carts in a row, straight appendages.

    A joint in metres is a cart that slides along x, `SPACING` from the one before; one in radians
    turns a hub about the vertical, on top of what the joint before it moves.

    Args:
        kind: of the testbed.
        joints: their names.
        appendages: names; drawn from the last link, evenly around it.
        tip: deflection of the tips per modal coordinate, shape (appendages, modes).
        units: rad or m, per joint; none: all turn.
        inertias: that each joint moves [kg m^2 or kg]; none: 1.
    """
    m, radius, length = len(joints), 0.3, 2.0
    linear_joints = [unit == "m" for unit in units or ("rad",) * m]
    names = [f"{name}_link" for name in joints]
    parents = ["world", *names[:-1]]
    places = [(0.0, 0.0, HEIGHT), *[(0.0, 0.0, 0.5)] * (m - 1)]
    for k, is_linear in enumerate(linear_joints):
        if is_linear:
            parents[k], places[k] = "world", (SPACING * sum(linear_joints[:k]), 0.0, HEIGHT)
    s = np.linspace(0.0, 1.0, POINTS)
    angles = 2.0 * np.pi * np.arange(len(appendages)) / max(len(appendages), 1)

    def frames(q: Vector) -> list[Frame]:
        found = []
        for k, at in enumerate(q[:m].tolist()):
            x, y, z = places[k]
            place, half_angle = ((x + at, y, z), 0.0) if linear_joints[k] else ((x, y, z), at / 2)
            rotation = (0.0, 0.0, np.sin(half_angle), np.cos(half_angle))
            found.append(Frame(parents[k], names[k], place, rotation))
        return found

    def lines(q: Vector) -> list[Matrix]:
        out = []
        for angle, deflection in zip(angles, tip @ q[m:], strict=True):
            forward, normal = (
                np.array([np.cos(angle), np.sin(angle), 0.0]),
                np.array([-np.sin(angle), np.cos(angle), 0.0]),
            )
            out.append(np.outer(radius + length * s, forward) + np.outer(deflection * s**2, normal))
        return out

    links, connections = [Link("world")], []
    for k, size in enumerate(inertias or (1.0,) * m):
        if linear_joints[k]:
            box = {"size": f"{2 * radius} {radius} {radius}"}
            links.append(Link(names[k], "box", box, inertial=principal(size, _ball(size, radius))))
        else:
            mass = size / (0.4 * radius**2)  # of a ball with this inertia
            geometry = {"radius": radius, "length": 0.4}
            links.append(
                Link(names[k], "cylinder", geometry, inertial=principal(mass, (size,) * 3))
            )
        motion = ("prismatic", "1 0 0") if linear_joints[k] else ("continuous", "0 0 1")
        kind_of_joint, axis = motion
        connections.append(Joint(joints[k], kind_of_joint, parents[k], names[k], axis, places[k]))
    robot = robot_description(kind, links, connections)
    return Scene(frames, lines, (names[-1],) * len(appendages), robot)


def rod(mass: float, length: float, end: float = 0.0) -> Inertial:
    """Return the inertial of a thin rod along x from its root, with a mass at its end.

    Args:
        mass: of the rod [kg].
        length: [m].
        end: the mass at its end [kg].
    """
    whole = mass + end
    center = (0.5 * mass + end) * length / whole
    inertia = (mass / 3.0 + end) * length**2 - whole * center**2
    return principal(whole, (0.01 * inertia, inertia, inertia), (center, 0.0, 0.0))


def _ball(mass: float, radius: float) -> Triple:
    return (0.4 * mass * radius**2,) * 3


def _hub(radius: float, base: Inertial, hub: Inertial | None = None) -> list[Link]:
    r = radius
    foot = {"radius": 0.7 * r, "length": 1.6}
    box = {"size": f"{2 * r} {1.2 * r} {0.8 * r}"}
    return [
        Link("base", "cylinder", foot, (0.0, 0.0, -1.2), inertial=base),
        Link("hub", "box", box, color=GOLD, inertial=hub),
    ]


def _beam_link(name: str, sign: float, radius: float, length: float, inertial: Inertial) -> Link:
    middle = (sign * (radius + length / 2), 0.0, 0.0)
    return Link(name, "box", {"size": f"{length} 0.02 0.4"}, middle, FAINT, inertial)
