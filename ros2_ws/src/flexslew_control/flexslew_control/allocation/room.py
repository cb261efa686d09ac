"""What limits leave of efforts that give a torque, and of null motion on top."""

import numpy as np

from flexslew_plant.arrays import Vector


def scaled_to(limit: Vector, effort: Vector) -> Vector:
    """Return efforts, all scaled alike where one is beyond its limit, shape (drives,)."""
    over = float((abs(effort) / limit).max())
    return effort / over if over > 1.0 else effort


def with_null_motion(limit: Vector, effort: Vector, null: Vector) -> Vector:
    """Return efforts with as much of others, which give no torque, as the limits leave room for.

    Args:
        limit: shape (drives,).
        effort: within the limits, shape (drives,).
        null: shape (drives,).
    """
    room = np.where(null > 0.0, limit - effort, limit + effort)
    size = abs(null)
    share = np.divide(room, size, out=np.full(size.size, np.inf), where=size > 0.0)
    return np.asarray(effort + min(1.0, max(float(share.min()), 0.0)) * null)
