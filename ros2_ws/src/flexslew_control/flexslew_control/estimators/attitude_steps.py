"""The steps of a filter of attitude, a gyro's bias and perhaps modes, in compiled code, in place.

Lefferts, Markley and Shuster 1982; the discrete form is that of Crassidis and Junkins, Optimal
Estimation of Dynamic Systems, 2nd ed., section 7.2. The error of the attitude is a small turn in
body axes, q_true = q dq(theta), that of the bias b_true - b. Errors are [e, b, others], with e the
small turn along joints: `ErrorMap` is theirs. Of attitude and bias alone e is theta.
"""

from math import copysign, sqrt
from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Matrix, Vector, called, compiled_once
from flexslew_plant.testbeds.orientation.quaternions import (
    Quaternion,
    multiply,
    quaternion_of,
    rotation_vector_of,
    to_body_axes,
)

BIAS, MODES = 4, 7  # where they begin in a state


class ErrorMap(NamedTuple):
    """From the errors of a filter to attitude and other states."""

    axes: Matrix  # of the joints that e is along, (3, 3)
    inverse: Matrix  # from e to the small turn in body axes, (3, 3)
    motion: Matrix  # from the errors to the states after the bias, (others, errors)


class AttitudeEstimate(NamedTuple):
    """The memory of a filter: what it estimates, and the covariance of the errors of that."""

    # unit quaternion from body to inertial axes, x y z w, then the gyro's bias [rad/s], then others
    state: Vector
    covariance: Matrix  # of [e, b, others], (errors, errors)


@compiled_once()
def rigid_errors() -> ErrorMap:
    """Return the errors of attitude and bias alone."""
    return ErrorMap(np.eye(3), np.eye(3), np.zeros((0, 6)))


@called
def rotate(q: Quaternion, x: float, y: float, z: float) -> Quaternion:
    """Return an attitude turned by a rotation vector about its own axes, of length 1."""
    a, b, c, w = multiply(q, quaternion_of(x, y, z))
    size = sqrt(a * a + b * b + c * c + w * w)
    return a / size, b / size, c / size, w / size


@compiled_once()
def carry(estimate: AttitudeEstimate, reading: Vector, noise: Vector, dt: float) -> None:
    """Take attitude and covariance to a tick later by the gyro.

    theta+ = R(d)^T theta - dt (1 - d x / 2) e + w, d = (reading - b) dt, e the bias' error; the
    covariance of w is Farrenkopf's.

    Args:
        estimate: of attitude and bias, at the start of the tick; updated in place.
        reading: mean rate over the tick, bias and noise in it, shape (3,) [rad/s].
        noise: densities of the gyro's white noise [rad/sqrt(s)] and of the walk of its bias
            [rad/s/sqrt(s)], shape (2,).
        dt: one tick [s].
    """
    attitude, bias, p = estimate.state, estimate.state[BIAS:], estimate.covariance
    white, walk = noise[0], noise[1]
    x, y, z = (reading[0] - bias[0]) * dt, (reading[1] - bias[1]) * dt, (reading[2] - bias[2]) * dt
    a, b, c, w = quaternion_of(x, y, z)
    step, product = (
        np.empty((3, 6)),
        np.empty((3, 6)),
    )  # the rows of the turn; those of the bias stay
    step[0, 0], step[0, 1] = w * w + a * a - b * b - c * c, 2.0 * (a * b + w * c)
    step[1, 1], step[1, 0] = w * w - a * a + b * b - c * c, 2.0 * (a * b - w * c)
    step[2, 2], step[2, 0] = w * w - a * a - b * b + c * c, 2.0 * (a * c + w * b)
    step[0, 2], step[1, 2], step[2, 1] = (
        2.0 * (a * c - w * b), 2.0 * (b * c + w * a), 2.0 * (b * c - w * a),
    )  # fmt: skip
    step[0, 3], step[0, 4], step[0, 5] = -dt, -0.5 * dt * z, 0.5 * dt * y
    step[1, 3], step[1, 4], step[1, 5] = 0.5 * dt * z, -dt, -0.5 * dt * x
    step[2, 3], step[2, 4], step[2, 5] = -0.5 * dt * y, 0.5 * dt * x, -dt
    for i in range(3):
        for j in range(6):
            total = 0.0
            for n in range(6):
                total += step[i, n] * p[n, j]
            product[i, j] = total
    for i in range(3):
        for j in range(i + 1):
            total = 0.0
            for n in range(6):
                total += product[i, n] * step[j, n]
            p[i, j] = p[j, i] = total
        for j in range(3, 6):
            p[i, j] = p[j, i] = product[i, j]
    for i in range(3):
        p[i, i] += white**2 * dt + walk**2 * dt**3 / 3.0
        p[i, i + 3] -= 0.5 * walk**2 * dt**2
        p[i + 3, i] -= 0.5 * walk**2 * dt**2
        p[i + 3, i + 3] += walk**2 * dt
    before = (attitude[0], attitude[1], attitude[2], attitude[3])
    attitude[0], attitude[1], attitude[2], attitude[3] = rotate(before, x, y, z)


