"""Series of one clock each, by name, as a file of measurements holds them."""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput

LARGEST_VALUE = 1e100  # whose square is a number
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # of times [s]


class FileClock(NamedTuple):
    """How the times of a file are read.

    Args:
        column: name of the column of times; None: `time`, `t` or `stamp`.
        unit: of its numbers, a key of UNITS; None: the one in its name, or seconds.
        period: between samples where no column holds times [s]; None: times are required.
        recorded: a bag's messages count at their times of recording, not at their headers' stamps.
    """

    column: str | None = None
    unit: str | None = None
    period: float | None = None
    recorded: bool = False


class Columns(NamedTuple):
    """Series of one clock each, by name."""

    series: dict[str, tuple[Vector, Vector]]  # times [s] and values
    source: str
    past: frozenset[str] = frozenset()  # names of values held until their stamp, not from it on
    notes: tuple[str, ...] = ()  # warnings for the user


# of the names in a file: those of the columns to be read, in any order
Choose: TypeAlias = Callable[[tuple[str, ...]], tuple[str, ...]]


def require_times(columns: Columns) -> None:
    """Require of every series two samples and more, at finite times that increase, and of a size.

    Raises:
        BadInput: if one has not; with the time.
    """
    for name, (t, values) in columns.series.items():
        place = f"{columns.source}: {name}"
        if (np.abs(values) > LARGEST_VALUE).any() or (np.abs(t) > LARGEST_VALUE).any():
            raise BadInput(f"{place}: has a number above {LARGEST_VALUE:g}; is the file damaged?")
        if len(t) < 2 or not np.isfinite(t).all():
            raise BadInput(f"{place}: two samples and more are needed, at finite times")
        steps = np.diff(t)
        if not steps.any():
            raise BadInput(
                f"{place}: the time stands still at {t[0]:.6g} s in all {len(t)} samples"
            )
        if (steps <= 0.0).any():
            at = int(np.argmax(steps <= 0.0))
            motion = "back" if steps[at] < 0.0 else "not"
            raise BadInput(f"{place}: the time steps {motion} at {t[at]:.6g} s")
