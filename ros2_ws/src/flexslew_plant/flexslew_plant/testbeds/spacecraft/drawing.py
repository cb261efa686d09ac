"""How a spacecraft is drawn: its frames, its bent appendages and its robot description."""

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.scene import (
    FAINT,
    GOLD,
    Aim,
    Frame,
    Joint,
    Link,
    Scene,
    robot_description,
)
from flexslew_plant.testbeds.spacecraft.assembly.bodies import turn
from flexslew_plant.testbeds.spacecraft.assembly.craft import Appendage, Spacecraft
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.sights import hinge_turned, target_directions


def quaternion(axes: Matrix) -> tuple[float, float, float, float]:
    """Return x, y, z, w of the frame whose direction cosines (from its parent) are given."""
    r = axes.T
    scale = np.array(
        [
            1.0 + r[0, 0] - r[1, 1] - r[2, 2],
            1.0 - r[0, 0] + r[1, 1] - r[2, 2],
            1.0 - r[0, 0] - r[1, 1] + r[2, 2],
            1.0 + np.trace(r),
        ]
    )
    rows = {
        0: (scale[0], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[2, 1] - r[1, 2]),
        1: (r[0, 1] + r[1, 0], scale[1], r[1, 2] + r[2, 1], r[0, 2] - r[2, 0]),
        2: (r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], scale[2], r[1, 0] - r[0, 1]),
        3: (r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], scale[3]),
    }
    q = np.array(rows[int(np.argmax(scale))])
    x, y, z, w = (q / np.linalg.norm(q)).tolist()
    return x, y, z, w


def _box(craft: Spacecraft) -> Vector:
    """Return the sides of the box with the platform's mass and inertia [m]."""
    inertia = np.diag(craft.inertia)
    squares = 6.0 * (inertia.sum() - 2.0 * inertia) / craft.mass
    sides: Vector = np.sqrt(np.maximum(squares, 1e-4))
    return sides


def _line(a: Appendage, q: Vector) -> Matrix:
    """Return the bent centre line of an appendage in its own axes, (points, 3) [m]."""
    if a.shape is None:
        return np.stack((np.zeros(3), 2.0 * a.integrals.first / max(a.integrals.mass, 1e-12)))
    bent: Matrix = a.shape.line + a.shape.line_shape @ q
    return bent


def scene_of(craft: Spacecraft) -> Scene:
    """Return how a spacecraft is drawn. Frames: world, platform, one per appendage."""
    own = {at.FREE: 7, at.HELD: 0, at.PIVOT: 1}[craft.motion]
    hinges, wheels = len(craft.hinged), len(craft.wheels)
    first = own + hinges + wheels

    def frames(q: Vector, t: float = 0.0) -> list[Frame]:
        found, hinge = [Frame("world", "platform", *_pose(craft, q))], 0
        for a in craft.appendages:
            axes = hinge_turned(a, np.array([t]))[0][0] if a.manoeuvres else a.axes
            if a.hinge == at.DRIVEN:
                axes = turn(a.axis, float(q[own + hinge])) @ axes
                hinge += 1
            x, y, z = a.place.tolist()
            found.append(Frame("platform", a.name, (x, y, z), quaternion(axes)))
        return found

    def lines(q: Vector) -> list[Matrix]:
        starts = [first + craft.first_mode(k) for k in range(len(craft.appendages))]
        return [_line(a, q[s : s + a.modes]) for a, s in zip(craft.appendages, starts, strict=True)]

    size = " ".join(f"{side:.6g}" for side in _box(craft))
    links = [Link("world", "", {}), Link("platform", "box", {"size": size}, color=GOLD)]
    joints = [Joint("platform_pose", "fixed", "world", "platform")]
    for a in craft.appendages:
        line = _line(a, np.zeros(a.modes))
        middle, span = line.mean(axis=0), np.ptp(line, axis=0)
        wide = " ".join(f"{max(side, 0.01):.6g}" for side in span)
        x, y, z = middle.tolist()
        links.append(Link(a.name, "box", {"size": wide}, (x, y, z), FAINT))
        joints.append(Joint(f"{a.name}_hinge", "fixed", "platform", a.name))
    names = tuple(a.name for a in craft.appendages)
    robot = robot_description("spacecraft", links, joints)
    return Scene(frames, lines, names, robot, frames, lambda t: _aims(craft, t))


def _aims(craft: Spacecraft, t: float) -> list[Aim]:
    """Return where the antennas that turn look, with the platform at rest."""
    found = []
    for a in craft.appendages:
        if a.manoeuvres:
            x, y, z = target_directions(a, np.array([t]))[0].tolist()
            found.append(Aim(a.name, (0.0, 0.0, 1.0), (x, y, z)))
    return found


def _pose(
    craft: Spacecraft, q: Vector
) -> tuple[tuple[float, float, float], tuple[float, float, float, float]]:
    """Return where the platform is and how it is turned."""
    if craft.motion == at.FREE:
        x, y, z, a, b, c, d = q[:7].tolist()
        return (x, y, z), (a, b, c, d)
    angle = float(q[0]) if craft.motion == at.PIVOT else 0.0
    axes = turn(craft.pivot_axis, angle)
    x, y, z = (craft.pivot_place - axes.T @ craft.pivot_place).tolist()
    return (x, y, z), quaternion(axes)
