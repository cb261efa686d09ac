"""How far the tips of the appendages go."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from flexslew_lab.metrics.metric import Block, Ending, Key, MetricEntry, RunSetup, ready
from flexslew_plant.arrays import Vector


class TipDeflection:
    """Implements Metric; the residual is None if the log lacks the manoeuvre's end."""

    KEYS: ClassVar[Mapping[str, Key]] = {
        "residual_tip_deflection": Key(
            "m",
            False,
            "largest |tip deflection| of any appendage after the end of the manoeuvre",
        ),
        "peak_tip_deflection": Key(
            "m",
            False,
            "largest |tip deflection| of any appendage; platforms that point: by appendage, "
            "largest distance of its tip",
        ),
    }

    def __init__(self, setup: RunSetup) -> None:
        self._setup = setup
        self.residual, self.peak = -np.inf, 0.0  # [m]

    def add(self, block: Block) -> None:
        """Take the next ticks."""
        tip = abs(block.tip).max(axis=1, initial=0.0)
        self.peak = max(self.peak, float(tip.max()))
        if block.over.any():
            self.residual = max(self.residual, float(tip[block.over].max()))

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return both values."""
        values = tip_values(np.array(self.residual), np.array(self.peak))
        return ready(self._setup, self.KEYS, values)


def tip_values(residual: Vector, peak: Vector) -> dict[str, Vector]:
    """Return the values of one or more runs by key, each of shape (...,) [m].

    Args:
        residual: largest deflection after the manoeuvre's end, (...,) [m]; -inf: it has not ended.
        peak: largest deflection, (...,) [m].
    """
    return {"residual_tip_deflection": residual, "peak_tip_deflection": peak}


TIP_DEFLECTION = MetricEntry(TipDeflection, needs_truth=False)
