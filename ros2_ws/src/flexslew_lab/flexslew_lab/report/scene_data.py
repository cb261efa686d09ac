"""What the animated view of a report draws: poses of the hub and the bent appendages as numbers."""

from itertools import pairwise
from typing import Any

import numpy as np

from flexslew_lab.report.run_data import RunData
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.scene import Scene


def scene_of(run: RunData) -> dict[str, Any] | None:
    """Return the animation of a run as plain data; None where its testbed cannot be drawn.

    The appendages are a straight line plus the modal coordinates times the beam's shapes, so
    the page only adds up: `line + sum_j q_j shape_j`, points in the hub's frame [m].
    """
    section = run.trial.get("testbed")
    position = run.frame_position
    joints = len(run.joint_names)
    if section is None or position.ndim != 2 or position.shape[1] <= joints:
        return None
    try:
        scene = read_testbed(section, str(run.path)).scene()
    except BadInput:
        return None
    modes = position.shape[1] - joints
    try:
        still = np.zeros(joints)
        straight = scene.lines(np.zeros(joints + modes))
        bent = [scene.lines(np.concatenate((still, row))) for row in np.eye(modes)]
    except ValueError:  # the trial's testbed has another number of modes than its truth
        return None
    if not _is_chain(scene, position[0]):
        return None
    poses = [_pose(scene, row) for row in position]
    return {
        "label": run.label,
        "time": _rounded(run.frame_time, 3),
        "joints": _rounded(position[:, :joints], 5),
        "joint_names": list(run.joint_names),
        "modes": _rounded(position[:, joints:], 5),
        "poses": [_rounded(pose, 5) for pose in poses],
        "beams": [
            {
                "line": _rounded(line, 3),
                "shapes": [_rounded(b[k] - line, 4) for b in bent],
            }
            for k, line in enumerate(straight)
        ],
    }


def _is_chain(scene: Scene, position: Vector) -> bool:
    """Return whether every frame hangs on the one before, so that the last carries all lines."""
    frames = scene.frames(position)
    return all(a.child == b.parent for a, b in pairwise(frames))


def _pose(scene: Scene, position: Vector) -> Vector:
    """Return where the hub is in the world: rotation matrix, then translation, shape (12,)."""
    rotation, translation = np.eye(3), np.zeros(3)
    for frame in scene.frames(position):
        translation = translation + rotation @ np.array(frame.translation)
        rotation = rotation @ _matrix(frame.rotation)
    return np.concatenate((rotation.ravel(), translation))


def _matrix(q: tuple[float, float, float, float]) -> Matrix:
    """Return the rotation of a unit quaternion (x, y, z, w)."""
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _rounded(values: Any, digits: int) -> Any:
    return np.round(np.asarray(values, dtype=float), digits).tolist()
