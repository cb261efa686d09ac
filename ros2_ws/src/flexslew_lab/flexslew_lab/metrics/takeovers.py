"""Who was in charge: switches, missed answers, faults and what took over."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from flexslew_lab.metrics.metric import Block, Ending, Key, MetricEntry, RunSetup


class Takeovers:
    """Implements Metric; all of it is in the events."""

    KEYS: ClassVar[Mapping[str, Key]] = {
        "missed_ticks": Key("-", False, "ticks without a valid answer in time"),
        "switches": Key("-", False, "changes of the controller in charge that took effect"),
        "largest_effort_step": Key(
            "N m or N", False, "largest step of any effort at a switch; null: no switch"
        ),
        "faults": Key(
            "-",
            False,
            "faults that began, injected ones included; a fallback or the brake that takes over "
            "is one",
        ),
        "fallbacks": Key("-", False, "times that a fallback or the brake took over"),
    }

    def __init__(self, setup: RunSetup) -> None:
        pass

    def add(self, block: Block) -> None:
        """Take the next ticks."""

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return the five values."""
        events = [(e.kind, e.level, _data(e)) for e in ending.events]
        steps = [_step(data) for kind, _, data in events if kind == "switched"]
        return {
            "missed_ticks": sum(int(d.get("ticks", 1)) for k, _, d in events if k == "missed"),
            "switches": len(steps),
            "largest_effort_step": max(steps, default=None),
            "faults": sum(
                level == "fault" or (kind == "fault" and bool(data.get("on")))
                for kind, level, data in events
            ),
            "fallbacks": sum(kind in ("fallback", "brake") for kind, _, _ in events),
        }


def _data(event: Any) -> dict[str, Any]:
    return event.data if isinstance(event.data, dict) else {}


def _step(data: dict[str, Any]) -> float:
    step = np.asarray(data.get("effort_step", 0.0), dtype=float)
    return float(np.abs(np.atleast_1d(step)).max(initial=0.0))


TAKEOVERS = MetricEntry("takeovers", Takeovers)
