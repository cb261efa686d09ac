"""The tick of the filter of attitude and bias for other machine code, which keeps its state.

In compiled form, by the same steps, the result of AttitudeEstimator for one run with a RigidFilter.
"""

from collections.abc import Callable
from math import sqrt
from typing import Any, NamedTuple, cast

import numpy as np

from flexslew_control.estimators.attitude_estimator import LEAST, PRESENT, AttitudeEstimator
from flexslew_control.estimators.attitude_steps import carry, rotate, take_attitude, take_direction
from flexslew_plant.arrays import Indices, Matrix, Tensor, Vector, called, compiled_once
from flexslew_plant.testbeds.attitude import apply_attitude_error, joint_rotation_vector
from flexslew_plant.testbeds.quaternions import quaternion_of, rotation_vector_of

_BIAS, _COVARIANCE, _FOUND, _SEEN = 4, 7, 43, 44  # where they begin in the memory


class AttitudeNumbers(NamedTuple):
    """The constants of a filter. Those of many, row by row in one array each, see `numbers_of`."""

    axes: Matrix  # of the joints, see AttitudeJoints, (joints, 3)
    inverse: Matrix  # from the joints to the rotation vector, (3, joints)
    gyro: Indices  # its first channel, (1,)
    tracker: Indices  # first channels, and by how many ticks they are late, (trackers, 2)
    tracker_noise: Tensor  # covariances at rest, (trackers, 3, 3) [rad^2]
    rate_noise: Vector  # what the square of the rate adds to them, (trackers,) [s^2]
    sun: Indices  # first channels, (suns,)
    sun_direction: Matrix  # in inertial space, (suns, 3)
    sun_sigma: Vector  # (suns,) [rad]
    gyro_noise: Vector  # GyroNoise, (2,)
    sigmas: Vector  # of attitude [rad] and bias [rad/s] at the start, (2,)
    period: Vector  # one tick, (1,) [s]


def attitude_numbers(estimator: AttitudeEstimator) -> AttitudeNumbers:
    """Return the constants of an estimator but for what it believes of a craft that bends."""
    it, s = estimator, estimator.settings
    count, factor = len(it.trackers), s.noise_factor
    late = [(one.first, one.delay_ticks(it.period)) for one in it.trackers]
    noise_matrices = [factor**2 * one.covariance + LEAST**2 * np.eye(3) for one in it.trackers]
    return AttitudeNumbers(
        np.array(it.joints.axes, dtype=np.float64),
        np.array(it.joints.rotation_vector_of(np.eye(len(it.joints.axes))).T, order="C"),
        np.array([it.gyro.first]),
        np.array(late).reshape(count, 2),
        np.array(noise_matrices).reshape(count, 3, 3),
        np.array([(factor * one.settings.rate_noise) ** 2 for one in it.trackers]),
        np.array([one.first for one in it.sun_sensors], dtype=np.int64),
        np.array([one.sun for one in it.sun_sensors]).reshape(-1, 3),
        np.array([factor * one.settings.noise + LEAST for one in it.sun_sensors]),
        np.array(it.filter.noise),
        np.array([s.initial_attitude, s.initial_bias]),
        np.array([it.period]),
    )


def attitude_memory(numbers: AttitudeNumbers, tips: int) -> int:
    """Return how many numbers the tick keeps in its memory.

    Args:
        numbers: of the filter.
        tips: channels of all tips.
    """
    return _SEEN + tips * (1 + int(numbers.tracker[:, 1].max(initial=0)))


@called
def numbers_of(batch: AttitudeNumbers, member: int) -> AttitudeNumbers:
    """Return the constants of one member, from arrays with a row for each."""
    return AttitudeNumbers(
        batch.axes[member],
        batch.inverse[member],
        batch.gyro[member],
        batch.tracker[member],
        batch.tracker_noise[member],
        batch.rate_noise[member],
        batch.sun[member],
        batch.sun_direction[member],
        batch.sun_sigma[member],
        batch.gyro_noise[member],
        batch.sigmas[member],
        batch.period[member],
    )


@compiled_once("memory", "believed")
def attitude_tick(
    k: int,
    numbers: AttitudeNumbers,
    tips: Vector,
    measured: Vector,
    reference: Vector,
    memory: Vector,
    believed: Vector,
) -> None:
    """Write positions and velocities of the joints as they are believed at tick k.

    Args:
        k: tick, from 0 on, one after another.
        numbers: of the filter.
        tips: readings of all tips at this tick.
        measured: positions, then velocities of the joints, shape (2 joints,); kept where they do
            not read the attitude.
        reference: where the joints shall be.
        memory: in and out, see attitude_memory; anything at tick 0.
        believed: positions about the reference, then velocities, shape (2 joints,).
    """
    gyro, dt, late = numbers.gyro[0], numbers.period[0], 0
    for n in range(len(numbers.tracker)):
        late = max(late, numbers.tracker[n, 1])
    rows = late + 1
    seen = memory[_SEEN : _SEEN + rows * tips.size].reshape((rows, tips.size))
    attitude, bias = memory[:_BIAS], memory[_BIAS:_COVARIANCE]
    if k == 0:
        _begin(numbers, reference, memory)
    for i in range(tips.size):
        seen[k % rows, i] = tips[i]
    if k > late:
        white, walk = numbers.gyro_noise[0], numbers.gyro_noise[1]
        p = memory[_COVARIANCE:_FOUND].reshape((6, 6))
        carry(attitude, bias, p, seen[(k - late) % rows, gyro : gyro + 3], white, walk, dt)
    if k >= late:
        _take(k - late, numbers, numbers, seen, memory[:_FOUND], memory[_FOUND:_SEEN])
    q = (attitude[0], attitude[1], attitude[2], attitude[3])
    for tick in range(max(k - late, 0) + 1, k + 1):
        at = seen[tick % rows]
        x, y, z = at[gyro] - bias[0], at[gyro + 1] - bias[1], at[gyro + 2] - bias[2]
        q = rotate(q, x * dt, y * dt, z * dt)
    found = np.empty(7)
    found[0], found[1], found[2], found[3] = q
    for i in range(3):
        found[4 + i] = tips[gyro + i] - bias[i]
    write_joints(numbers, found, measured, reference, believed)


