"""The shape of a testbed now, in world coordinates, and as a flat drawing."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.robot_model import Pose, world_poses
from flexslew_plant.testbeds.scene import Scene

AUTOMATIC, SOLID, FLAT = VIEW_MODES = ("automatic", "three dimensions", "flat")
_ROUND = np.linspace(0.0, 2.0 * np.pi, 25)
_VIEW_AXES = (("from above", 0, 1), ("from the side", 0, 2))
_BODY_COLOR, _REFERENCE_COLOR = "#0072b2", "#969696"


class Shape(NamedTuple):
    """A rigid part."""

    frame: str
    kind: str  # box, cylinder, sphere
    size: tuple[float, ...]  # edges; radius and length; radius [m]
    origin: Vector  # in its frame [m]
    color: str
    opacity: float


class BodyGeometry(NamedTuple):
    """Where the frames and the lines of a testbed are."""

    poses: dict[str, Pose]
    lines: list[Matrix]  # (points, 3) each [m]


@dataclass(frozen=True, eq=False)
class SceneState:
    """A testbed bent as it is, and its reference as an outline."""

    shapes: tuple[Shape, ...]
    deflection: BodyGeometry
    reference_body: BodyGeometry | None
    reach: float  # how far the testbed reaches [m]
    look: int  # how often a direction was chosen
    direction: tuple[float, float, float]  # that is looked from
    view_mode: str  # one of DRAWINGS

    @cached_property
    def flat(self) -> str:
        """It from above and from the side, as SVG."""
        span, width = 1.15 * self.reach, 2.3 * self.reach
        parts = []
        for k, (name, x_axis, up) in enumerate(_VIEW_AXES):
            content = (
                _projected(self.reference_body, self.shapes, x_axis, up, True)
                if self.reference_body
                else ""
            )
            content += _projected(self.deflection, self.shapes, x_axis, up, False)
            parts.append(
                f'<g transform="translate({(k + 0.5) * width:.4g} {span:.4g})">{content}</g>'
                f'<text x="{(k + 0.5) * width:.4g}" y="{0.08 * width:.4g}" text-anchor="middle" '
                f'font-size="{0.05 * width:.4g}">{name}</text>'
            )
        return (
            f'<svg role="img" aria-label="testbed, flat" viewBox="0 0 {2 * width:.4g} {width:.4g}">'
            f"{''.join(parts)}</svg>"
        )


def body(scene: Scene, q: Vector, t: float) -> BodyGeometry:
    """Return where everything is at positions q and a time [s]."""
    poses = world_poses(scene.frames_at(q, t))
    lines = []
    for line, name in zip(scene.lines(q), scene.line_frames, strict=True):
        rotation_matrix, at = poses.get(name, (np.eye(3), np.zeros(3)))
        lines.append(at + np.asarray(line) @ rotation_matrix.T)
    return BodyGeometry(poses, lines)


def shapes_of(description: str, frames: list[str]) -> tuple[Shape, ...]:
    """Return the rigid parts of a robot description."""
    robot = ElementTree.fromstring(description)
    at = {name: (name, np.zeros(3)) for name in frames}
    for joint in robot.iter("joint"):
        parent, child = _name(joint, "parent"), _name(joint, "child")
        if child not in at and parent in at:
            frame, origin = at[parent]
            at[child] = frame, origin + _xyz(joint.find("origin"))
    found = []
    for link in robot.iter("link"):
        visual, name = link.find("visual"), link.get("name", "")
        shape = next(iter(visual.find("geometry") or ()), None) if visual is not None else None
        if visual is None or shape is None or name not in at:
            continue
        frame, origin = at[name]
        color = visual.find("material/color")
        rgba = color.get("rgba", "") if color is not None else ""
        *rgb, opacity = map(float, (rgba or "1 1 1 1").split())
        code = "#" + "".join(f"{round(255 * part):02x}" for part in rgb)
        found.append(
            Shape(
                frame, shape.tag, _size(shape), origin + _xyz(visual.find("origin")), code, opacity
            )
        )
    return tuple(found)


def _size(shape: ElementTree.Element) -> tuple[float, ...]:
    if shape.tag == "box":
        return tuple(map(float, shape.get("size", "1 1 1").split()))
    radius = float(shape.get("radius", 1))
    return (radius, float(shape.get("length", 1))) if shape.tag == "cylinder" else (radius,)


def _projected(
    where: BodyGeometry, shapes: tuple[Shape, ...], x_axis: int, up: int, is_reference: bool
) -> str:
    found = []
    for shape in shapes:
        rotation_matrix, at = where.poses[shape.frame]
        points = at + (shape.origin + _hull_points(shape)) @ rotation_matrix.T
        hull = _hull(points[:, [x_axis, up]])
        color, opacity = (_REFERENCE_COLOR, 0.2) if is_reference else (shape.color, shape.opacity)
        found.append(f'<polygon points="{_pairs(hull)}" fill="{color}" opacity="{opacity:g}"/>')
    color = _REFERENCE_COLOR if is_reference else _BODY_COLOR
    found += [
        f'<polyline points="{_pairs(line[:, [x_axis, up]])}" fill="none" stroke="{color}" '
        'stroke-width="2" vector-effect="non-scaling-stroke"/>'
        for line in where.lines
    ]
    return "".join(found)


def _hull_points(shape: Shape) -> Matrix:
    """Return points with the shape as their convex hull, around its own origin."""
    if shape.kind == "box":
        signs = np.array(np.meshgrid((-0.5, 0.5), (-0.5, 0.5), (-0.5, 0.5))).reshape(3, -1).T
        return np.asarray(signs * np.asarray(shape.size))
    circle = shape.size[0] * np.column_stack((np.cos(_ROUND), np.sin(_ROUND), 0.0 * _ROUND))
    if shape.kind == "cylinder":
        half = np.array([0.0, 0.0, shape.size[1] / 2.0])
        return np.concatenate((circle - half, circle + half))
    return np.concatenate((circle, circle[:, [0, 2, 1]], circle[:, [2, 0, 1]]))


def _hull(points: Matrix) -> Matrix:
    """Return the convex hull of points in the plane, in order."""
    rows = sorted(map(tuple, np.round(points, 6).tolist()))
    chain = []
    for way in (rows, rows[::-1]):
        half: list[tuple[float, ...]] = []
        for p in way:
            while len(half) > 1 and _orientation(half[-2], half[-1], p) <= 0.0:
                half.pop()
            half.append(p)
        chain += half[:-1]
    return np.array(chain or rows[:1])


def _orientation(a: tuple[float, ...], b: tuple[float, ...], c: tuple[float, ...]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _pairs(points: Matrix) -> str:
    return " ".join(f"{x:.4g},{-y:.4g}" for x, y in points)


def _name(joint: ElementTree.Element, end: str) -> str:
    found = joint.find(end)
    return found.get("link", "") if found is not None else ""


def _xyz(origin: ElementTree.Element | None) -> Vector:
    text = origin.get("xyz", "0 0 0") if origin is not None else "0 0 0"
    return np.array([float(part) for part in text.split()])
