"""How a spacecraft is drawn: its frames, its bent appendages and its robot description."""

import numpy as np
from scipy.spatial.transform import Rotation

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.robot_model import (
    FAINT,
    GOLD,
    NO_ROTATION,
    Frame,
    Joint,
    Link,
    Quaternion,
    fixed_frames,
    inertial,
    robot_description,
)
from flexslew_plant.testbeds.scene import Aim, Scene
from flexslew_plant.testbeds.spacecraft.assembly.bodies import rotation_matrix
from flexslew_plant.testbeds.spacecraft.assembly.craft import Appendage, Spacecraft
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.lines_of_sight import (
    hinge_axes_and_angle,
    target_directions,
)

_PIVOT, _CONTINUOUS = "pivot", "continuous"
_JOINTS = (at.FORCE, at.TORQUE, at.HINGE, at.WHEEL, at.GYRO)  # what the others push has no joint


def quaternion(axes: Matrix) -> Quaternion:
    """Return x, y, z, w of the frame with the given direction cosines (from its parent)."""
    x, y, z, w = Rotation.from_matrix(axes.T).as_quat().tolist()
    return x, y, z, w


def _box(spacecraft: Spacecraft) -> Vector:
    """Return the sides of the box with the platform's mass and inertia [m]."""
    inertia = np.diag(spacecraft.inertia)
    squares = 6.0 * (inertia.sum() - 2.0 * inertia) / spacecraft.mass
    sides: Vector = np.sqrt(np.maximum(squares, 1e-4))
    return sides


def _line(a: Appendage, q: Vector) -> Matrix:
    """Return the bent centre line of an appendage in its own axes, (points, 3) [m]."""
    if a.shape is None:
        return np.stack((np.zeros(3), 2.0 * a.integrals.first / max(a.integrals.mass, 1e-12)))
    curve: Matrix = a.shape.line + a.shape.line_shape @ q
    return curve


def scene_of(spacecraft: Spacecraft) -> Scene:
    """Return how a spacecraft is drawn.

    Frames: world, platform, one per appendage; and between the first two the pivot, where the
    platform turns about one that is not its origin. A free platform floats; so does an appendage
    with a hinge that turns by itself, as its angle is not measured.
    """
    platform_size = {at.FREE: 7, at.HELD: 0, at.PIVOT: 1}[spacecraft.motion]
    hinges, wheels = len(spacecraft.hinged), len(spacecraft.wheels) + len(spacecraft.gyros)
    first = platform_size + hinges + wheels

    def frames(q: Vector, t: float = 0.0) -> list[Frame]:
        found, hinge = _platform(spacecraft, q), 0
        for a in spacecraft.appendages:
            axes = hinge_axes_and_angle(a, np.array([t]))[0][0] if a.manoeuvres else a.axes
            if a.hinge == at.DRIVEN:
                axes = rotation_matrix(a.axis, float(q[platform_size + hinge])) @ axes
                hinge += 1
            x, y, z = a.place.tolist()
            found.append(Frame("platform", a.name, (x, y, z), quaternion(axes)))
        return found

    def lines(q: Vector) -> list[Matrix]:
        starts = [first + spacecraft.first_mode(k) for k in range(len(spacecraft.appendages))]
        return [
            _line(a, q[s : s + a.modes]) for a, s in zip(spacecraft.appendages, starts, strict=True)
        ]

    size = " ".join(f"{side:.6g}" for side in _box(spacecraft))
    body = inertial(spacecraft.mass, spacecraft.first, spacecraft.inertia)
    links = [Link("world"), Link("platform", "box", {"size": size}, color=GOLD, inertial=body)]
    joints = _platform_joints(spacecraft)
    if len(joints) > 1:
        links.append(Link(_PIVOT))
    for index, a in enumerate(spacecraft.appendages):
        line = _line(a, np.zeros(a.modes))
        middle, span = line.mean(axis=0), np.ptp(line, axis=0)
        box_size = " ".join(f"{max(side, 0.01):.6g}" for side in span)
        x, y, z = middle.tolist()
        body_inertial = inertial(a.integrals.mass, a.integrals.first, a.integrals.inertia)
        links.append(Link(a.name, "box", {"size": box_size}, (x, y, z), FAINT, body_inertial))
        joints.append(_hinge(spacecraft, index))
    names = tuple(a.name for a in spacecraft.appendages)
    robot = robot_description("spacecraft", links, joints)
    aims, fixed = (lambda t: _aims(spacecraft, t)), fixed_frames(joints)
    joint_names = tuple(d.name for d in spacecraft.drives if d.what in _JOINTS)
    return Scene(frames, lines, names, robot, frames, aims, fixed, joint_names, "platform")


