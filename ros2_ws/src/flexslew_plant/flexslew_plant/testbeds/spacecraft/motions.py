"""What the platform and the tips do over a run, from its logged positions."""

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.contract import Motions, Spins
from flexslew_plant.testbeds.spacecraft.assembly.craft import Spacecraft
from flexslew_plant.testbeds.spacecraft.equations import layout as at


def _turns(q: Matrix) -> Matrix:
    """Return quaternions (k, 4) as axis times angle, (k, 3), the shorter way round."""
    q = q * np.where(q[:, 3:] < 0.0, -1.0, 1.0)
    size = np.linalg.norm(q[:, :3], axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(size, q[:, 3:])
    turns: Matrix = q[:, :3] * np.where(size > 1e-12, angle / np.maximum(size, 1e-12), 2.0)
    return turns


def _from_goal(goal: Vector, q: Matrix) -> Matrix:
    """Return the quaternions from the goal's attitude to q, shape (k, 4)."""
    v, w = -goal[:3], goal[3]
    vector = w * q[:, :3] + q[:, 3:] * v + np.cross(v, q[:, :3])
    return np.hstack((vector, w * q[:, 3:] - q[:, :3] @ v[:, None]))


def motions(craft: Spacecraft, position: Matrix, velocity: Matrix, goal: Vector) -> Motions:
    """Return the motions of logged states; see Pointing.

    Args:
        craft: the spacecraft.
        position: q, shape (k, positions).
        velocity: v, shape (k, n).
        goal: q at the goal, shape (positions,).
    """
    k, modes = len(position), craft.modes
    own = {at.FREE: 7, at.HELD: 0, at.PIVOT: 1}[craft.motion]
    hinges = len(craft.hinged)
    place = away = np.zeros((k, 3))
    if craft.motion == at.FREE:
        turned = _turns(position[:, 3:7])
        attitude, place = _turns(_from_goal(goal[3:7], position[:, 3:7])), position[:, :3]
        away = place - goal[:3]
    elif craft.motion == at.PIVOT:
        turned = position[:, :1] * craft.pivot_axis
        attitude = (position[:, :1] - goal[0]) * craft.pivot_axis
    else:
        turned = attitude = np.zeros((k, 3))
    q = position[:, position.shape[1] - modes :]
    tips, turns = {}, {}
    for index, a in enumerate(craft.appendages):
        if a.shape is None or not a.modes:
            continue
        own_q = q[:, craft.first_mode(index) :][:, : a.modes]
        tips[a.name] = own_q @ (a.axes.T @ a.shape.tip.displacement).T
        turns[a.name] = own_q @ (a.axes.T @ a.shape.tip.turn).T
    rates = _wheel_rates(craft, velocity)
    wheels = {w.name: w.inertia * rates[:, i] for i, w in enumerate(craft.wheels)}
    assert own + hinges + len(wheels) + len(craft.gyros) + modes == position.shape[1]
    return Motions(attitude, turned, place, away, tips, turns, wheels)


def spins(craft: Spacecraft, velocity: Matrix) -> Spins:
    """Return what wheels store; see Pointing."""
    rates = _wheel_rates(craft, velocity)
    axes = np.array([w.inertia * w.axis for w in craft.wheels]).reshape(-1, 3)
    stored, end = rates @ axes, velocity.shape[1] - craft.modes
    angles = velocity[:, end - len(craft.gyros) : end]
    levers = np.empty((len(velocity), len(craft.gyros), 3))
    for i, g in enumerate(craft.gyros):
        c, s = np.cos(angles[:, i, None]), np.sin(angles[:, i, None])
        stored = stored + g.momentum * (c * g.rotor + s * g.across)
        levers[:, i] = g.momentum * (c * g.across - s * g.rotor)
    authority = np.ones(len(velocity))
    if craft.gyros:
        sizes = np.linalg.svd(levers, compute_uv=False)
        authority = sizes[:, 2] / sizes[:, 0] if len(craft.gyros) > 2 else np.zeros(len(velocity))
    return Spins(
        {w.name: rates[:, i] for i, w in enumerate(craft.wheels)},
        stored,
        {g.name: angles[:, i] for i, g in enumerate(craft.gyros)},
        authority,
    )


def _wheel_rates(craft: Spacecraft, velocity: Matrix) -> Matrix:
    """Return the speeds of the wheels, shape (k, wheels) [rad/s]."""
    end = velocity.shape[1] - craft.modes - len(craft.gyros)
    return velocity[:, end - len(craft.wheels) : end]