@called
def initialize_attitude(
    errors: ErrorMap, estimate: AttitudeEstimate, measured: Vector, noise: Matrix
) -> None:
    """Replace the attitude by the first that is measured; see update_attitude."""
    p, axes = estimate.covariance, errors.axes
    estimate.state[:BIAS] = measured
    p[:3] = 0.0
    p[:, :3] = 0.0
    for i in range(3):
        for j in range(3):
            for n in range(3):
                for m in range(3):
                    p[i, j] += axes[i, n] * noise[n, m] * axes[j, m]


@called
def update_attitude(
    errors: ErrorMap,
    estimate: AttitudeEstimate,
    measured: Vector,
    noise: Matrix,
    innovation: Vector,
) -> float:
    """Correct the estimate by a measured attitude, write the innovation and return its squares.

    Args:
        errors: of the filter.
        estimate: before it; updated in place.
        measured: quaternion x y z w, q_true dq(n), of either sign, shape (4,).
        noise: covariance of the small turn n in body axes, shape (3, 3) [rad^2].
        innovation: out, e of nis = e^T S^-1 e, shape (3,) [rad].
    """
    compare_attitude(estimate.state, measured, innovation)
    return correct(errors, estimate, innovation, errors.inverse, noise)


@called
def update_direction(
    errors: ErrorMap,
    estimate: AttitudeEstimate,
    measured: Vector,
    inertial: Vector,
    sigma: float,
    innovation: Vector,
) -> float:
    """Correct the estimate by a measured direction, which determines the two turns across it.

    Args:
        errors: of the filter.
        estimate: before it; updated in place.
        measured: unit vector in body axes, shape (3,).
        inertial: the same direction in inertial space, a unit vector, shape (3,).
        sigma: standard deviation in each direction across it [rad].
        innovation: out, e of nis = e^T S^-1 e, shape (2,) [rad].
    """
    by_rotation, jacobian, noise = np.empty((2, 3)), np.zeros((2, 3)), np.zeros((2, 2))
    compare_direction(estimate.state, measured, inertial, innovation, by_rotation)
    for i in range(2):
        noise[i, i] = sigma**2
        for j in range(3):
            for n in range(3):
                jacobian[i, j] += by_rotation[i, n] * errors.inverse[n, j]
    return correct(errors, estimate, innovation, jacobian, noise)


@called
def compare_attitude(attitude: Vector, measured: Vector, innovation: Vector) -> None:
    """Write the turn from an attitude to the measured one, quaternions both, (3,) [rad]."""
    inverse = (-attitude[0], -attitude[1], -attitude[2], attitude[3])
    read = (measured[0], measured[1], measured[2], measured[3])
    innovation[0], innovation[1], innovation[2] = rotation_vector_of(multiply(inverse, read))


@called
def compare_direction(
    attitude: Vector, measured: Vector, inertial: Vector, innovation: Vector, jacobian: Matrix
) -> None:
    """Write what a measured direction has across the estimated one (2,), and H (2, 3)."""
    now = (attitude[0], attitude[1], attitude[2], attitude[3])
    x, y, z = to_body_axes(now, inertial[0], inertial[1], inertial[2])
    two = np.empty((2, 3))
    write_cross_axes(x, y, z, two)
    for i in range(2):
        a, b, c = two[i, 0], two[i, 1], two[i, 2]
        innovation[i] = a * measured[0] + b * measured[1] + c * measured[2]
        jacobian[i, 0], jacobian[i, 1], jacobian[i, 2] = b * z - c * y, c * x - a * z, a * y - b * x


@called
def write_cross_axes(x: float, y: float, z: float, two: Matrix) -> None:
    """Write two unit vectors across a direction and each other, as LAPACK's SVD has them (2, 3)."""
    along = -copysign(sqrt(x * x + y * y + z * z), x)
    more = along * (along - x)
    two[0, 0], two[0, 1], two[0, 2] = y / along, 1.0 - y * y / more, -y * z / more
    two[1, 0], two[1, 1], two[1, 2] = z / along, -y * z / more, 1.0 - z * z / more


@called
def correct(
    errors: ErrorMap,
    estimate: AttitudeEstimate,
    innovation: Vector,
    jacobian: Matrix,
    noise: Matrix,
) -> float:
    """Correct the estimate by an innovation of H times e; return its nis."""
    error = np.empty(len(estimate.covariance))
    nis = update_covariance(estimate.covariance, innovation, jacobian, noise, error)
    move(errors, error, estimate.state)
    return nis


