"""The steps of the filter with modes in compiled code, in place; see flexible_attitude_filter.

Errors stand in the order [e of the joints, b, e of the others, v] here, so that the first of them
are those that readings show. A state is attitude, bias, modes, then v of the model.
"""

from typing import NamedTuple

import numpy as np

from flexslew_control.estimators.attitude_steps import (
    BIAS,
    MODES,
    AttitudeEstimate,
    ErrorMap,
    move,
    solve,
)
from flexslew_control.linear.held_step import exponential_step
from flexslew_plant.arrays import Matrix, Vector, called, compiled_once
from flexslew_plant.testbeds.orientation.quaternions import Quaternion, multiply, rotation_vector_of


class FlexibleNumbers(NamedTuple):
    """The data of a FlexibleFilter; those of many, row by row in one array each."""

    packed: Vector  # numbers of the equations
    rest: Vector  # q, (positions,)
    axes: Matrix  # of the joints, (3, 3)
    inverse: Matrix  # from the joints to the rotation vector, (3, 3)
    start: Matrix  # from a body rate to v, (coordinates, 3)
    rate: Matrix  # from v to the body rate, (3, coordinates)
    motion: Matrix  # from the errors to modes, then v, (modes + coordinates, errors)
    first: Matrix  # covariance at the start, (errors, errors)
    # [A B] h of all errors but b, balanced, row by row: at rest, then by rates of the joints 1, 2
    # and 3, then by their products 11, 12, 13, 22, 23 and 33, (10, k (k + efforts))
    generators: Matrix
    scale: Vector  # D of D^-1 A D, which balances them, then of the efforts, (k + efforts,)
    sigmas: Vector  # of efforts held for a tick, of the gyro, of the bias' walk, (3,)


@compiled_once()
def begin(
    data: FlexibleNumbers, attitude: Quaternion, reading: Vector, estimate: AttitudeEstimate
) -> None:
    """Write the estimate of an attitude, and of a rate as the gyro reads it."""
    start, state = data.start, estimate.state
    v = state[state.size - len(start) :]
    state[:] = 0.0
    state[0], state[1], state[2], state[3] = attitude
    for i in range(v.size):
        for j in range(3):
            v[i] += start[i, j] * reading[j]
    estimate.covariance[:] = data.first


@called
def errors_of(data: FlexibleNumbers) -> ErrorMap:
    """Return the errors of a filter."""
    return ErrorMap(data.axes, data.inverse, data.motion)


@compiled_once("innovation")
def carry(
    data: FlexibleNumbers,
    estimate: AttitudeEstimate,
    motion: Vector,
    rotation: Quaternion,
    middle: Vector,
    reading: Vector,
    dt: float,
    innovation: Vector,
) -> float:
    """Take an estimate to a tick later, and correct it by the gyro's reading of that tick.

    F and the root of Q are the blocks of W = [F Q^(1/2)]: what the gyro shows of the errors
    before the tick and of the noise during it is C = H W, and the covariance becomes
    (W - K C) diag(P, 1) (W - K C)^T + K R K^T.

    Args:
        data: data of the filter.
        estimate: before the tick; updated in place.
        motion: modes and v at the end of the tick by the equations, (modes + coordinates,).
        rotation: rotation over the tick by them.
        middle: rates of the joints in its middle, (3,) [rad/s].
        reading: reading of the gyro, (3,) [rad/s].
        dt: one tick [s].
        innovation: out, e of the nis e^T S^-1 e that it returns, (3,) [rad/s].
    """
    p, errors, deviation = estimate.covariance, len(data.first), data.sigmas[1]
    state = estimate.state
    angle, inverse = rotation_vector_of(rotation), data.inverse
    slope, jacobian = np.empty((3, 3)), np.zeros((3, 6))
    for i in range(3):
        after, then = (i + 1) % 3, (i + 2) % 3
        slope[i, i], slope[i, after], slope[i, then] = 1.0, -0.5 * angle[then], 0.5 * angle[after]
        innovation[i] = reading[i] - angle[i] / dt - state[BIAS + i]
        jacobian[i, 3 + i] = 1.0
    for i in range(3):
        for j in range(3):
            for n in range(3):
                jacobian[i, j] += slope[i, n] / dt * inverse[n, j]
    step = _over_a_tick(data, middle)
    seen = _product(jacobian, step)
    seen[:, :3] = 0.0  # an error of the attitude turns with the craft
    product, noise = seen.copy(), step.shape[1] - 3
    product[:, :errors] = _product(seen, p)
    gain, variance = product @ step.T, product @ seen.T
    for i in range(3):
        variance[i, i] += deviation**2
    nis = solve(variance, gain, innovation.copy())
    for i in range(errors):  # 1 - K H of what joins meanwhile, too
        for n in range(3):
            for j in range(noise):
                step[i, j] -= gain[n, i] * seen[n, j]
            step[i, noise + n] = deviation * gain[n, i]
    product = step.copy()
    product[:, :errors] = np.ascontiguousarray(step[:, :errors]) @ p
    new_covariance = product @ step.T
    attitude = multiply((state[0], state[1], state[2], state[3]), rotation)
    state[0], state[1], state[2], state[3] = attitude
    for i in range(motion.size):
        state[MODES + i] = motion[i]
    move(errors_of(data), innovation @ gain, state)
    for i in range(errors):
        for j in range(errors):
            p[i, j] = new_covariance[i, j]
    return nis


@called
def _product(jacobian: Matrix, rows: Matrix) -> Matrix:
    """Return a matrix of three rows times the first rows of another, as many as it has columns."""
    out = np.zeros((3, rows.shape[1]))
    for i in range(3):
        for n in range(min(jacobian.shape[1], len(rows))):
            for j in range(rows.shape[1]):
                out[i, j] += jacobian[i, n] * rows[n, j]
    return out


@called
def _over_a_tick(data: FlexibleNumbers, middle: Vector) -> Matrix:
    """Return F over a tick, and to its right the root of the covariance that the tick adds.

    Args:
        data: data of the filter.
        middle: rates of the joints, (3,) [rad/s].

    Returns:
        shape (errors, errors + 3 + efforts + 3), the last three columns zero.
    """
    k, errors, weights, at = len(data.first) - 3, len(data.first), np.empty(10), 4
    weights[0] = 1.0
    for n in range(3):
        weights[1 + n] = middle[n]
        for m in range(n, 3):
            weights[at] = middle[n] * middle[m]
            at += 1
    transition, scale = (weights @ data.generators).reshape((k, -1)), data.scale
    exponential_step(transition)
    of_bias, of_effort, inverse_scale = data.sigmas[2], data.sigmas[0], 1.0 / scale
    step = np.zeros((errors, errors + 3 + transition.shape[1] - k + 3))
    for i in range(3):
        step[3 + i, 3 + i], step[3 + i, errors + i] = 1.0, of_bias
    for i in range(k):
        row = step[i if i < 3 else i + 3]
        for j in range(3):
            row[j] = scale[i] * transition[i, j] * inverse_scale[j]
        for j in range(3, k):
            row[j + 3] = scale[i] * transition[i, j] * inverse_scale[j]
        for j in range(k, transition.shape[1]):
            row[errors + 3 + j - k] = of_effort * scale[i] * transition[i, j] * inverse_scale[j]
    return step
