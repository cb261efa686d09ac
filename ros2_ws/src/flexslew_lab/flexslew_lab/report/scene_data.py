"""What the animated view of a report draws: poses of frames and bent appendages as numbers."""

from itertools import pairwise
from typing import Any

import numpy as np

from flexslew_lab.report.run_data import RunData
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds import Model
from flexslew_plant.testbeds.robot_model import Frame, world_poses
from flexslew_plant.testbeds.scene import Scene

_DEFLECTION_GAIN = 3  # how much a bend that can be seen anyway is exaggerated
_SEEN = 0.02  # of the drawn size: a bend below cannot be seen
_MAX_POSITION = 1e12  # beyond it nothing is drawn: products of it overflow [rad, m]
_MIN_VISIBLE = 0.1  # of the drawn size: a smaller bend is scaled to it


def scene_of(run: RunData) -> dict[str, Any] | None:
    """Return the animation of a run as plain data; None where its testbed cannot be drawn.

    An appendage is a straight line plus the modal coordinates times its shapes, so the page only
    adds up: `line + gain sum_j q_j shape_j`, points in the frame of the line [m]. `body` is the
    frame of the hub or platform; `has_base` is true for a hub on a base, false for a body in
    space; `aims` are the lines of sight of antennas with their targets.
    """
    testbed, position = run.testbed, run.frame_position
    if testbed is None or position.ndim != 2:
        return None
    scene = testbed.scene()
    modes = testbed.modes
    model = testbed.model()
    leading = model.positions - modes
    if position.shape[1] != leading + modes or not modes:
        return None  # the trial's testbed has another number of modes than its truth
    if np.abs(position).max(initial=0.0) > _MAX_POSITION:
        return None
    rest = np.zeros(leading + modes)
    rest_lines = scene.lines(rest)
    mode_lines = [scene.lines(np.concatenate((rest[:leading], row))) for row in np.eye(modes)]
    moments = list(zip(position, run.frame_time.tolist(), strict=True))
    frames = scene.frames(position[0])
    chain = all(a.child == b.parent for a, b in pairwise(frames))
    has_base = chain and model.leading is None
    names = [scene.body or (frames[-1] if has_base else frames[0]).child]
    names += sorted(set(scene.line_frames) - set(names))
    seen = [scene.frames_at(row, t) for row, t in moments]
    pose_rows = [[_pose(frames, name) for frames in seen] for name in names]
    shapes = [np.array([b[k] - line for b in mode_lines]) for k, line in enumerate(rest_lines)]
    return {
        "label": run.label,
        "time": _rounded(run.frame_time, 3),
        "joints": _rounded(_joints(model, position), 5),
        "joint_names": list(run.joint_names),
        "joint_units": list(run.joint_units),
        "modes": _rounded(position[:, leading:], 6),
        "poses": [_rounded(pose, 5) for pose in pose_rows],
        "turntable": has_base,
        "gain": _gain(rest_lines, shapes, position[:, leading:]),
        "beams": [
            {"line": _rounded(line, 3), "shapes": _rounded(shape, 5), "frame": names.index(frame)}
            for line, shape, frame in zip(rest_lines, shapes, scene.line_frames, strict=True)
        ],
        "aims": _boresight_rows(scene, names, run.frame_time),
    }


def _boresight_rows(scene: Scene, names: list[str], time: Vector) -> list[dict[str, Any]]:
    """Return by time each antenna's line of sight in its frame, and its target in the world."""
    if scene.aims is None:
        return []
    each = zip(*(scene.aims(t) for t in time.tolist()), strict=True)
    return [
        {
            "frame": names.index(samples[0].frame),
            "look": list(samples[0].look),
            "target": _rounded([sample.target for sample in samples], 5),
        }
        for samples in each
    ]


def _joints(model: Model, position: Matrix) -> Matrix:
    """Return where each joint is, shape (frames, joints)."""
    zero_rates = np.zeros(model.coordinates)
    return np.array([model.joint_state(np.concatenate((row, zero_rates)))[0] for row in position])


def _gain(rest_lines: list[Matrix], shapes: list[Matrix], modes: Matrix) -> int:
    """Return how much the page exaggerates the bend: a round number that shows it."""
    size = max(float(np.linalg.norm(line, axis=1).max()) for line in rest_lines)
    max_deflection = [
        np.linalg.norm(np.einsum("kj,jpa->kpa", modes, s), axis=2).max() for s in shapes
    ]
    largest = float(max(max_deflection))
    if largest <= 0.0 or largest > _SEEN * size:
        return _DEFLECTION_GAIN
    requested = _MIN_VISIBLE * size / largest
    power_of_10 = 10.0 ** np.floor(np.log10(requested))
    return int(
        max(step for step in (1.0, 2.0, 5.0) if step * power_of_10 <= requested) * power_of_10
    )


def _pose(frames: list[Frame], name: str) -> Vector:
    """Return where a frame is in the world: rotation matrix, then translation, shape (12,)."""
    turn, at = world_poses(frames).get(name, (np.eye(3), np.zeros(3)))
    return np.concatenate((turn.ravel(), at))


def _rounded(values: Any, digits: int) -> Any:
    return np.round(np.asarray(values, dtype=float), digits).tolist()
