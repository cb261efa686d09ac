"""How a spacecraft is drawn: its frames, its bent appendages and its robot description."""

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.robot_model import (
    FAINT,
    GOLD,
    STILL,
    Frame,
    Joint,
    Link,
    Quaternion,
    fixed_frames,
    inertial,
    robot_description,
)
from flexslew_plant.testbeds.scene import Aim, Scene
from flexslew_plant.testbeds.spacecraft.assembly.bodies import turn
from flexslew_plant.testbeds.spacecraft.assembly.craft import Appendage, Spacecraft
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.lines_of_sight import hinge_turned, target_directions

_PIVOT, _TURNING = "pivot", "continuous"
_JOINTS = (at.FORCE, at.TORQUE, at.HINGE, at.WHEEL, at.GYRO)  # what the others push has no joint


def quaternion(axes: Matrix) -> Quaternion:
    """Return x, y, z, w of the frame with the given direction cosines (from its parent)."""
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
    """Return how a spacecraft is drawn.

    Frames: world, platform, one per appendage; and between the first two the pivot, where the
    platform turns about one that is not its origin. A free platform floats; so does an appendage
    with a hinge that turns by itself, as its angle is not measured.
    """
    own = {at.FREE: 7, at.HELD: 0, at.PIVOT: 1}[craft.motion]
    hinges, wheels = len(craft.hinged), len(craft.wheels) + len(craft.gyros)
    first = own + hinges + wheels

    def frames(q: Vector, t: float = 0.0) -> list[Frame]:
        found, hinge = _platform(craft, q), 0
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
    body = inertial(craft.mass, craft.first, craft.inertia)
    links = [Link("world"), Link("platform", "box", {"size": size}, color=GOLD, inertial=body)]
    joints = _platform_joints(craft)
    if len(joints) > 1:
        links.append(Link(_PIVOT))
    for index, a in enumerate(craft.appendages):
        line = _line(a, np.zeros(a.modes))
        middle, span = line.mean(axis=0), np.ptp(line, axis=0)
        wide = " ".join(f"{max(side, 0.01):.6g}" for side in span)
        x, y, z = middle.tolist()
        own_inertial = inertial(a.integrals.mass, a.integrals.first, a.integrals.inertia)
        links.append(Link(a.name, "box", {"size": wide}, (x, y, z), FAINT, own_inertial))
        joints.append(_hinge(craft, index))
    names = tuple(a.name for a in craft.appendages)
    robot = robot_description("spacecraft", links, joints)
    aims, fixed = (lambda t: _aims(craft, t)), fixed_frames(joints)
    moved = tuple(d.name for d in craft.drives if d.what in _JOINTS)
    return Scene(frames, lines, names, robot, frames, aims, fixed, moved, "platform")


def _hinge(craft: Spacecraft, index: int) -> Joint:
    """Return how an appendage hangs on the platform."""
    a = craft.appendages[index]
    x, y, z = a.place.tolist()
    turned = quaternion(a.axes)
    for d in craft.drives:
        if d.what == at.HINGE and d.owner == index:  # its axis is the same in both frames
            return Joint(d.name, _TURNING, "platform", a.name, _axis(a.axis), (x, y, z), turned)
    kind = "fixed" if a.hinge == at.FIXED else "floating"
    return Joint(f"{a.name}_hinge", kind, "platform", a.name, "", (x, y, z), turned)


def _platform_joints(craft: Spacecraft) -> list[Joint]:
    """Return how the platform is carried."""
    if craft.motion == at.FREE:
        return [Joint("platform_pose", "floating", "world", "platform")]
    if craft.motion == at.HELD:
        return [Joint("platform_pose", "fixed", "world", "platform")]
    name, kind, axis = "platform_turn", "floating", ""
    for d in craft.drives:
        # the joint is named and counted as its drive, which may push along the pivot or against it
        along = float(d.direction @ craft.pivot_axis)
        if d.what == at.TORQUE and abs(abs(along) - 1.0) < 1e-12:
            name, kind, axis = d.name, _TURNING, _axis(np.sign(along) * craft.pivot_axis)
            break
    if not craft.pivot_place.any():
        return [Joint(name, kind, "world", "platform", axis)]
    x, y, z = craft.pivot_place.tolist()
    return [
        Joint(name, kind, "world", _PIVOT, axis, (x, y, z)),
        Joint("platform_pose", "fixed", _PIVOT, "platform", "", (-x, -y, -z)),
    ]


def _axis(axis: Vector) -> str:
    return " ".join(map(repr, axis.tolist()))


def _aims(craft: Spacecraft, t: float) -> list[Aim]:
    """Return where the antennas that turn look, with the platform at rest."""
    found = []
    for a in craft.appendages:
        if a.manoeuvres:
            x, y, z = target_directions(a, np.array([t]))[0].tolist()
            found.append(Aim(a.name, (0.0, 0.0, 1.0), (x, y, z)))
    return found


def _platform(craft: Spacecraft, q: Vector) -> list[Frame]:
    """Return where the platform is and how it is turned."""
    if craft.motion == at.FREE:
        x, y, z, a, b, c, d = q[:7].tolist()
        return [Frame("world", "platform", (x, y, z), (a, b, c, d))]
    if craft.motion == at.HELD:
        return [Frame("world", "platform", (0.0, 0.0, 0.0), STILL)]
    turned = quaternion(turn(craft.pivot_axis, float(q[0])))
    if not craft.pivot_place.any():
        return [Frame("world", "platform", (0.0, 0.0, 0.0), turned)]
    x, y, z = craft.pivot_place.tolist()
    return [
        Frame("world", _PIVOT, (x, y, z), turned),
        Frame(_PIVOT, "platform", (-x, -y, -z), STILL),
    ]
