"""Series of one clock each, by name, as a CSV file or a bag holds them."""

from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput


class Columns(NamedTuple):
    """Series of one clock each, by name."""

    series: dict[str, tuple[Vector, Vector]]  # times [s] and values
    source: str
    past: frozenset[str] = frozenset()  # names of values held until their stamp, not from it on


def require_times(columns: Columns) -> None:
    """Require of every series two samples and more, at finite times that increase.

    Raises:
        BadInput: if one has not; with the time.
    """
    for name, (t, _) in columns.series.items():
        place = f"{columns.source}: {name}"
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
