"""At which ticks a fault strikes that acts by chance."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexslew_plant.faults import Timed
from flexslew_plant.faults.chance import key_of, random_numbers


def active_ticks(timed: Timed, seed: int, ticks: int) -> NDArray[np.bool_]:
    """Return at which of the first ticks of a trial a fault strikes, shape (ticks,).

    Args:
        timed: the fault.
        seed: of the trial.
        ticks: of the trial.
    """
    fault: Any = timed.fault
    first, last = timed.start, int(min(timed.end, ticks))
    found = np.zeros(ticks, np.bool_)
    found[first:last] = True
    probability = getattr(fault, "probability", 1.0)
    if probability < 1.0:
        key = key_of(seed, 0, timed.start, fault.kind, fault.seed)  # epoch 0
        found[first:last] = random_numbers(key, first, last) < probability
    return found
