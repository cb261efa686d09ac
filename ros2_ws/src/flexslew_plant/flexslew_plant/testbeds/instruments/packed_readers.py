"""All instruments of a platform for compiled code that flies many benches, one after another."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexslew_plant.arrays import Indices, Matrix, Vector, compiled_once
from flexslew_plant.testbeds.instruments.gyro import read_gyro
from flexslew_plant.testbeds.instruments.instrument import CompiledReader, Instrument, Read
from flexslew_plant.testbeds.instruments.rotor_sensors import read_rotors
from flexslew_plant.testbeds.instruments.star_tracker import read_star_tracker
from flexslew_plant.testbeds.instruments.sun_sensor import read_sun_sensor

_READS: tuple[Read, ...] = (read_gyro, read_star_tracker, read_sun_sensor, read_rotors)


def are_packed(instruments: Sequence[Instrument], period: float) -> bool:
    """Return whether all instruments have readers of the table, at a period [s]."""
    return all(one.reader(period, None).read in _READS for one in instruments)


@dataclass(frozen=True)
class PackedReaders:
    """What `read_instruments` takes, before tick 0, and what draws the random numbers of a tick.

    Benches of one `layout` may be next to each other, with rows of constants, draws and
    memory of their own.

    Args:
        layout: for each instrument its place in the table of readers, then where its part of tips,
            constants, draws and memory begins and ends, shape (instruments, 9).
        constants: constants of all instruments.
        memory: memory of all instruments before tick 0.
        readers: one for each.
        rngs: one for each; None: it has no errors.
    """

    layout: Indices
    constants: Vector
    memory: Vector
    readers: tuple[CompiledReader, ...]
    rngs: tuple[np.random.Generator | None, ...]

    def draw(self, ticks: int) -> Matrix:
        """Return the random numbers of the next ticks, shape (ticks, draws)."""
        pairs = zip(self.readers, self.rngs, strict=True)
        rows = [reader.draw(rng, ticks) for reader, rng in pairs]
        return np.hstack(rows) if rows else np.zeros((ticks, 0))


def packed_readers(
    instruments: Sequence[Instrument], period: float, rngs: Sequence[np.random.Generator | None]
) -> PackedReaders:
    """Return the readers of instruments.

    Args:
        instruments: in the order in which they are read.
        period: one tick [s].
        rngs: of their noises, see Instrument.reader.
    """
    pairs = zip(instruments, rngs, strict=True)
    readers = tuple(one.reader(period, rng) for one, rng in pairs)
    rows = [
        (one.first, len(one.axes), its.constants.size, its.uniform + its.normal, its.memory.size)
        for one, its in zip(instruments, readers, strict=True)
    ]
    sizes = np.array(rows, dtype=np.int64).reshape(-1, 5)
    layout = np.empty((len(rows), 9), dtype=np.int64)
    layout[:, 0] = [_READS.index(reader.read) for reader in readers]
    layout[:, 2::2] = np.cumsum(sizes[:, 1:], axis=0)
    layout[:, 1::2] = layout[:, 2::2] - sizes[:, 1:]
    layout[:, 1], layout[:, 2] = sizes[:, 0], sizes[:, 0] + sizes[:, 1]
    none = np.zeros(0)
    constants = np.concatenate([none, *(reader.constants for reader in readers)])
    memory = np.concatenate([none, *(reader.memory for reader in readers)])
    return PackedReaders(layout, constants, memory, readers, tuple(rngs))


@compiled_once("memory", "tips")
def read_instruments(
    k: int,
    layout: Indices,
    constants: Vector,
    body: Vector,
    samples: Vector,
    memory: Vector,
    tips: Vector,
) -> None:
    """Write the instruments' readings at tick k among those of the tips; see PackedReaders.

    Args:
        k: tick, from 0 on, one after another.
        layout: the layout of PackedReaders.
        constants: the constants of PackedReaders.
        body: the parts of a BodyState, one after another.
        samples: a row of PackedReaders.draw.
        memory: memory of the instruments, in and out.
        tips: readings of all tips, of which theirs are written.
    """
    for n in range(len(layout)):
        at = layout[n]
        out, given = tips[at[1] : at[2]], constants[at[3] : at[4]]
        drawn, own = samples[at[5] : at[6]], memory[at[7] : at[8]]
        if at[0] == 0:
            read_gyro(k, given, body, drawn, own, out)
        elif at[0] == 1:
            read_star_tracker(k, given, body, drawn, own, out)
        elif at[0] == 2:
            read_sun_sensor(k, given, body, drawn, own, out)
        else:
            read_rotors(k, given, body, drawn, own, out)
