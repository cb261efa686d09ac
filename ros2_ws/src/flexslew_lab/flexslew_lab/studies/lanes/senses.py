"""Instruments and filters of the attitude of all lanes, one after another as on the bench."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, cast

import numpy as np

from flexslew_control.estimators.attitude_tick import (
    AttitudeNumbers,
    attitude_memory,
    attitude_tick,
    numbers_of,
)
from flexslew_lab.studies.lanes.lane_faults import nothing_spoilt, spoil
from flexslew_lab.studies.lanes.lane_trial import LaneTrial
from flexslew_lab.studies.lanes.rows import Rows, Sizes
from flexslew_plant.arrays import Indices, Matrix, Tensor, Vector, compiled
from flexslew_plant.testbeds.compiled.lanes import LANES
from flexslew_plant.testbeds.instruments import MovingBody
from flexslew_plant.testbeds.instruments.packed_readers import PackedReaders, read_instruments


class Senses(NamedTuple):
    """What instruments and filters know, lane by lane; see PackedReaders and attitude_tick."""

    layout: Indices  # the same in all lanes
    constants: Matrix
    memory: Matrix
    body: Indices  # entries of the state that a MovingBody is of, one after another
    parts: Indices  # where attitude, rate, wheels and gimbals end there
    filters: Any  # AttitudeNumbers, a row for all lanes or for each; None: there are none
    beliefs: Matrix  # memory of the filters


class Heard(NamedTuple):
    """The instruments of a group, and what they tell."""

    readers: list[PackedReaders]  # of the first lanes
    senses: Senses

    def drawn(self, ticks: int) -> Tensor:
        """Return the random numbers of the next ticks, (ticks, lanes, draws)."""
        return np.stack([readers.drawn(ticks) for readers in self.readers], axis=1)


def heard_by(
    lanes: Sequence[LaneTrial], filters: Sequence[AttitudeNumbers], tips: int
) -> Heard | None:
    """Return the instruments of a group; None: there are none, or nobody hears them.

    Args:
        lanes: the group.
        filters: one for all lanes, or one for each; none: nobody filters.
        tips: how many of the tips the laws read.
    """
    model = lanes[0].model
    if model.appendages.body is None or not (filters or tips):
        return None
    readers = [
        lane.model.appendages.packed(lane.trial.period, [lane.trial.seed, 0]) for lane in lanes
    ]
    body = model.appendages.body(np.arange(float(model.positions + model.coordinates)))
    count = len(model.appendages.names)
    size = max((attitude_memory(numbers, count) for numbers in filters), default=0)
    senses = Senses(
        readers[0].layout,
        np.array([one.constants for one in readers]),
        np.array([one.memory for one in readers]),
        np.concatenate(body).astype(np.int64),
        np.cumsum([part.size for part in body]),
        _side_by_side(filters) if filters else None,
        np.zeros((len(lanes), size)),
    )
    return Heard(readers, senses)


def _side_by_side(filters: Sequence[AttitudeNumbers]) -> AttitudeNumbers:
    return AttitudeNumbers(*(np.array(parts) for parts in zip(*filters, strict=True)))


def sensing(rows: Rows, sizes: Sizes, heard: bool, filtered: bool) -> Callable[..., None]:
    """Return what writes readings of instruments, and joints as a filter believes in them.

    It takes (k, Senses, draws of this tick, reference, LaneFaults, w, first lanes to be asked for).

    Args:
        rows: of the group.
        sizes: of the group.
        heard: whether there are instruments.
        filtered: whether there are filters.
    """
    m, tips, channels = sizes.joints, sizes.outputs - 2 * sizes.joints, sizes.appendages
    reading, told = rows.reading, rows.reading + 2 * m * LANES
    spoilt = spoil if sizes.broken else nothing_spoilt

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

    @compiled
    def believe(
        k: int, lane: int, senses: Senses, tips: Vector, reference: Vector, w: Vector
    ) -> None:
        position, velocity = np.empty(m), np.empty(m)
        believed, rates = np.empty(m), np.empty(m)
        for i in range(m):
            position[i] = w[reading + i * LANES + lane]
            velocity[i] = w[reading + (m + i) * LANES + lane]
        numbers = numbers_of(senses.filters, min(lane, len(senses.filters.period) - 1))
        own = senses.beliefs[lane]
        attitude_tick(k, numbers, tips, position, velocity, reference, own, believed, rates)
        for i in range(m):
            w[reading + i * LANES + lane] = believed[i]
            w[reading + (m + i) * LANES + lane] = rates[i]

    def sense(
        k: int,
        senses: Senses,
        draws: Matrix,
        reference: Vector,
        faults: Any,
        w: Vector,
        filled: int,
    ) -> None:
        parts, read = senses.parts, np.zeros(channels)
        x = np.empty(senses.body.size)
        body = MovingBody(
            x[: parts[0]], x[parts[0] : parts[1]], x[parts[1] : parts[2]], x[parts[2] : parts[3]]
        )
        for lane in range(filled):
            for i in range(x.size):
                x[i] = w[senses.body[i] * LANES + lane]
            own, memory = senses.constants[lane], senses.memory[lane]
            read_instruments(k, senses.layout, own, body, draws[lane], memory, read)
            spoilt(k, lane, faults, 2 * m, read)
            for i in range(tips):
                w[told + i * LANES + lane] = read[i]
            if filtered:
                believe(k, lane, senses, read, reference, w)

    return cast(Callable[..., None], compiled(sense if heard else nothing))
