"""How far axes of a platform stay out of the cones in the sky that they must not look into."""

from collections.abc import Mapping
from typing import Any, ClassVar

from flexslew_lab.metrics.metric import Block, Ending, Key, MetricEntry, RunSetup
from flexslew_plant.testbeds.contract import HasSky

_MARGIN = "keep_out_margin"


class KeepOutMetric:
    """Implements Metric; returns no value for a testbed without cones."""

    KEYS: ClassVar[Mapping[str, Key]] = {
        _MARGIN: Key(
            "rad",
            False,
            "by cone: smallest angle by which its boresight stays outside; negative: inside",
        ),
    }

    def __init__(self, setup: RunSetup) -> None:
        known: Any = setup.testbed
        self._testbed: HasSky = known
        sky = self._testbed.sky()
        self._cones = () if sky is None else sky.cones
        self._margin: dict[str, float] = {}

    def add(self, block: Block) -> None:
        """Take the next ticks."""
        if not self._cones:
            return
        attitude = self._testbed.attitudes(block.position)
        for cone in self._cones:
            least = float(cone.margin(attitude).min())
            self._margin[cone.name] = min(self._margin.get(cone.name, least), least)

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return the value by cone."""
        return {_MARGIN: self._margin} if self._margin else {}


def cone_violations(metrics: Mapping[str, Any]) -> str:
    """Return which cones a run has looked into, for a person; empty: none.

    Args:
        metrics: content of metrics.json.
    """
    violations = {name: m for name, m in metrics.get(_MARGIN, {}).items() if m < 0.0}
    each = ", ".join(f"{name} by {-margin:.3g} rad" for name, margin in violations.items())
    return f"looked into keep_out {each}" if each else ""


KEEP_OUT = MetricEntry(KeepOutMetric, of=HasSky)