@called
def move(errors: ErrorMap, error: Vector, state: Vector) -> None:
    """Add an error to a state."""
    x, y, z, inverse, motion = 0.0, 0.0, 0.0, errors.inverse, errors.motion
    for j in range(3):
        x += inverse[0, j] * error[j]
        y += inverse[1, j] * error[j]
        z += inverse[2, j] * error[j]
        state[BIAS + j] += error[3 + j]
    before = (state[0], state[1], state[2], state[3])
    state[0], state[1], state[2], state[3] = rotate(before, x, y, z)
    for i in range(len(motion)):
        total = 0.0
        for j in range(error.size):
            total += motion[i, j] * error[j]
        state[MODES + i] += total


@called
def update_covariance(
    p: Matrix, innovation: Vector, jacobian: Matrix, noise: Matrix, error: Vector
) -> float:
    """Narrow P by an innovation of H times the first three errors, by Joseph's form.

    Returns its nis.

    Args:
        p: covariance of all errors, in and out, shape (errors, errors).
        innovation: shape (l,).
        jacobian: H, shape (l, 3).
        noise: R, shape (l, l).
        error: out, the errors as they are estimated then, shape (errors,).
    """
    size, errors = innovation.size, len(p)
    gain, residual, spread = np.zeros((size, errors)), innovation.copy(), noise.copy()
    for i in range(size):
        for n in range(3):
            for j in range(errors):
                gain[i, j] += jacobian[i, n] * p[n, j]
        for j in range(size):
            for n in range(3):
                spread[i, j] += gain[i, n] * jacobian[j, n]
    nis = solve(spread, gain, residual)
    _joseph(p, gain, jacobian, noise)
    for j in range(errors):
        error[j] = 0.0
    for i in range(size):
        for j in range(errors):
            error[j] += gain[i, j] * innovation[i]
    return nis


@called
def solve(s: Matrix, gain: Matrix, residual: Vector) -> float:
    """Replace H P by S^-1 H P, the transposed gain, and return e^T S^-1 e; S and e are used up.

    S = H P H^T + R = L L^T by Cholesky.
    """
    size, errors, nis = residual.size, gain.shape[1], 0.0
    for i in range(size):  # L in the place of S, and L^-1 of both
        for j in range(i):
            for n in range(j):
                s[i, j] -= s[i, n] * s[j, n]
            s[i, j] /= s[j, j]
            s[i, i] -= s[i, j] ** 2
            residual[i] -= s[i, j] * residual[j]
            for n in range(errors):
                gain[i, n] -= s[i, j] * gain[j, n]
        s[i, i] = sqrt(s[i, i])
        residual[i] /= s[i, i]
        nis += residual[i] ** 2
        for n in range(errors):
            gain[i, n] /= s[i, i]
    for i in range(size - 1, -1, -1):  # L^-T of the gain
        for j in range(i + 1, size):
            for n in range(errors):
                gain[i, n] -= s[j, i] * gain[j, n]
        for n in range(errors):
            gain[i, n] /= s[i, i]
    return nis


@called
def _joseph(p: Matrix, gain: Matrix, jacobian: Matrix, noise: Matrix) -> None:
    """Replace P by (1 - K H) P (1 - K H)^T + K R K^T, the gain (l, errors) being K^T."""
    size, errors = len(gain), len(p)
    step, product = np.zeros((3, errors)), np.empty((errors, errors))  # 1 - K H, transposed
    for j in range(3):
        step[j, j] = 1.0
        for n in range(size):
            for i in range(errors):
                step[j, i] -= gain[n, i] * jacobian[n, j]
    for i in range(errors):
        for j in range(errors):
            product[i, j] = p[i, j] if i >= 3 else 0.0
        for n in range(3):
            for j in range(errors):
                product[i, j] += step[n, i] * p[n, j]
    for i in range(errors):
        for j in range(i + 1):
            p[i, j] = product[i, j] if j >= 3 else 0.0
        for n in range(3):
            for j in range(i + 1):
                p[i, j] += product[i, n] * step[n, j]
        _add_noise(gain, noise, i, p[i])
        for j in range(i):
            p[j, i] = p[i, j]


@called
def _add_noise(gain: Matrix, noise: Matrix, i: int, row: Vector) -> None:
    """Add K R K^T to the first entries of row i, up to the diagonal."""
    for n in range(len(gain)):
        for m in range(len(gain)):
            for j in range(i + 1):
                row[j] += gain[n, i] * noise[n, m] * gain[m, j]
