"""Instruments and filters of the attitude of all members, one after another as on the bench."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np

from flexslew_control.estimators.attitude_tick import (
    attitude_memory,
    attitude_tick,
    numbers_of,
    write_joints,
)
from flexslew_control.estimators.flexible_attitude_tick import (
    FlexibleFilters,
    flexible_memory,
    flexible_tick,
)
from flexslew_lab.studies.batch.benches.batch_faults import BatchFaults, reading_step
from flexslew_lab.studies.batch.groups.batch_laws import BatchLaws, spacecraft_kernel
from flexslew_lab.studies.batch.groups.batch_trial import BatchTrial
from flexslew_lab.studies.batch.groups.rows import Rows, Sizes
from flexslew_plant.arrays import Indices, Matrix, Tensor, Vector, compiled, put
from flexslew_plant.testbeds.compiled.batch_kernel import (
    BATCH_WIDTH,
    BatchKernel,
    flat_zeros,
    member_rows,
    skip,
)
from flexslew_plant.testbeds.instruments.packed_readers import PackedReaders, read_instruments

# (k, SensorData, measured, joints, reference, filled): replaces the joint readings, (members, 2
# joints), by their estimates; measured: readings of all tips, then the efforts before, (members,
# tips + joints)
Filter: TypeAlias = Callable[..., None]


class SensorData(NamedTuple):
    """What instruments and filters know, member by member; see PackedReaders and attitude_tick."""

    layout: Indices  # the same in all members
    constants: Matrix
    memory: Matrix
    body: Indices  # entries of the state that a BodyState is of, one after another
    filters: Any  # AttitudeNumbers, a row for all members or for each; None: there are none
    spacecraft_models: (
        Any  # FlexibleNumbers likewise; None: attitude and bias are all that they believe
    )
    place: Vector  # where their equations are advanced, see flexible_tick
    beliefs: Matrix  # memory of the filters


class SensorBatch(NamedTuple):
    """The instruments of a group, and their readings."""

    readers: list[PackedReaders]  # of the first members
    sensor_data: SensorData

    def draw(self, ticks: int) -> Tensor:
        """Return the random numbers of the next ticks, (ticks, members, draws)."""
        return np.stack([readers.draw(ticks) for readers in self.readers], axis=1)


def sensors_of(members: Sequence[BatchTrial], laws: BatchLaws, tips: int) -> SensorBatch | None:
    """Return the instruments of a group; None: there are none, or no law reads them.

    Args:
        members: the group.
        laws: the first that are in charge.
        tips: how many of the tips they read.
    """
    model, filters = members[0].model, laws.filters
    if model.appendages.body is None or not (filters or tips):
        return None
    readers = [
        member.model.appendages.packed(member.trial.period, [member.trial.seed, 0])
        for member in members
    ]
    body = model.appendages.body(np.arange(float(model.positions + model.coordinates)))
    count, spacecraft_models, place = len(model.appendages.names), None, flat_zeros(0)
    size = max((attitude_memory(numbers, count) for numbers in filters), default=0)
    if laws.spacecraft_models:
        spacecraft_models = _side_by_side([form.numbers for form in laws.spacecraft_models])
        size = flexible_memory(filters[0], laws.spacecraft_models[0].numbers, count)
        place = _packed_array(
            spacecraft_kernel(laws.spacecraft_models[0]), spacecraft_models.packed
        )
    sensor_data = SensorData(
        readers[0].layout,
        np.array([one.constants for one in readers]),
        np.array([one.memory for one in readers]),
        np.concatenate(body).astype(np.int64),
        _side_by_side(filters) if filters else None,
        spacecraft_models,
        place,
        np.zeros((len(members), size)),
    )
    return SensorBatch(readers, sensor_data)


def _side_by_side(parts: Sequence[Any]) -> Any:
    return type(parts[0])(*(np.array(each) for each in zip(*parts, strict=True)))


def _packed_array(kernel: BatchKernel, packed: Matrix) -> Vector:
    """Return the array of a kernel for numbers of its equations: of each member, or of all."""
    place = flat_zeros(kernel.size)
    place[:] = kernel.place(
        np.ascontiguousarray(np.broadcast_to(packed.T, (len(packed.T), BATCH_WIDTH)))
    )
    return place


def filter_of(laws: BatchLaws) -> Filter | None:
    """Return the filters of the attitude of a group; None: there are none."""
    if not laws.spacecraft_models:
        return rigid_filter if laws.filters else None
    return _flexible_filter(
        spacecraft_kernel(laws.spacecraft_models[0]), laws.spacecraft_models[0].steps
    )


@compiled
def rigid_filter(
    k: int,
    sensor_data: SensorData,
    measured: Matrix,
    joints: Matrix,
    reference: Vector,
    filled: int,
) -> None:
    """Estimate the joints of all members by filters of attitude and bias."""
    m = reference.size
    estimate, tips = np.empty(2 * m), measured.shape[1] - m
    for member in range(filled):
        numbers = numbers_of(sensor_data.filters, min(member, len(sensor_data.filters.period) - 1))
        read, data, now = measured[member, :tips], sensor_data.beliefs[member], joints[member]
        attitude_tick(k, numbers, read, now, reference, data, estimate)
        now[:] = estimate


@lru_cache
def _flexible_filter(kernel: BatchKernel, steps: int) -> Filter:
    """Return what estimates the joints of all members by filters with modes."""
    tick = flexible_tick(kernel, steps)

    @compiled
    def flexible_filter(
        k: int,
        sensor_data: SensorData,
        measured: Matrix,
        joints: Matrix,
        reference: Vector,
        filled: int,
    ) -> None:
        found, m = np.empty((filled, 7)), reference.size
        sensors, estimate = sensor_data.filters, np.empty(2 * m)
        filters = FlexibleFilters(
            sensors, sensor_data.spacecraft_models, sensor_data.beliefs, sensor_data.place
        )
        tick(k, filters, measured, reference, found, filled)
        for member in range(filled):
            numbers, now = numbers_of(sensors, min(member, len(sensors.period) - 1)), joints[member]
            write_joints(numbers, found[member], now, reference, estimate)
            now[:] = estimate

    return cast(Filter, flexible_filter)


def instrument_step(rows: Rows, sizes: Sizes, filtered: Filter | None) -> Callable[..., None]:
    """Return what writes readings of instruments, and joints as a filter believes in them.

    It takes (k, SensorData, draws of this tick, reference, BatchFaults, w, members in use).

    Args:
        rows: of the group.
        sizes: of the group.
        filtered: the filters; None: there are none.
    """
    m, tips, channels = sizes.joints, sizes.outputs - 2 * sizes.joints, sizes.appendages
    reading, measured, effort = rows.reading, rows.reading + 2 * m * BATCH_WIDTH, rows.applied
    has_filter = filtered is not None
    estimate_joints = filtered or rigid_filter
    apply_faults = reading_step() if sizes.has_faults else skip

    @compiled
    def measure(
        k: int,
        sensor_data: SensorData,
        noise: Matrix,
        reference: Vector,
        faults: BatchFaults | None,
        w: Vector,
        filled: int,
    ) -> None:
        body = np.empty(sensor_data.body.size)
        read, joints = np.zeros((filled, channels + m)), np.empty((filled, 2 * m))
        for member in range(filled):
            for i in range(body.size):
                body[i] = w[sensor_data.body[i] * BATCH_WIDTH + member]
            data, memory = sensor_data.constants[member], sensor_data.memory[member]
            outputs = read[member, :channels]
            read_instruments(k, sensor_data.layout, data, body, noise[member], memory, outputs)
            apply_faults(k, member, faults, 2 * m, outputs)
            put(outputs, member_rows(w, measured, tips, member))
            put(member_rows(w, effort, m, member), read[member, channels:])
            put(member_rows(w, reading, 2 * m, member), joints[member])
        if has_filter:
            estimate_joints(k, sensor_data, read, joints, reference, filled)
            for member in range(filled):
                put(joints[member], member_rows(w, reading, 2 * m, member))

    return cast(Callable[..., None], measure if sizes.has_instruments else skip)
