"""The tick of the filter with modes for other machine code, for many crafts at once.

In compiled form the result of AttitudeEstimator for one run with a FlexibleFilter. The equations of
motion of all crafts are advanced together, all else one after another.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple, cast

import numpy as np
from scipy.linalg import matrix_balance

from flexslew_control.estimators.attitude_estimator import (
    AttitudeEstimator,
    AttitudeFilterSettings,
)
from flexslew_control.estimators.attitude_tick import AttitudeNumbers, numbers_of, reader
from flexslew_control.estimators.flexible_attitude_filter import FlexibleFilter
from flexslew_control.estimators.flexible_attitude_steps import (
    BIAS,
    MODES,
    FlexibleNumbers,
    begin,
    carry,
    initialize_attitude,
    rate_of,
    update_attitude,
    update_direction,
)
from flexslew_plant.arrays import Matrix, Vector, called, compiled
from flexslew_plant.testbeds.attitude import joint_rotation_vector
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH, BatchKernel
from flexslew_plant.testbeds.model import Model
from flexslew_plant.testbeds.quaternions import quaternion_of

_SLEW_RATE = 0.1  # rates of the joints for which equations are balanced [rad/s]

_take = reader(initialize_attitude, update_attitude, update_direction)


class FlexibleForm(NamedTuple):
    """What the filter of an estimator believes besides attitude and bias: a FlexibleFilter."""

    model: Model
    steps: int  # of its equations in a tick
    numbers: FlexibleNumbers


def flexible_form(estimator: AttitudeEstimator) -> FlexibleForm | None:
    """Return what the filter of an estimator believes; None: attitude and bias alone."""
    it = estimator.filter
    if not isinstance(it, FlexibleFilter):
        return None
    return FlexibleForm(it.model, it.steps, _numbers(it, estimator.settings))


def _numbers(it: FlexibleFilter, settings: AttitudeFilterSettings) -> FlexibleNumbers:
    model, small, basis = it.model, it.platform.small, it.found.basis
    n, m, modes = small.coordinates, small.joints, model.modes
    order = np.concatenate((np.arange(m), 2 * n + np.arange(3), np.arange(m, 2 * n)))
    estimate = it.begin(
        np.array([0.0, 0.0, 0.0, 1.0]),
        np.zeros(3),
        (settings.initial_attitude, settings.initial_bias),
    )
    motion = np.zeros((modes + model.coordinates, 2 * n + 3))
    motion[:modes, m:n], motion[modes:, n : 2 * n] = it.found.elastic(modes), basis
    generators, scale = _generators(it)
    white, walk = it.noise
    return FlexibleNumbers(
        model.packed,
        model.rest({}),
        np.array(it.joints.axes, dtype=np.float64),
        np.array(it.joints.rotation_vector_of(np.eye(m)).T, order="C"),
        basis[:, :m] @ it.joints.axes,
        it.joints.rotation_vector_of(it.found.outputs.T).T.copy(),
        motion[:, order],
        estimate.covariance[np.ix_(order, order)],
        generators,
        scale,
        np.array([
            it.settings.effort_noise / np.sqrt(it.period),
            np.sqrt(white**2 / it.period + walk**2 * it.period / 3.0),
            walk * np.sqrt(it.period),
        ]),
    )  # fmt: skip


def _generators(it: FlexibleFilter) -> tuple[Matrix, Vector]:
    """Return generators and scale of FlexibleNumbers; the scale is of powers of two."""
    p, (k, efforts) = it.platform, it.platform.input_matrix.shape
    found = np.zeros((10, k, k + efforts))
    found[:4, :, :k] = [p.small.linear.state_matrix, *p.linear]
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]
    found[4:, :, :k] = [(1.0 if i == j else 2.0) * p.quadratic[i, j] for i, j in pairs]
    found[0, :, k:] = p.input_matrix
    found *= it.period
    typical = np.tensordot([1.0, *[_SLEW_RATE] * 3, *[_SLEW_RATE**2] * 6], np.abs(found), axes=1)
    _, (scale, _) = matrix_balance(typical[:, :k], permute=False, separate=True)
    columns = np.abs(found[0, :, k:] / scale[:, None]).sum(axis=0)
    factors = np.concatenate((scale, 0.25 * 0.5 ** np.frexp(columns)[1]))
    return (found * factors / scale[:, None]).reshape(10, -1), factors


def flexible_memory(sensors: AttitudeNumbers, data: FlexibleNumbers, tips: int) -> int:
    """Return how many numbers the tick keeps in its memory of each craft.

    Args:
        sensors: of the filter.
        data: of the filter.
        tips: channels of all tips.
    """
    rows, efforts = 1 + int(sensors.tracker[:, 1].max()), _efforts(data.scale, data.first)
    return 2 * _size(data.moved, data.first) + 1 + rows * (tips + efforts)


@called
def _size(motion: Matrix, first: Matrix) -> int:
    """Return the size of a belief."""
    return MODES + len(motion) + len(first) ** 2


@called
def _efforts(scale: Vector, first: Matrix) -> int:
    """Return the number of efforts."""
    return scale.size - len(first) + 3


@called
def flexible_of(batch: FlexibleNumbers, k: int) -> FlexibleNumbers:
    """Return the filter data of one craft, from arrays with a row for each."""
    return FlexibleNumbers(
        batch.packed[k],
        batch.rest[k],
        batch.axes[k],
        batch.inverse[k],
        batch.start[k],
        batch.rate[k],
        batch.moved[k],
        batch.first[k],
        batch.generators[k],
        batch.scale[k],
        batch.sigmas[k],
    )


@called
def _place(
    data: FlexibleNumbers,
    estimate: Vector,
    applied_effort: Vector,
    effort: int,
    mode: int,
    here: Vector,
) -> None:
    """Write the estimated spacecraft and its efforts to every BATCH_WIDTH-th number of `here`."""
    v, modes, rest = len(data.start), len(data.moved) - len(data.start), data.rest
    for i in range(rest.size):
        here[i * BATCH_WIDTH] = rest[i]
    for i in range(modes):
        here[mode + i * BATCH_WIDTH] = estimate[MODES + i]
    for i in range(v):
        here[(rest.size + i) * BATCH_WIDTH] = estimate[MODES + modes + i]
    for i in range(applied_effort.size):
        here[effort + i * BATCH_WIDTH] = applied_effort[i]


@called
def _motion(data: FlexibleNumbers, mode: int, here: Vector) -> Vector:
    """Return modes and v of a craft where the equations have led, see _place."""
    v, modes = len(data.start), len(data.moved) - len(data.start)
    motion, positions = np.empty(modes + v), data.rest.size
    for i in range(modes):
        motion[i] = here[mode + i * BATCH_WIDTH]
    for i in range(v):
        motion[modes + i] = here[(positions + i) * BATCH_WIDTH]
    return motion


@called
def _take_all(
    then: int,
    sensors: AttitudeNumbers,
    filters: FlexibleNumbers,
    columns: int,
    memory: Matrix,
    filled: int,
) -> None:
    """Correct the beliefs by what was measured at their time."""
    size = _size(filters.moved[0], filters.first[0])
    for member in range(filled):
        data = flexible_of(filters, min(member, len(filters.scale) - 1))
        one = numbers_of(sensors, min(member, len(sensors.period) - 1))
        seen = memory[member, 2 * size + 1 :].reshape((-1, columns))
        known = memory[member, 2 * size : 2 * size + 1]
        _take(then, one, data, seen, memory[member, :size], known)


@lru_cache
def flexible_tick(kernel: BatchKernel, steps: int) -> Callable[..., None]:
    """Return the tick of the filters of crafts with the same equations.

    It takes (k, sensors, crafts, told, reference, memory, place, found, filled) and writes the
    beliefs at tick k, from 0 on, one after another. `sensors` are AttitudeNumbers of trackers with
    equal delays, `crafts` FlexibleNumbers, row by row: one for all, or one for each. `told`:
    readings of all tips at this tick, then the efforts before it, (filled, tips + efforts).
    reference: of the joints, (joints,). memory: in and out, (filled, flexible_memory), anything at
    tick 0. place: an array of the kernel. found: attitudes, then body rates, (filled, 7).

    Args:
        kernel: the equations of all the filters.
        steps: integration steps in a tick.
    """
    advance, read = kernel.advance, kernel.read
    effort, position, rates, mode, *_ = kernel.rows

    @called
    def carry_all(
        then: int,
        first: int,
        sensors: AttitudeNumbers,
        filters: FlexibleNumbers,
        columns: int,
        memory: Matrix,
        place: Vector,
        filled: int,
    ) -> None:
        """Carry the beliefs that begin at `first` in the memory through the tick up to `then`."""
        size, dt = _size(filters.moved[0], filters.first[0]), sensors.period[0, 0]
        middle = np.empty(3)
        efforts = _efforts(filters.scale[0], filters.first[0])
        for member in range(filled):
            data = flexible_of(filters, min(member, len(filters.scale) - 1))
            seen = memory[member, 2 * size + 1 :].reshape((-1, columns))
            applied_effort = seen[then % len(seen), columns - efforts :]
            _place(
                data,
                memory[member, first : first + size],
                applied_effort,
                effort,
                mode,
                place[member:],
            )
        read(filled, place)
        before = place[rates : rates + 3 * BATCH_WIDTH].copy()
        advance(0.0, dt, steps, filled, place)
        read(filled, place)
        for member in range(filled):
            data = flexible_of(filters, min(member, len(filters.scale) - 1))
            gyro = sensors.gyro[min(member, len(sensors.period) - 1), 0]
            seen = memory[member, 2 * size + 1 :].reshape((-1, columns))
            for i in range(3):
                at = i * BATCH_WIDTH + member
                middle[i] = 0.5 * (before[at] + place[rates + at])
            x, y, z = joint_rotation_vector(
                data.inverse, place[position + member :: BATCH_WIDTH][:3]
            )
            carry(
                data, memory[member, first : first + size], _motion(data, mode, place[member:]),
                quaternion_of(x, y, z), middle, seen[then % len(seen), gyro : gyro + 3], dt,
            )  # fmt: skip

    @compiled
    def tick(
        k: int,
        sensors: AttitudeNumbers,
        filters: FlexibleNumbers,
        measured: Matrix,
        reference: Vector,
        memory: Matrix,
        place: Vector,
        found: Matrix,
        filled: int,
    ) -> None:
        size, columns = _size(filters.moved[0], filters.first[0]), measured.shape[1]
        late = (memory.shape[1] - 2 * size - 1) // columns - 1
        for member in range(filled):
            seen = memory[member, 2 * size + 1 :].reshape((-1, columns))
            seen[k % (late + 1)] = measured[member]
            if k == 0:
                data = flexible_of(filters, min(member, len(filters.scale) - 1))
                one = numbers_of(sensors, min(member, len(sensors.period) - 1))
                x, y, z = joint_rotation_vector(one.inverse, reference)
                reading = seen[0, one.gyro[0] : one.gyro[0] + 3]
                begin(data, quaternion_of(x, y, z), reading, memory[member, :size])
                memory[member, 2 * size] = 0.0
        for then in range(max(k - late, 0), k + 1):
            at_estimate = then == k - late
            if then > 0:
                first = 0 if at_estimate else size
                carry_all(then, first, sensors, filters, columns, memory, place, filled)
            if at_estimate:
                _take_all(then, sensors, filters, columns, memory, filled)
            if then == max(k - late, 0):
                for member in range(filled):
                    memory[member, size : 2 * size] = memory[member, :size]
        for member in range(filled):
            data = flexible_of(filters, min(member, len(filters.scale) - 1))
            found[member, :BIAS] = memory[member, size : size + BIAS]
            found[member, BIAS:] = rate_of(data, memory[member, size : 2 * size])

    return cast(Callable[..., None], tick)
