"""What limits leave of efforts that give a torque, and of null motion on top; as machine code."""

from flexslew_plant.arrays import Matrix, Vector, called


@called
def scale_to(limit: Matrix, member: int, effort: Vector) -> None:
    """Scale efforts alike where one is beyond its limit.

    Args:
        limit: shape (members, drives).
        member: which of them counts.
        effort: in and out, shape (drives,).
    """
    over = 1.0
    for i in range(effort.size):
        over = max(over, abs(effort[i]) / limit[member, i])
    for i in range(effort.size):
        effort[i] /= over


@called
def add_null_motion(limit: Matrix, member: int, effort: Vector, null: Vector) -> None:
    """Add as much of efforts that give no torque as the limits leave room for.

    Args:
        limit: shape (members, drives).
        member: which of them counts.
        effort: within the limits, in and out, shape (drives,).
        null: shape (drives,).
    """
    share = 1.0
    for i in range(effort.size):
        if null[i] != 0.0:
            margin = limit[member, i] - effort[i] if null[i] > 0.0 else limit[member, i] + effort[i]
            share = min(share, margin / abs(null[i]))
    for i in range(effort.size):
        effort[i] += max(share, 0.0) * null[i]
