"""The steps of the filter of attitude and bias in compiled code, in place; see attitude_filter.

They take the attitude (4,), the bias (3,) and the covariance (6, 6) of what is believed.
"""

from math import copysign, sqrt

import numpy as np

from flexslew_plant.arrays import Matrix, Vector, called, compiled_once
from flexslew_plant.testbeds.quaternions import (
    Quaternion,
    multiply,
    quaternion_of,
    rotation_vector_of,
    to_body_axes,
)


@called
def rotate(q: Quaternion, x: float, y: float, z: float) -> Quaternion:
    """Return an attitude turned by a rotation vector about its own axes, of length 1."""
    a, b, c, w = multiply(q, quaternion_of(x, y, z))
    size = sqrt(a * a + b * b + c * c + w * w)
    return a / size, b / size, c / size, w / size


@compiled_once("attitude", "covariance")
def carry(
    attitude: Vector,
    bias: Vector,
    covariance: Matrix,
    reading: Vector,
    white: float,
    walk: float,
    dt: float,
) -> None:
    """Take attitude and covariance to a tick later; see RigidFilter.propagate."""
    p = covariance
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


@compiled_once("attitude", "bias", "covariance", "innovation")
def take_attitude(
    attitude: Vector,
    bias: Vector,
    covariance: Matrix,
    measured: Vector,
    noise: Matrix,
    innovation: Vector,
) -> float:
    """Correct the belief, write the innovation (3,) and return its squares (nis).

    See attitude_filter.correct_by_attitude.
    """
    compare_attitude(attitude, measured, innovation)
    return _correct(attitude, bias, covariance, innovation, np.eye(3), noise)


@compiled_once("attitude", "bias", "covariance", "innovation")
def take_direction(
    attitude: Vector,
    bias: Vector,
    covariance: Matrix,
    measured: Vector,
    inertial: Vector,
    sigma: float,
    innovation: Vector,
) -> float:
    """Correct the belief, write the innovation (2,) and return its squares (nis).

    See attitude_filter.correct_by_direction.
    """
    jacobian, noise = np.empty((2, 3)), np.zeros((2, 2))
    compare_direction(attitude, measured, inertial, innovation, jacobian)
    noise[0, 0] = noise[1, 1] = sigma**2
    return _correct(attitude, bias, covariance, innovation, jacobian, noise)


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
    """Write what a measured direction has across the believed one (2,), and H of the turn (2, 3).

    See attitude_filter.correct_by_direction.
    """
    now = (attitude[0], attitude[1], attitude[2], attitude[3])
    x, y, z = to_body_axes(now, inertial[0], inertial[1], inertial[2])
    two = np.empty((2, 3))
    write_cross_axes(x, y, z, two)
    for i in range(2):
        a, b, c = two[i, 0], two[i, 1], two[i, 2]
        innovation[i] = a * measured[0] + b * measured[1] + c * measured[2]
        jacobian[i, 0], jacobian[i, 1], jacobian[i, 2] = b * z - c * y, c * x - a * z, a * y - b * x


@compiled_once("two")
def write_cross_axes(x: float, y: float, z: float, two: Matrix) -> None:
    """Write two unit vectors across a direction and each other, as LAPACK's SVD has them (2, 3)."""
    along = -copysign(sqrt(x * x + y * y + z * z), x)
    more = along * (along - x)
    two[0, 0], two[0, 1], two[0, 2] = y / along, 1.0 - y * y / more, -y * z / more
    two[1, 0], two[1, 1], two[1, 2] = z / along, -y * z / more, 1.0 - z * z / more


@called
def _correct(
    attitude: Vector,
    bias: Vector,
    covariance: Matrix,
    innovation: Vector,
    jacobian: Matrix,
    noise: Matrix,
) -> float:
    """Correct the belief by an innovation of H times the turn; return its nis."""
    error = np.empty(6)
    nis = update_covariance(covariance, innovation, jacobian, noise, error)
    before = (attitude[0], attitude[1], attitude[2], attitude[3])
    after = rotate(before, error[0], error[1], error[2])
    attitude[0], attitude[1], attitude[2], attitude[3] = after
    for i in range(3):
        bias[i] += error[3 + i]
    return nis


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
        error: out, the errors as they are believed then, shape (errors,).
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
