"""The tick of the filter with modes for other machine code, for many crafts at once.

In compiled form AttitudeEstimator for one run with a FlexibleFilter, by the same steps. The
equations of motion of all crafts are advanced together, all else one after another.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple, TypeAlias, cast

import numpy as np

from flexslew_control.estimators.attitude_estimator import AttitudeEstimator
from flexslew_control.estimators.attitude_steps import BIAS, MODES, AttitudeEstimate
from flexslew_control.estimators.attitude_tick import AttitudeNumbers, numbers_of, take_readings
from flexslew_control.estimators.flexible_attitude_filter import FlexibleFilter
from flexslew_control.estimators.flexible_attitude_steps import (
    FlexibleNumbers,
    begin,
    carry,
    errors_of,
)
from flexslew_plant.arrays import Matrix, Vector, called, compiled
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH, BatchKernel
from flexslew_plant.testbeds.model import Model
from flexslew_plant.testbeds.orientation.attitude import joint_rotation_vector
from flexslew_plant.testbeds.orientation.quaternions import quaternion_of


class FlexibleFilters(NamedTuple):
    """The filters of many crafts: their data and memory."""

    sensors: AttitudeNumbers  # of trackers with equal delays; one row for all, or one for each
    filters: FlexibleNumbers  # likewise
    memory: Matrix  # (crafts, flexible_memory); anything at tick 0
    place: Vector  # where a BatchKernel advances the equations


# (k, filters, measured, reference, found, filled), see flexible_tick
FlexibleTick: TypeAlias = Callable[[int, FlexibleFilters, Matrix, Vector, Matrix, int], None]


class FlexibleForm(NamedTuple):
    """The data of an estimator with a FlexibleFilter besides AttitudeNumbers."""

    model: Model
    steps: int  # of its equations in a tick
    numbers: FlexibleNumbers


def flexible_form(estimator: AttitudeEstimator) -> FlexibleForm | None:
    """Return the data of an estimator with modes; None: attitude and bias alone."""
    it, s = estimator.filter, estimator.settings
    if not isinstance(it, FlexibleFilter):
        return None
    first = it.first_covariance((s.initial_attitude, s.initial_bias))
    return FlexibleForm(it.model, it.steps, it.numbers._replace(first=first))


def flexible_memory(sensors: AttitudeNumbers, data: FlexibleNumbers, tips: int) -> int:
    """Return how many numbers the tick keeps in its memory of each craft.

    Args:
        sensors: of the filter.
        data: of the filter.
        tips: channels of all tips.
    """
    rows, estimate = 1 + int(sensors.tracker[:, 1].max()), len(data.first) ** 2 + len(data.motion)
    return 2 * (MODES + estimate) + 1 + rows * (tips + _efforts(data))


@called
def _efforts(data: FlexibleNumbers) -> int:
    """Return the number of efforts."""
    return data.scale.size - len(data.first) + 3


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
        batch.motion[k],
        batch.first[k],
        batch.generators[k],
        batch.scale[k],
        batch.sigmas[k],
    )


class _Craft(NamedTuple):
    """A craft's filter: its constants and memory."""

    sensors: AttitudeNumbers
    data: FlexibleNumbers
    estimate: AttitudeEstimate  # at the time of the latest readings
    now: AttitudeEstimate
    known: Vector  # see take_readings
    seen: Matrix  # tips, then efforts of tick k, in row k modulo their number


@called
def _craft(batch: FlexibleFilters, columns: int, k: int) -> _Craft:
    """Return the filter of one craft."""
    one = numbers_of(batch.sensors, min(k, len(batch.sensors.period) - 1))
    data = flexible_of(batch.filters, min(k, len(batch.filters.scale) - 1))
    own = batch.memory[k]
    states, errors = MODES + len(data.motion), len(data.first)
    size = states + errors**2
    estimate = AttitudeEstimate(own[:states], own[states:size].reshape((errors, errors)))
    now = own[size : 2 * size]
    present = AttitudeEstimate(now[:states], now[states:].reshape((errors, errors)))
    known, seen = own[2 * size : 2 * size + 1], own[2 * size + 1 :].reshape((-1, columns))
    return _Craft(one, data, estimate, present, known, seen)


