"""The contract of a fault that is one step: a compiled function of one reading, demand or effort.

The bench and batches call the same step, so such a fault is written once. A step changes one entry
at a time; a fault that needs several at once, or what only Python gives, returns an Effect instead.
"""

from collections.abc import Callable
from enum import IntEnum
from typing import NamedTuple, TypeAlias

from flexslew_plant.arrays import Vector

# (numbers, memory, since, value) -> value: numbers of the FaultAction; memory of this entry, which
# it advances; ticks since the fault began; reading, demand or effort of this tick. It is called at
# the ticks at which the fault acts, and decorated by `called`
FaultStep: TypeAlias = Callable[[Vector, Vector, int, float], float]


class Where(IntEnum):
    """Which values a fault changes, in the order of a tick."""

    READING = 0  # of a channel
    LATE = 1  # demand between drive and motors, before what else changes it
    DEMAND = 2  # demand that the motors receive
    EFFORT = 3  # that the motors give


class FaultAction(NamedTuple):
    """How a fault acts on one testbed.

    Args:
        where: it acts.
        first: entry of the channel, or joint, from which on it acts.
        last: first one after these.
        numbers: constants of its step.
        memory: numbers that its step stores for each entry. They begin as the demand (LATE, DEMAND)
            or effort (EFFORT) of the last tick before the fault, and as zero for readings.
        channel: of readings.
        probability: that it acts, at each tick; below 1 its section has a `seed`.
    """

    where: Where
    first: int
    last: int
    numbers: tuple[float, ...] = ()
    memory: int = 0
    channel: str = ""
    probability: float = 1.0


def entries(known: tuple[str, ...], name: str | None) -> tuple[int, int]:
    """Return the first entry of a name, and the first one after it; None: of all names."""
    if name is None:
        return 0, len(known)
    first = known.index(name)
    return first, first + 1
