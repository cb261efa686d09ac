"""How far the tips of the appendages go."""

from collections.abc import Mapping
from typing import Any, ClassVar

from flexslew_lab.metrics.metric import Block, Ending, Key, MetricEntry, RunSetup


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
        self.residual: float | None = None  # [m]
        self.peak = 0.0  # [m]

    def add(self, block: Block) -> None:
        """Take the next ticks."""
        tip = abs(block.tip).max(axis=1, initial=0.0)
        self.peak = max(self.peak, float(tip.max()))
        if block.over.any():
            self.residual = max(self.residual or 0.0, float(tip[block.over].max()))

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return both values."""
        return {"residual_tip_deflection": self.residual, "peak_tip_deflection": self.peak}


TIP_DEFLECTION = MetricEntry(TipDeflection)
