"""Instruments and filters of the attitude of all lanes, one after another as on the bench."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np

from flexslew_control.estimators.attitude_tick import (
    attitude_memory,
    attitude_tick,
    numbers_of,
    tell_joints,
)
from flexslew_control.estimators.flexible_attitude_tick import flexible_memory, flexible_tick
from flexslew_lab.studies.lanes.benches.lane_faults import nothing_spoilt, spoiling
from flexslew_lab.studies.lanes.groups.lane_laws import Beside, craft_kernel
from flexslew_lab.studies.lanes.groups.lane_trial import LaneTrial
from flexslew_lab.studies.lanes.groups.rows import Rows, Sizes
from flexslew_plant.arrays import Indices, Matrix, Tensor, Vector, compiled
from flexslew_plant.testbeds.compiled.lanes import LANES, LaneKernel, flat_zeros
from flexslew_plant.testbeds.instruments import MovingBody
from flexslew_plant.testbeds.instruments.packed_readers import PackedReaders, read_instruments

# (k, Senses, told, joints, reference, filled): replaces the joint readings, (lanes, 2 joints), by
# their estimates; told: readings of all tips, then the efforts before, (lanes, tips + joints)
Filter: TypeAlias = Callable[..., None]


class Senses(NamedTuple):
    """What instruments and filters know, lane by lane; see PackedReaders and attitude_tick."""

    layout: Indices  # the same in all lanes
    constants: Matrix
    memory: Matrix
    body: Indices  # entries of the state that a MovingBody is of, one after another
    parts: Indices  # where attitude, rate, wheels and gimbals end there
    filters: Any  # AttitudeNumbers, a row for all lanes or for each; None: there are none
    crafts: Any  # FlexibleNumbers likewise; None: attitude and bias are all that they believe
    place: Vector  # where their equations are advanced, see flexible_tick
    beliefs: Matrix  # memory of the filters


class Heard(NamedTuple):
    """The instruments of a group, and their readings."""

    readers: list[PackedReaders]  # of the first lanes
    senses: Senses

    def drawn(self, ticks: int) -> Tensor:
        """Return the random numbers of the next ticks, (ticks, lanes, draws)."""
        return np.stack([readers.drawn(ticks) for readers in self.readers], axis=1)


def heard_by(lanes: Sequence[LaneTrial], laws: Beside, tips: int) -> Heard | None:
    """Return the instruments of a group; None: there are none, or no law reads them.

    Args:
        lanes: the group.
        laws: the first that are in charge.
        tips: how many of the tips they read.
    """
    model, filters = lanes[0].model, laws.filters
    if model.appendages.body is None or not (filters or tips):
        return None
    readers = [
        lane.model.appendages.packed(lane.trial.period, [lane.trial.seed, 0]) for lane in lanes
    ]
    body = model.appendages.body(np.arange(float(model.positions + model.coordinates)))
    count, crafts, place = len(model.appendages.names), None, flat_zeros(0)
    size = max((attitude_memory(numbers, count) for numbers in filters), default=0)
    if laws.crafts:
        crafts = _side_by_side([form.numbers for form in laws.crafts])
        size = flexible_memory(filters[0], laws.crafts[0].numbers, count)
        place = _placed(craft_kernel(laws.crafts[0]), crafts.packed)
    senses = Senses(
        readers[0].layout,
        np.array([one.constants for one in readers]),
        np.array([one.memory for one in readers]),
        np.concatenate(body).astype(np.int64),
        np.cumsum([part.size for part in body]),
        _side_by_side(filters) if filters else None,
        crafts,
        place,
        np.zeros((len(lanes), size)),
    )
    return Heard(readers, senses)


def _side_by_side(parts: Sequence[Any]) -> Any:
    return type(parts[0])(*(np.array(each) for each in zip(*parts, strict=True)))


def _placed(kernel: LaneKernel, packed: Matrix) -> Vector:
    """Return the array of a kernel for numbers of its equations: of each lane, or of all."""
    place = flat_zeros(kernel.size)
    place[:] = kernel.place(np.ascontiguousarray(np.broadcast_to(packed.T, (len(packed.T), LANES))))
    return place


def filter_of(laws: Beside) -> Filter | None:
    """Return the filters of the attitude of a group; None: there are none."""
    if not laws.crafts:
        return rigid_filter if laws.filters else None
    return _flexible_filter(craft_kernel(laws.crafts[0]), laws.crafts[0].steps)


@compiled
def rigid_filter(
    k: int, senses: Senses, told: Matrix, joints: Matrix, reference: Vector, filled: int
) -> None:
    """Estimate the joints of all lanes by filters of attitude and bias."""
    m = reference.size
    believed, tips = np.empty(2 * m), told.shape[1] - m
    for lane in range(filled):
        numbers = numbers_of(senses.filters, min(lane, len(senses.filters.period) - 1))
        read, own, now = told[lane, :tips], senses.beliefs[lane], joints[lane]
        attitude_tick(k, numbers, read, now, reference, own, believed)
        now[:] = believed


@lru_cache
def _flexible_filter(kernel: LaneKernel, steps: int) -> Filter:
    """Return what estimates the joints of all lanes by filters with modes."""
    tick = flexible_tick(kernel, steps)

    @compiled
    def flexible_filter(
        k: int, senses: Senses, told: Matrix, joints: Matrix, reference: Vector, filled: int
    ) -> None:
        found, m = np.empty((filled, 7)), reference.size
        sensors, crafts, believed = senses.filters, senses.crafts, np.empty(2 * m)
        beliefs, place = senses.beliefs, senses.place
        tick(k, sensors, crafts, told, reference, beliefs, place, found, filled)
        for lane in range(filled):
            numbers, now = numbers_of(sensors, min(lane, len(sensors.period) - 1)), joints[lane]
            tell_joints(numbers, found[lane], now, reference, believed)
            now[:] = believed

    return cast(Filter, flexible_filter)


def sensing(rows: Rows, sizes: Sizes, heard: bool, filtered: Filter | None) -> Callable[..., None]:
    """Return what writes readings of instruments, and joints as a filter believes in them.

    It takes (k, Senses, draws of this tick, reference, LaneFaults, w, number of lanes in use).

    Args:
        rows: of the group.
        sizes: of the group.
        heard: whether there are instruments.
        filtered: the filters; None: there are none.
    """
    m, tips, channels = sizes.joints, sizes.outputs - 2 * sizes.joints, sizes.appendages
    reading, told, effort = rows.reading, rows.reading + 2 * m * LANES, rows.applied
    filtering = filtered is not None
    believe = filtered or rigid_filter
    spoilt = spoiling() if sizes.broken else nothing_spoilt

    def nothing(
        k: int,
        senses: Senses,
        draws: Matrix,
        reference: Vector,
        faults: Any,
        w: Vector,
        filled: int,
    ) -> None:
        pass

    def sense(
        k: int,
        senses: Senses,
        draws: Matrix,
        reference: Vector,
        faults: Any,
        w: Vector,
        filled: int,
    ) -> None:
        parts, x = senses.parts, np.empty(senses.body.size)
        read, joints = np.zeros((filled, channels + m)), np.empty((filled, 2 * m))
        body = MovingBody(
            x[: parts[0]], x[parts[0] : parts[1]], x[parts[1] : parts[2]], x[parts[2] : parts[3]]
        )
        for lane in range(filled):
            for i in range(x.size):
                x[i] = w[senses.body[i] * LANES + lane]
            own, memory = senses.constants[lane], senses.memory[lane]
            heard_now = read[lane, :channels]
            read_instruments(k, senses.layout, own, body, draws[lane], memory, heard_now)
            spoilt(k, lane, faults, 2 * m, heard_now)
            for i in range(tips):
                w[told + i * LANES + lane] = read[lane, i]
            for i in range(m):
                read[lane, channels + i] = w[effort + i * LANES + lane]
            for i in range(2 * m):
                joints[lane, i] = w[reading + i * LANES + lane]
        if filtering:
            believe(k, senses, read, joints, reference, filled)
            for lane in range(filled):
                for i in range(2 * m):
                    w[reading + i * LANES + lane] = joints[lane, i]

    return cast(Callable[..., None], compiled(sense if heard else nothing))