def _hinge(spacecraft: Spacecraft, index: int) -> Joint:
    """Return how an appendage hangs on the platform."""
    a = spacecraft.appendages[index]
    x, y, z = a.place.tolist()
    orientation = quaternion(a.axes)
    for d in spacecraft.drives:
        if d.what == at.HINGE and d.owner == index:  # its axis is the same in both frames
            return Joint(
                d.name, _CONTINUOUS, "platform", a.name, _axis(a.axis), (x, y, z), orientation
            )
    kind = "fixed" if a.hinge == at.FIXED else "floating"
    return Joint(f"{a.name}_hinge", kind, "platform", a.name, "", (x, y, z), orientation)


def _platform_joints(spacecraft: Spacecraft) -> list[Joint]:
    """Return how the platform is carried."""
    if spacecraft.motion == at.FREE:
        return [Joint("platform_pose", "floating", "world", "platform")]
    if spacecraft.motion == at.HELD:
        return [Joint("platform_pose", "fixed", "world", "platform")]
    name, kind, axis = "platform_turn", "floating", ""
    for d in spacecraft.drives:
        # the joint is named and counted as its drive, which may push along the pivot or against it
        along = float(d.direction @ spacecraft.pivot_axis)
        if d.what == at.TORQUE and abs(abs(along) - 1.0) < 1e-12:
            name, kind, axis = d.name, _CONTINUOUS, _axis(np.sign(along) * spacecraft.pivot_axis)
            break
    if not spacecraft.pivot_place.any():
        return [Joint(name, kind, "world", "platform", axis)]
    x, y, z = spacecraft.pivot_place.tolist()
    return [
        Joint(name, kind, "world", _PIVOT, axis, (x, y, z)),
        Joint("platform_pose", "fixed", _PIVOT, "platform", "", (-x, -y, -z)),
    ]


def _axis(axis: Vector) -> str:
    return " ".join(map(repr, axis.tolist()))


def _aims(spacecraft: Spacecraft, t: float) -> list[Aim]:
    """Return where the antennas that turn look, with the platform at rest."""
    found = []
    for a in spacecraft.appendages:
        if a.manoeuvres:
            x, y, z = target_directions(a, np.array([t]))[0].tolist()
            found.append(Aim(a.name, (0.0, 0.0, 1.0), (x, y, z)))
    return found


def _platform(spacecraft: Spacecraft, q: Vector) -> list[Frame]:
    """Return where the platform is and how it is turned."""
    if spacecraft.motion == at.FREE:
        x, y, z, a, b, c, d = q[:7].tolist()
        return [Frame("world", "platform", (x, y, z), (a, b, c, d))]
    if spacecraft.motion == at.HELD:
        return [Frame("world", "platform", (0.0, 0.0, 0.0), NO_ROTATION)]
    orientation = quaternion(rotation_matrix(spacecraft.pivot_axis, float(q[0])))
    if not spacecraft.pivot_place.any():
        return [Frame("world", "platform", (0.0, 0.0, 0.0), orientation)]
    x, y, z = spacecraft.pivot_place.tolist()
    return [
        Frame("world", _PIVOT, (x, y, z), orientation),
        Frame(_PIVOT, "platform", (-x, -y, -z), NO_ROTATION),
    ]
