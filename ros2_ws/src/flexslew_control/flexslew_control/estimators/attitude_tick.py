"""The readings of an attitude filter's instruments, and its tick for other machine code.

`take_readings` is the step of every filter; `attitude_tick` is AttitudeEstimator with a
RigidFilter.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np

from flexslew_control.estimators.attitude_steps import (
    BIAS,
    MODES,
    AttitudeEstimate,
    ErrorMap,
    carry,
    initialize_attitude,
    rigid_errors,
    rotate,
    update_attitude,
    update_direction,
)
from flexslew_plant.arrays import Indices, Matrix, Tensor, Vector, called, compiled_once
from flexslew_plant.testbeds.orientation.attitude import apply_attitude_error, joint_rotation_vector
from flexslew_plant.testbeds.orientation.quaternions import quaternion_of, rotation_vector_of

LEAST = 1e-9  # sigma of a sensor that states none [rad]
_PRESENT = 0.5  # size of a reading from which on it is one: zeros mean that there is none
_COVARIANCE, _KNOWN, _SEEN = MODES, MODES + 36, MODES + 37  # where they begin in the memory


class AttitudeNumbers(NamedTuple):
    """The constants of a filter. Those of many, row by row in one array each, see `numbers_of`."""

    axes: Matrix  # of the joints, see AttitudeJoints, (joints, 3)
    inverse: Matrix  # from the joints to the rotation vector, (3, joints)
    gyro: Indices  # its first channel, (1,)
    tracker: Indices  # first channels, and by how many ticks they are late, (trackers, 2)
    tracker_noise: Tensor  # covariances at rest, (trackers, 3, 3) [rad^2]
    rate_noise: Vector  # further noise of all axes, per body rate, (trackers,) [s]
    sun: Indices  # first channels, (suns,)
    sun_direction: Matrix  # in inertial space, (suns, 3)
    sun_noise: Vector  # (suns,) [rad]
    noise_factor: Vector  # on the noises of trackers and Sun sensors, (1,)
    gyro_noise: Vector  # GyroNoise, (2,)
    sigmas: Vector  # of attitude [rad] and bias [rad/s] at the start, (2,)
    period: Vector  # one tick, (1,) [s]


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
        batch.sun_noise[member],
        batch.noise_factor[member],
        batch.gyro_noise[member],
        batch.sigmas[member],
        batch.period[member],
    )


@compiled_once("known", "innovation")
def take_readings(
    time: int,
    numbers: AttitudeNumbers,
    errors: ErrorMap,
    seen: Matrix,
    estimate: AttitudeEstimate,
    known: Vector,
    innovation: Vector,
) -> float:
    """Correct an estimate by the measurements of its time, and return their squares (nis).

    Without a reading nothing is corrected; the first attitude replaces that of the estimate, and
    Sun sensors count from then on.

    Args:
        time: tick of the estimate.
        numbers: of the filter.
        errors: of the filter.
        seen: tips of tick k in row k modulo their number, up to the latest reading of `time`.
        estimate: updated in place.
        known: zero until there was an attitude; updated in place, shape (1,).
        innovation: out, (3 trackers + 2 suns,) [rad]; kept where there is no reading.
    """
    bias, rows, gyro, nis = estimate.state[BIAS:MODES], len(seen), numbers.gyro[0], 0.0
    read, factor = np.empty(4), numbers.noise_factor[0]
    count, here = len(numbers.tracker), seen[time % rows]
    for n in range(count):
        first, delay = numbers.tracker[n]
        at = seen[(time + delay) % rows, first : first + 4]
        size = _norm(at)
        if not size > _PRESENT:
            continue
        more = (numbers.rate_noise[n] * _norm(here[gyro : gyro + 3] - bias)) ** 2
        noise = factor**2 * (numbers.tracker_noise[n] + more * np.eye(3)) + LEAST**2 * np.eye(3)
        for i in range(4):
            read[i] = at[i] / size
        if known[0]:
            one = innovation[3 * n : 3 * n + 3]
            nis += update_attitude(errors, estimate, read, noise, one)
        else:
            known[0] = 1.0
            initialize_attitude(errors, estimate, read, noise)
    for n in range(len(numbers.sun)):
        at = here[numbers.sun[n] : numbers.sun[n] + 3]
        if known[0] and _norm(at) > _PRESENT:
            direction, sigma = numbers.sun_direction[n], factor * numbers.sun_noise[n] + LEAST
            one = innovation[3 * count + 2 * n : 3 * count + 2 * n + 2]
            nis += update_direction(errors, estimate, at, direction, sigma, one)
    return nis


@called
def _norm(vector: Vector) -> float:
    """Return its length, to the bit as np.linalg.norm."""
    return sqrt(np.dot(vector, vector))


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
    """Write positions and velocities of the joints as they are estimated at tick k.

    Args:
        k: tick, from 0 on, one after another.
        numbers: of the filter.
        tips: readings of all tips at this tick.
        measured: positions, then velocities of the joints, shape (2 joints,); kept where they do
            not read the attitude.
        reference: reference positions of the joints.
        memory: in and out, see attitude_memory; anything at tick 0.
        believed: positions about the reference, then velocities, shape (2 joints,).
    """
    gyro, dt, late = numbers.gyro[0], numbers.period[0], 0
    for n in range(len(numbers.tracker)):
        late = max(late, numbers.tracker[n, 1])
    rows = late + 1
    seen = memory[_SEEN : _SEEN + rows * tips.size].reshape((rows, tips.size))
    state, bias = memory[:_COVARIANCE], memory[BIAS:_COVARIANCE]
    estimate = AttitudeEstimate(state, memory[_COVARIANCE:_KNOWN].reshape((6, 6)))
    if k == 0:
        memory[:] = 0.0
        x, y, z = joint_rotation_vector(numbers.inverse, reference)
        state[0], state[1], state[2], state[3] = quaternion_of(x, y, z)
        for i in range(6):
            estimate.covariance[i, i] = numbers.sigmas[i // 3] ** 2
    for i in range(tips.size):
        seen[k % rows, i] = tips[i]
    if k > late:
        carry(estimate, seen[(k - late) % rows, gyro : gyro + 3], numbers.gyro_noise, dt)
    if k >= late:
        count = 3 * len(numbers.tracker) + 2 * len(numbers.sun)
        known, unused = memory[_KNOWN:_SEEN], np.empty(count)
        take_readings(k - late, numbers, rigid_errors(), seen, estimate, known, unused)
    q = (state[0], state[1], state[2], state[3])
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
