"""What the platform and the tips do over a run, from its logged positions."""

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.contract import Motions, Spins
from flexslew_plant.testbeds.spacecraft.assembly.craft import Spacecraft
from flexslew_plant.testbeds.spacecraft.equations import layout as at


def _rotation_vectors(q: Matrix) -> Matrix:
    """Return quaternions (k, 4) as axis times angle, (k, 3), the shorter way round."""
    q = q * np.where(q[:, 3:] < 0.0, -1.0, 1.0)
    size = np.linalg.norm(q[:, :3], axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(size, q[:, 3:])
    rotations: Matrix = q[:, :3] * np.where(size > 1e-12, angle / np.maximum(size, 1e-12), 2.0)
    return rotations


def _from_goal(goal: Vector, q: Matrix) -> Matrix:
    """Return the quaternions from the goal's attitude to q, shape (k, 4)."""
    v, w = -goal[:3], goal[3]
    vector = w * q[:, :3] + q[:, 3:] * v + np.cross(v, q[:, :3])
    return np.hstack((vector, w * q[:, 3:] - q[:, :3] @ v[:, None]))


def motions(spacecraft: Spacecraft, position: Matrix, velocity: Matrix, goal: Vector) -> Motions:
    """Return the motions of logged states; see Pointing.

    Args:
        spacecraft: the spacecraft.
        position: q, shape (k, positions).
        velocity: v, shape (k, n).
        goal: q at the goal, shape (positions,).
    """
    k, modes = len(position), spacecraft.modes
    platform_size = {at.FREE: 7, at.HELD: 0, at.PIVOT: 1}[spacecraft.motion]
    hinges = len(spacecraft.hinged)
    place = goal_offset = np.zeros((k, 3))
    if spacecraft.motion == at.FREE:
        rotation = _rotation_vectors(position[:, 3:7])
        attitude, place = (
            _rotation_vectors(_from_goal(goal[3:7], position[:, 3:7])),
            position[:, :3],
        )
        goal_offset = place - goal[:3]
    elif spacecraft.motion == at.PIVOT:
        rotation = position[:, :1] * spacecraft.pivot_axis
        attitude = (position[:, :1] - goal[0]) * spacecraft.pivot_axis
    else:
        rotation = attitude = np.zeros((k, 3))
    q = position[:, position.shape[1] - modes :]
    tips, rotations = {}, {}
    for index, a in enumerate(spacecraft.appendages):
        if a.shape is None or not a.modes:
            continue
        modal_q = q[:, spacecraft.first_mode(index) :][:, : a.modes]
        tips[a.name] = modal_q @ (a.axes.T @ a.shape.tip.displacement).T
        rotations[a.name] = modal_q @ (a.axes.T @ a.shape.tip.turn).T
    rates = _wheel_rates(spacecraft, velocity)
    wheels = {w.name: w.inertia * rates[:, i] for i, w in enumerate(spacecraft.wheels)}
    assert platform_size + hinges + len(wheels) + len(spacecraft.gyros) + modes == position.shape[1]
    return Motions(attitude, rotation, place, goal_offset, tips, rotations, wheels)


def spins(spacecraft: Spacecraft, velocity: Matrix) -> Spins:
    """Return what wheels store; see Pointing."""
    rates = _wheel_rates(spacecraft, velocity)
    axes = np.array([w.inertia * w.axis for w in spacecraft.wheels]).reshape(-1, 3)
    stored, end = rates @ axes, velocity.shape[1] - spacecraft.modes
    angles = velocity[:, end - len(spacecraft.gyros) : end]
    torque_axes = np.empty((len(velocity), len(spacecraft.gyros), 3))
    for i, g in enumerate(spacecraft.gyros):
        c, s = np.cos(angles[:, i, None]), np.sin(angles[:, i, None])
        stored = stored + g.momentum * (c * g.rotor + s * g.across)
        torque_axes[:, i] = g.momentum * (c * g.across - s * g.rotor)
    authority = np.ones(len(velocity))
    if spacecraft.gyros:
        sizes = np.linalg.svd(torque_axes, compute_uv=False)
        authority = (
            sizes[:, 2] / sizes[:, 0] if len(spacecraft.gyros) > 2 else np.zeros(len(velocity))
        )
    return Spins(
        {w.name: rates[:, i] for i, w in enumerate(spacecraft.wheels)},
        stored,
        {g.name: angles[:, i] for i, g in enumerate(spacecraft.gyros)},
        authority,
    )


def _wheel_rates(spacecraft: Spacecraft, velocity: Matrix) -> Matrix:
    """Return the speeds of the wheels, shape (k, wheels) [rad/s]."""
    end = velocity.shape[1] - spacecraft.modes - len(spacecraft.gyros)
    return velocity[:, end - len(spacecraft.wheels) : end]
