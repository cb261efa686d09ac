"""Friction of motors in a batch: a tick is flown until it and the friction agree."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple, cast

import numpy as np

from flexslew_lab.studies.batch.groups.batch_trial import BatchTrial
from flexslew_plant.arrays import Indices, Matrix, Tensor, Vector, compiled, put, vectorised
from flexslew_plant.hardware.friction import (
    CLOSE,
    MAX_ITERATIONS,
    coefficients,
    next_friction,
)
from flexslew_plant.testbeds.compiled import interface, mass
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH, Advance
from flexslew_plant.testbeds.kernels import Kernels


class BatchFriction(NamedTuple):
    """What the friction of every member reads; see hardware.friction."""

    packed: Matrix  # numbers of the equations, (members, size)
    law: Tensor  # viscous and Coulomb coefficients, (members, 2, motors)
    speed: Vector  # v_c, (members,) [rad/s]
    efforts: Indices  # which of them drive the motors; see model.Motors
    position: Indices
    rate: Indices
    sign: Vector


def motion_of(members: Sequence[BatchTrial]) -> tuple[Callable[..., None], BatchFriction | None]:
    """Return what takes the members of a group one tick on, and the friction that it reads."""
    first, model = members[0], members[0].model
    if not first.has_friction:
        return step_without_friction(first.kernel.advance), None
    motors = [member.model.resolved_motors for member in members]
    actuator_settings = [member.trial.actuator for member in members]
    law = np.array([*map(coefficients, motors, actuator_settings)])
    speed = np.array([given.coulomb_speed for given in actuator_settings])
    packed = np.array([member.model.packed for member in members])
    sizes = model.coordinates, model.before_modes, model.efforts
    friction_step = step_with_friction(first.kernel.advance, model.kernels, *sizes)
    return friction_step, BatchFriction(packed, law, speed, *motors[0][1:])


@lru_cache
def step_without_friction(advance: Advance) -> Callable[..., None]:
    """Return what takes members without friction one tick on, called as `sliding` is."""

    @vectorised
    def move(t: float, dt: float, steps: int, friction: None, filled: int, w: Vector) -> None:
        advance(t, dt, steps, filled, w)

    return cast(Callable[..., None], move)


@lru_cache
def step_with_friction(
    advance: Advance, kernels: Kernels, n: int, before: int, m: int
) -> Callable[..., None]:
    """Return what takes members one tick on, with the friction of their motors.

    It takes (t, dt, steps, BatchFriction, number of members in use, w).

    Args:
        advance: of the members without friction.
        kernels: their equations.
        n: coordinates.
        before: of them before the modes.
        m: efforts.
    """
    states, mobility = 2 * n + kernels.extra_positions, _mobility(kernels, n, before, m)

    @compiled
    def friction_step(
        t: float, dt: float, steps: int, friction: BatchFriction, filled: int, w: Vector
    ) -> None:
        motors, start = friction.sign.size, w[: (states + m) * BATCH_WIDTH].copy()
        r, done = np.zeros((filled, motors)), np.zeros(filled, np.bool_)
        mobilities = np.empty((filled, m, m))
        for member in range(filled):
            mobility(friction.packed[member], t, start, member, mobilities[member])
        for _ in range(MAX_ITERATIONS):
            for i in range(start.size):
                w[i] = start[i]
            for member in range(filled):
                for i in range(motors):
                    w[(states + friction.efforts[i]) * BATCH_WIDTH + member] += r[member, i]
            advance(t, dt, steps, filled, w)
            for member in range(filled):
                if not done[member]:
                    done[member] = _has_converged(
                        friction, mobilities[member], start, w, member, dt, r[member]
                    )
            if done.all():
                break
        for i in range(states * BATCH_WIDTH, start.size):
            w[i] = start[i]

    return cast(Callable[..., None], friction_step)


@compiled
def _has_converged(
    friction: BatchFriction,
    mobility: Matrix,
    start: Vector,
    w: Vector,
    member: int,
    dt: float,
    r: Vector,
) -> bool:
    """Return whether a member's motion agrees with its friction; else write that friction to r.

    Args:
        friction: of all members.
        mobility: of all actuators, B^T M^-1 B.
        start: states before the tick, flat.
        w: states after it, flat.
        member: index of the member.
        dt: one tick [s].
        r: friction, (motors,), in and out [N m or N].
    """
    motors = r.size
    v, after, way, motor_matrix = r.copy(), r.copy(), r.copy(), np.empty((motors, motors))
    for i in range(motors):
        sign, at = friction.sign[i], friction.position[i] * BATCH_WIDTH + member
        rate = friction.rate[i] * BATCH_WIDTH + member
        v[i], after[i], way[i] = sign * start[rate], sign * w[rate], sign * (w[at] - start[at])
        for j in range(motors):
            motor_matrix[i, j] = mobility[friction.efforts[i], friction.efforts[j]]
    if not np.isfinite(after).all():
        return True
    law, speed = friction.law[member], friction.speed[member]
    found = next_friction(r, v, after, way, motor_matrix, law, speed, dt)
    if np.abs(found - r).max() <= CLOSE * np.abs(found).max():
        return True
    put(found, r)
    return False


@lru_cache
def _mobility(kernels: Kernels, n: int, before: int, m: int) -> Callable[..., None]:
    """Return what writes B^T M^-1 B of a member, (m, m); see Model.mobility."""
    states, square = 2 * n + kernels.extra_positions, n if kernels.full_mass else before

    @compiled
    def mobility(packed: Vector, t: float, w: Vector, member: int, out: Matrix) -> None:
        x, unit = np.zeros(states), np.zeros(m)
        for i in range(states - n):
            x[i] = w[i * BATCH_WIDTH + member]
        joints, coupling = np.empty((square, square)), np.empty((square, n - square))
        modal, bias, columns = np.empty(n - square), np.empty(n), np.zeros((m, n))
        interface.terms(kernels, packed, t, x, joints, coupling, modal, bias)
        mass.factor(joints, coupling, modal)
        for j in range(m):
            unit[j] = 1.0
            interface.actuation(kernels, packed, t, x, unit, columns[j])
            unit[j] = 0.0
        for j in range(m):
            response = columns[j].copy()
            mass.solve(joints, coupling, modal, response)
            for i in range(m):
                out[i, j] = 0.0
                for k in range(n):
                    out[i, j] += columns[i, k] * response[k]

    return cast(Callable[..., None], mobility)
