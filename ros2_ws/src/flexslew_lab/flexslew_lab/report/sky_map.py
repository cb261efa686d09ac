"""The sphere of the sky on one sheet: where axes of a platform looked, and their cones, as SVG.

Hammer's equal-area projection of inertial longitude and latitude: the inertial x axis is in the
middle, y to the right of it, z on top.
"""

from html import escape
from itertools import pairwise

import numpy as np

from flexslew_lab.report.panels import FAULT, GRID, LINE, style
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds import Testbed
from flexslew_plant.testbeds.contract import Cone, HasSky, Sky
from flexslew_plant.testbeds.orientation.attitude import to_inertial

_HALF_WIDTH, _HALF_HEIGHT = 2.0 * np.sqrt(2.0), np.sqrt(2.0)  # half axes of the projected sphere
_SCALE, _EDGE = 120.0, 12.0  # per unit, and around it
_ROUND = np.linspace(0.0, 2.0 * np.pi, 181)
_RIGHT_EDGE = np.pi - 1e-6  # longitude of the right edge
_MERIDIANS, _PARALLELS = np.deg2rad([-120, -60, 0, 60, 120]), np.deg2rad([-60, -30, 0, 30, 60])


def testbed_sky_map(testbed: Testbed | None, position: Matrix, reference: Matrix) -> str:
    """Return where axes of a testbed looked, as SVG; empty where it has none, or no position.

    Args:
        testbed: that was flown; None: not known.
        position: q in the order of time, shape (k, positions).
        reference: of the joints in the order of time, shape (l, joints); others: not drawn.
    """
    if not isinstance(testbed, HasSky) or position.ndim != 2 or not len(position):
        return ""
    sky, model = testbed.sky(), testbed.model()
    if sky is None or position.shape[1] != model.positions:
        return ""
    reference_attitude = np.empty((0, 4))
    if model.attitude is not None and reference.shape[1:] == (model.joints,):
        reference_attitude = model.attitude.orientation(reference)
    return sky_map(sky, testbed.attitudes(position), reference_attitude)


def sky_map(sky: Sky, attitude: Matrix, reference_attitude: Matrix) -> str:
    """Return the tracks of all boresights, from a ring to a dot, and the cones, as SVG.

    Args:
        sky: of the testbed.
        attitude: quaternions x y z w in the order of time, shape (k, 4).
        reference_attitude: likewise where they should have been, dashed; may be empty.
    """
    width, height = 2.0 * (_HALF_WIDTH * _SCALE + _EDGE), 2.0 * (_HALF_HEIGHT * _SCALE + _EDGE)
    parts = [
        f'<ellipse cx="0" cy="0" rx="{_HALF_WIDTH * _SCALE:.5g}" ry="{_HALF_HEIGHT * _SCALE:.5g}" '
        f'fill="none" stroke="{GRID}"/>',
        *(_curve(line, f'stroke="{GRID}"') for line in _graticule()),
        *(_cone(cone) for cone in sky.cones),
        *(
            _track(name, to_inertial(attitude, axis), str(style(k)["color"]))
            for k, (name, axis) in enumerate(sky.boresights.items())
        ),
        *(
            _curve(to_inertial(reference_attitude, axis), f'stroke="{LINE}" stroke-dasharray="4 5"')
            for axis in sky.boresights.values()
            if len(reference_attitude)
        ),
    ]
    view = f"{-width / 2:.5g} {-height / 2:.5g} {width:.5g} {height:.5g}"
    return (
        f'<svg role="img" aria-label="sphere of boresights" viewBox="{view}" '
        f'font-family="system-ui, sans-serif" font-size="11">{"".join(parts)}</svg>'
    )


def projected(direction: Matrix) -> Matrix:
    """Return directions in inertial space on the sheet, right and down, shape (k, 2)."""
    unit = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    half = 0.5 * np.arctan2(unit[:, 1], unit[:, 0])
    level = np.hypot(unit[:, 0], unit[:, 1])
    size = np.sqrt(1.0 + level * np.cos(half))
    return np.column_stack(
        (_HALF_WIDTH * level * np.sin(half) / size, -_HALF_HEIGHT * unit[:, 2] / size)
    )


def _graticule() -> list[Matrix]:
    """Return meridians and parallels as directions."""
    up, along = np.linspace(-np.pi / 2, np.pi / 2, 61), np.linspace(-_RIGHT_EDGE, _RIGHT_EDGE, 121)
    lines = [_direction(np.full_like(up, m), up) for m in _MERIDIANS]
    return lines + [_direction(along, np.full_like(along, p)) for p in _PARALLELS]


def _direction(longitude: Vector, latitude: Vector) -> Matrix:
    level = np.cos(latitude)
    return np.column_stack((level * np.cos(longitude), level * np.sin(longitude), np.sin(latitude)))


def _cone(cone: Cone) -> str:
    """Return the edge of a cone, with its name in its middle."""
    offset = np.eye(3)[np.argmin(abs(cone.axis))]
    first = np.cross(cone.axis, offset)
    first /= np.linalg.norm(first)
    second = np.cross(cone.axis, first)
    circle = np.outer(np.cos(_ROUND), first) + np.outer(np.sin(_ROUND), second)
    edge = np.cos(cone.half_angle) * cone.axis + np.sin(cone.half_angle) * circle
    (x, y), *_ = _SCALE * projected(cone.axis[None])
    return _curve(edge, f'stroke="{FAULT}" stroke-width="1.5"') + (
        f'<text x="{x:.4g}" y="{y:.4g}" text-anchor="middle" fill="currentColor">'
        f"{escape(cone.name)}</text>"
    )


def _track(name: str, direction: Matrix, color: str) -> str:
    """Return where a boresight looked, from a ring to a dot."""
    ends = _SCALE * projected(direction[[0, -1]])
    (x0, y0), (x1, y1) = ends.tolist()
    alignment = "end" if x1 > 0.0 else "start"
    offset = -7.0 if x1 > 0.0 else 7.0
    return (
        _curve(direction, f'stroke="{color}" stroke-width="2"')
        + f'<circle cx="{x0:.4g}" cy="{y0:.4g}" r="4" fill="none" stroke="{color}"/>'
        + f'<circle cx="{x1:.4g}" cy="{y1:.4g}" r="4" fill="{color}"/>'
        + f'<text x="{x1 + offset:.4g}" y="{y1 - 6.0:.4g}" text-anchor="{alignment}" '
        + f'fill="currentColor">{escape(name)}</text>'
    )


def _curve(direction: Matrix, attributes: str) -> str:
    """Return a curve on the sphere, cut where it leaves the sheet on one side."""
    points = projected(direction)
    splits = 1 + np.flatnonzero(abs(np.diff(points[:, 0])) > _HALF_WIDTH)
    parts = []
    for begin, end in pairwise([0, *splits.tolist(), len(points)]):
        rows = (_SCALE * points[begin:end]).tolist()
        parts.append("M" + "L".join(f"{x:.4g} {y:.4g}" for x, y in rows))
    return f'<path d="{"".join(parts)}" fill="none" {attributes}/>'