@called
def _place(
    data: FlexibleNumbers, state: Vector, applied: Vector, effort: int, mode: int, here: Vector
) -> None:
    """Write the estimated spacecraft and its efforts to every BATCH_WIDTH-th number of `here`."""
    v, modes, rest = len(data.start), len(data.motion) - len(data.start), data.rest
    for i in range(rest.size):
        here[i * BATCH_WIDTH] = rest[i]
    for i in range(modes):
        here[mode + i * BATCH_WIDTH] = state[MODES + i]
    for i in range(v):
        here[(rest.size + i) * BATCH_WIDTH] = state[MODES + modes + i]
    for i in range(applied.size):
        here[effort + i * BATCH_WIDTH] = applied[i]


@called
def _motion(data: FlexibleNumbers, mode: int, here: Vector) -> Vector:
    """Return modes and v of a craft where the equations have led, see _place."""
    v, modes = len(data.start), len(data.motion) - len(data.start)
    motion, positions = np.empty(modes + v), data.rest.size
    for i in range(modes):
        motion[i] = here[mode + i * BATCH_WIDTH]
    for i in range(v):
        motion[modes + i] = here[(positions + i) * BATCH_WIDTH]
    return motion


@lru_cache
def flexible_tick(kernel: BatchKernel, steps: int) -> FlexibleTick:
    """Return the tick of the filters of crafts with the same equations.

    It takes (k, filters, measured, reference, found, filled) and writes what is estimated at tick
    k, from 0 on, one after another. measured: readings of all tips at this tick, then the efforts
    before it, (filled, tips + efforts). reference: of the joints, (joints,). found: attitudes, then
    body rates, (filled, 7).

    Args:
        kernel: the equations of all the filters.
        steps: integration steps in a tick.
    """
    advance, read = kernel.advance, kernel.read
    effort, position, rates, mode, *_ = kernel.rows

    @called
    def carry_all(
        then: int,
        to_present: bool,
        batch: FlexibleFilters,
        columns: int,
        filled: int,
    ) -> None:
        """Carry the estimates through the tick up to `then`, or those that go on to the present."""
        middle, unused, place = np.empty(3), np.empty(3), batch.place
        for member in range(filled):
            it = _craft(batch, columns, member)
            state = (it.now if to_present else it.estimate).state
            applied = it.seen[then % len(it.seen), columns - _efforts(it.data) :]
            _place(it.data, state, applied, effort, mode, place[member:])
        read(filled, place)
        before, dt = place[rates : rates + 3 * BATCH_WIDTH].copy(), batch.sensors.period[0, 0]
        advance(0.0, dt, steps, filled, place)
        read(filled, place)
        for member in range(filled):
            it = _craft(batch, columns, member)
            gyro, motion = it.sensors.gyro[0], _motion(it.data, mode, place[member:])
            for i in range(3):
                at = i * BATCH_WIDTH + member
                middle[i] = 0.5 * (before[at] + place[rates + at])
            x, y, z = joint_rotation_vector(
                it.data.inverse, place[position + member :: BATCH_WIDTH][:3]
            )
            carry(
                it.data, it.now if to_present else it.estimate, motion, quaternion_of(x, y, z),
                middle, it.seen[then % len(it.seen), gyro : gyro + 3], dt, unused,
            )  # fmt: skip

    @compiled
    def tick(
        k: int,
        batch: FlexibleFilters,
        measured: Matrix,
        reference: Vector,
        found: Matrix,
        filled: int,
    ) -> None:
        late, columns, sensors = 0, measured.shape[1], batch.sensors
        unused = np.empty(3 * sensors.tracker.shape[1] + 2 * sensors.sun.shape[1])
        for member in range(filled):
            it = _craft(batch, columns, member)
            late = len(it.seen) - 1
            it.seen[k % (late + 1)] = measured[member]
            if k == 0:
                gyro = it.sensors.gyro[0]
                x, y, z = joint_rotation_vector(it.sensors.inverse, reference)
                begin(it.data, quaternion_of(x, y, z), it.seen[0, gyro : gyro + 3], it.estimate)
                it.known[0] = 0.0
        for then in range(max(k - late, 0), k + 1):
            to_present = then > k - late
            if then > 0:
                carry_all(then, to_present, batch, columns, filled)
            for member in range(filled):
                it = _craft(batch, columns, member)
                if not to_present:
                    errors = errors_of(it.data)
                    take_readings(then, it.sensors, errors, it.seen, it.estimate, it.known, unused)
                if then == max(k - late, 0):
                    it.now.state[:] = it.estimate.state
                    it.now.covariance[:] = it.estimate.covariance
        for member in range(filled):
            it = _craft(batch, columns, member)
            state = it.now.state
            found[member, :BIAS] = state[:BIAS]
            found[member, BIAS:] = it.data.rate @ state[state.size - len(it.data.start) :]

    return cast(FlexibleTick, tick)