@called
def write_joints(
    numbers: AttitudeNumbers, found: Vector, measured: Vector, reference: Vector, believed: Vector
) -> None:
    """Write what joints read of an attitude and a body rate, `found`, (7,); see attitude_tick."""
    axes, m = numbers.axes, reference.size
    rotation, rate = rotation_vector_of((found[0], found[1], found[2], found[3])), found[4:]
    for i in range(m):
        believed[i], believed[m + i] = measured[i], measured[m + i]
        a, b, c = axes[i, 0], axes[i, 1], axes[i, 2]
        if a != 0.0 or b != 0.0 or c != 0.0:
            believed[i] = a * rotation[0] + b * rotation[1] + c * rotation[2]
            believed[m + i] = a * rate[0] + b * rate[1] + c * rate[2]
    apply_attitude_error(axes, numbers.inverse, reference, believed[:m])


@called
def _begin(numbers: AttitudeNumbers, reference: Vector, memory: Vector) -> None:
    """Write the first belief: where the reference is, without a bias."""
    memory[:] = 0.0
    x, y, z = joint_rotation_vector(numbers.inverse, reference)
    memory[0], memory[1], memory[2], memory[3] = quaternion_of(x, y, z)
    for i in range(6):
        memory[_COVARIANCE + 7 * i] = numbers.sigmas[i // 3] ** 2


def reader(
    initialize_attitude: Callable[..., None],
    update_attitude: Callable[..., None],
    update_direction: Callable[..., None],
) -> Callable[..., None]:
    """Return a function that corrects a belief by the measurements at its time.

    It takes (time, AttitudeNumbers, own, seen, belief, known): a tick, the filter's other data,
    tips of tick k in row k % rows of `seen`, and the belief, attitude and bias first. known, (1,),
    is zero until there was an attitude.

    Args:
        initialize_attitude: takes (own, belief, attitude, noise) of the first attitude.
        update_attitude: takes the same and the innovation, (3,).
        update_direction: takes (own, belief, measured, inertial, sigma, innovation), (2,).
    """

    @called
    def take(
        time: int,
        numbers: AttitudeNumbers,
        data: Any,
        seen: Matrix,
        estimate: Vector,
        known: Vector,
    ) -> None:
        bias, rows, gyro = estimate[_BIAS:_COVARIANCE], len(seen), numbers.gyro[0]
        innovation, read, noise = np.empty(3), np.empty(4), np.empty((3, 3))
        for n in range(len(numbers.tracker)):
            first, delay = numbers.tracker[n]
            at = seen[(time + delay) % rows, first : first + 4]
            size = sqrt(at[0] ** 2 + at[1] ** 2 + at[2] ** 2 + at[3] ** 2)
            if not size > PRESENT:
                continue
            here, square = seen[time % rows], 0.0
            for i in range(3):
                square += (here[gyro + i] - bias[i]) ** 2
                noise[i] = numbers.tracker_noise[n, i]
            for i in range(3):
                noise[i, i] += numbers.rate_noise[n] * square
            for i in range(4):
                read[i] = at[i] / size
            if known[0]:
                update_attitude(data, estimate, read, noise, innovation)
            else:
                known[0] = 1.0
                initialize_attitude(data, estimate, read, noise)
        for n in range(len(numbers.sun)):
            at = seen[time % rows, numbers.sun[n] : numbers.sun[n] + 3]
            if known[0] and sqrt(at[0] ** 2 + at[1] ** 2 + at[2] ** 2) > PRESENT:
                direction, sigma = numbers.sun_direction[n], numbers.sun_sigma[n]
                update_direction(data, estimate, at, direction, sigma, innovation[:2])

    return cast(Callable[..., None], take)


@called
def _initialize_attitude(
    data: AttitudeNumbers, estimate: Vector, read: Vector, noise: Matrix
) -> None:
    p = estimate[_COVARIANCE:].reshape((6, 6))
    estimate[:_BIAS] = read
    p[:3, 3:] = 0.0
    p[3:, :3] = 0.0
    p[:3, :3] = noise


@called
def _update_attitude(
    data: AttitudeNumbers, estimate: Vector, read: Vector, noise: Matrix, innovation: Vector
) -> None:
    p = estimate[_COVARIANCE:].reshape((6, 6))
    take_attitude(estimate[:_BIAS], estimate[_BIAS:_COVARIANCE], p, read, noise, innovation)


@called
def _update_direction(
    data: AttitudeNumbers,
    estimate: Vector,
    read: Vector,
    inertial: Vector,
    sigma: float,
    innovation: Vector,
) -> None:
    p, bias = estimate[_COVARIANCE:].reshape((6, 6)), estimate[_BIAS:_COVARIANCE]
    take_direction(estimate[:_BIAS], bias, p, read, inertial, sigma, innovation)


_take = reader(_initialize_attitude, _update_attitude, _update_direction)
