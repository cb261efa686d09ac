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
    rate_of,
    told_attitude,
    told_direction,
    told_first,
)
from flexslew_plant.arrays import Matrix, Vector, called, compiled
from flexslew_plant.testbeds.attitude import joint_turn
from flexslew_plant.testbeds.compiled.lanes import LANES, LaneKernel
from flexslew_plant.testbeds.model import Model
from flexslew_plant.testbeds.quaternions import of_turn

_TURNING = 0.1  # rates of the joints for which equations are balanced [rad/s]

_take = reader(told_first, told_attitude, told_direction)


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
    belief = it.begin(
        np.array([0.0, 0.0, 0.0, 1.0]),
        np.zeros(3),
        (settings.initial_attitude, settings.initial_bias),
    )
    moved = np.zeros((modes + model.coordinates, 2 * n + 3))
    moved[:modes, m:n], moved[modes:, n : 2 * n] = it.found.elastic(modes), basis
    generators, scale = _generators(it)
    white, walk = it.noise
    return FlexibleNumbers(
        model.packed,
        model.rest({}),
        np.array(it.joints.axes, dtype=np.float64),
        np.array(it.joints.turn_of(np.eye(m)).T, order="C"),
        basis[:, :m] @ it.joints.axes,
        it.joints.turn_of(it.found.readings.T).T.copy(),
        moved[:, order],
        belief.covariance[np.ix_(order, order)],
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
    turning = np.tensordot([1.0, *[_TURNING] * 3, *[_TURNING**2] * 6], np.abs(found), axes=1)
    _, (scale, _) = matrix_balance(turning[:, :k], permute=False, separate=True)
    columns = np.abs(found[0, :, k:] / scale[:, None]).sum(axis=0)
    both = np.concatenate((scale, 0.25 * 0.5 ** np.frexp(columns)[1]))
    return (found * both / scale[:, None]).reshape(10, -1), both


def flexible_memory(sensors: AttitudeNumbers, own: FlexibleNumbers, tips: int) -> int:
    """Return how many numbers the tick keeps in its memory of each craft.

    Args:
        sensors: of the filter.
        own: of the filter.
        tips: channels of all tips.
    """
    rows, efforts = 1 + int(sensors.tracker[:, 1].max()), _efforts(own.scale, own.first)
    return 2 * _size(own.moved, own.first) + 1 + rows * (tips + efforts)


@called
def _size(moved: Matrix, first: Matrix) -> int:
    """Return the size of a belief."""
    return MODES + len(moved) + len(first) ** 2


@called
def _efforts(scale: Vector, first: Matrix) -> int:
    """Return the number of efforts."""
    return scale.size - len(first) + 3


@called
def flexible_of(all_crafts: FlexibleNumbers, k: int) -> FlexibleNumbers:
    """Return the filter data of one craft, from arrays with a row for each."""
    return FlexibleNumbers(
        all_crafts.packed[k],
        all_crafts.rest[k],
        all_crafts.axes[k],
        all_crafts.inverse[k],
        all_crafts.start[k],
        all_crafts.rate[k],
        all_crafts.moved[k],
        all_crafts.first[k],
        all_crafts.generators[k],
        all_crafts.scale[k],
        all_crafts.deviations[k],
    )


@called
def _place(
    own: FlexibleNumbers, belief: Vector, held: Vector, effort: int, mode: int, here: Vector
) -> None:
    """Write a craft as it is believed, and its efforts; here: every LANES-th number is its own."""
    v, modes, rest = len(own.start), len(own.moved) - len(own.start), own.rest
    for i in range(rest.size):
        here[i * LANES] = rest[i]
    for i in range(modes):
        here[mode + i * LANES] = belief[MODES + i]
    for i in range(v):
        here[(rest.size + i) * LANES] = belief[MODES + modes + i]
    for i in range(held.size):
        here[effort + i * LANES] = held[i]


@called
def _moved(own: FlexibleNumbers, mode: int, here: Vector) -> Vector:
    """Return modes and v of a craft where the equations have led, see _place."""
    v, modes = len(own.start), len(own.moved) - len(own.start)
    moved, positions = np.empty(modes + v), own.rest.size
    for i in range(modes):
        moved[i] = here[mode + i * LANES]
    for i in range(v):
        moved[modes + i] = here[(positions + i) * LANES]
    return moved


@called
def _take_all(
    then: int,
    sensors: AttitudeNumbers,
    crafts: FlexibleNumbers,
    columns: int,
    memory: Matrix,
    filled: int,
) -> None:
    """Correct the beliefs by what was measured at their time."""
    size = _size(crafts.moved[0], crafts.first[0])
    for lane in range(filled):
        own = flexible_of(crafts, min(lane, len(crafts.scale) - 1))
        one = numbers_of(sensors, min(lane, len(sensors.period) - 1))
        seen = memory[lane, 2 * size + 1 :].reshape((-1, columns))
        known = memory[lane, 2 * size : 2 * size + 1]
        _take(then, one, own, seen, memory[lane, :size], known)


@lru_cache
def flexible_tick(kernel: LaneKernel, steps: int) -> Callable[..., None]:
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
        crafts: FlexibleNumbers,
        columns: int,
        memory: Matrix,
        place: Vector,
        filled: int,
    ) -> None:
        """Carry the beliefs that begin at `first` in the memory through the tick up to `then`."""
        size, dt = _size(crafts.moved[0], crafts.first[0]), sensors.period[0, 0]
        middle = np.empty(3)
        efforts = _efforts(crafts.scale[0], crafts.first[0])
        for lane in range(filled):
            own = flexible_of(crafts, min(lane, len(crafts.scale) - 1))
            seen = memory[lane, 2 * size + 1 :].reshape((-1, columns))
            held = seen[then % len(seen), columns - efforts :]
            _place(own, memory[lane, first : first + size], held, effort, mode, place[lane:])
        read(filled, place)
        before = place[rates : rates + 3 * LANES].copy()
        advance(0.0, dt, steps, filled, place)
        read(filled, place)
        for lane in range(filled):
            own = flexible_of(crafts, min(lane, len(crafts.scale) - 1))
            gyro = sensors.gyro[min(lane, len(sensors.period) - 1), 0]
            seen = memory[lane, 2 * size + 1 :].reshape((-1, columns))
            for i in range(3):
                at = i * LANES + lane
                middle[i] = 0.5 * (before[at] + place[rates + at])
            x, y, z = joint_turn(own.inverse, place[position + lane :: LANES][:3])
            carry(
                own, memory[lane, first : first + size], _moved(own, mode, place[lane:]),
                of_turn(x, y, z), middle, seen[then % len(seen), gyro : gyro + 3], dt,
            )  # fmt: skip

    @compiled
    def tick(
        k: int,
        sensors: AttitudeNumbers,
        crafts: FlexibleNumbers,
        told: Matrix,
        reference: Vector,
        memory: Matrix,
        place: Vector,
        found: Matrix,
        filled: int,
    ) -> None:
        size, columns = _size(crafts.moved[0], crafts.first[0]), told.shape[1]
        late = (memory.shape[1] - 2 * size - 1) // columns - 1
        for lane in range(filled):
            seen = memory[lane, 2 * size + 1 :].reshape((-1, columns))
            seen[k % (late + 1)] = told[lane]
            if k == 0:
                own = flexible_of(crafts, min(lane, len(crafts.scale) - 1))
                one = numbers_of(sensors, min(lane, len(sensors.period) - 1))
                x, y, z = joint_turn(one.inverse, reference)
                reading = seen[0, one.gyro[0] : one.gyro[0] + 3]
                begin(own, of_turn(x, y, z), reading, memory[lane, :size])
                memory[lane, 2 * size] = 0.0
        for then in range(max(k - late, 0), k + 1):
            of_belief = then == k - late
            if then > 0:
                first = 0 if of_belief else size
                carry_all(then, first, sensors, crafts, columns, memory, place, filled)
            if of_belief:
                _take_all(then, sensors, crafts, columns, memory, filled)
            if then == max(k - late, 0):
                for lane in range(filled):
                    memory[lane, size : 2 * size] = memory[lane, :size]
        for lane in range(filled):
            own = flexible_of(crafts, min(lane, len(crafts.scale) - 1))
            found[lane, :BIAS] = memory[lane, size : size + BIAS]
            found[lane, BIAS:] = rate_of(own, memory[lane, size : 2 * size])

    return cast(Callable[..., None], tick)
