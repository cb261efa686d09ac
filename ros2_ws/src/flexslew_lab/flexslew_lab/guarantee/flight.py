"""The nearest unstable loop, flown: the non-linear bench with the parameters of the worst case."""

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from flexslew_lab.analysis.analysis import Analysis
from flexslew_lab.analysis.mode_flight import require_same_bench
from flexslew_lab.analysis.proof import measured_pole, mode_near
from flexslew_lab.guarantee.bounds import worst_case_of
from flexslew_lab.guarantee.model.parameters import Vary, loop_values
from flexslew_lab.guarantee.model.situation import situation_at
from flexslew_lab.guarantee.model.varied_loop import (
    VariedLoop,
    default_vary,
    varied_loop,
)
from flexslew_lab.guarantee.worst_case import WorstCase
from flexslew_lab.trial.trial import Trial
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput

_OFFSET = 0.002  # how far inside and outside of the boundary is flown, of the way to it
_LEFT = 0.01  # of a record that is not its one pole, at most


@dataclass(frozen=True)
class FlownWorstCase:
    """Growth of the critical pole on the bench on both sides of the boundary of stability.

    Args:
        inside, outside: growth there [1/s].
        frequency: outside [rad/s].
        left: of the records that is not this one pole, root mean square [-].
    """

    inside: float
    outside: float
    frequency: float
    left: float

    @property
    def agrees(self) -> bool:
        """Whether it decays inside and grows outside, and is all of the record."""
        return bool(self.inside < 0.0 < self.outside and self.left <= _LEFT)

    @property
    def verdict(self) -> str:
        """The result in a sentence."""
        result = "flown as predicted" if self.agrees else "NOT flown as predicted"
        return (
            f"{result}, growth {self.inside:.3g} 1/s just inside and {self.outside:.3g} 1/s "
            f"just outside, at {self.frequency:.3g} rad/s"
        )

    def plain(self) -> dict[str, Any]:
        """Return it as plain data."""
        return asdict(self) | {"agrees": self.agrees}


@dataclass(frozen=True)
class Guarantee:
    """A worst case, its loop, and its flight, or None if it was not flown."""

    found: WorstCase
    varied: VariedLoop
    flown: FlownWorstCase | None

    @property
    def holds(self) -> bool:
        """Whether the whole box is guaranteed, and a flight agrees."""
        return self.found.guaranteed and (self.flown is None or self.flown.agrees)

    @property
    def verdict(self) -> str:
        """The result in a sentence, with its flight."""
        flown = "" if self.flown is None else f"; nearest unstable loop {self.flown.verdict}"
        return self.found.verdict + flown

    def plain(self) -> dict[str, Any]:
        """Return it as plain data."""
        return self.found.plain() | {"flown": None if self.flown is None else self.flown.plain()}


def guarantee_of(
    trial: Trial, analysis: Analysis, vary: Vary | None = None, fly: bool = False
) -> Guarantee:
    """Return the worst case of an analysed loop, flown where there is an unstable loop to fly.

    Args:
        trial: that was analysed.
        analysis: of its loop.
        vary: see worst_case_of.
        fly: whether to fly it.

    Raises:
        BadInput: see worst_case_of and fly_worst_case.
    """
    vary = default_vary(trial) if vary is None else vary
    found = worst_case_of(trial, analysis, vary)
    flown = fly_worst_case(trial, analysis, found) if fly and found.unstable is not None else None
    return Guarantee(found, varied_loop(trial, analysis, vary), flown)


def fly_worst_case(trial: Trial, analysis: Analysis, found: WorstCase) -> FlownWorstCase:
    """Return flights of the non-linear bench just inside and just outside of the worst case.

    Each starts on the critical mode: plant, motors and law, as for margins (see mode_response).

    Raises:
        BadInput: if there is no unstable loop, or the plant changes with time.
    """
    if found.unstable is None:
        raise BadInput("--prove: no unstable loop was found: there is none to fly")
    require_same_bench(trial, analysis)
    p = found.parameters
    if mode := next((one.name for one in p if one.name.startswith("mode.")), None):
        raise BadInput(f"--prove: {mode} is no number of a bench; vary stiffness or testbed.KEY")
    centre = np.array([(one.low + one.high) / 2.0 for one in p])
    way = found.unstable.values - centre
    varied = VariedLoop(situation_at(trial, analysis.point), p, analysis, np.ones(0))
    inside, outside = (
        _measure(varied, centre + (1.0 + side * _OFFSET) * way, found.frequency)
        for side in (-1.0, 1.0)
    )
    return FlownWorstCase(
        inside[0].real, outside[0].real, abs(outside[0]), max(inside[1], outside[1])
    )


def _measure(varied: VariedLoop, values: Vector, frequency: float) -> tuple[complex, float]:
    """Return the pole near a frequency [rad/s] that the bench rings with, and what it leaves."""
    there = varied.situation.changed(loop_values(varied.parameters, values))
    loop = varied.at(values)
    trial = replace(there.trial, testbed=there.testbed, actuator=there.path.actuator)
    point = replace(varied.analysis.point, rest=there.rest, path=there.path)
    s, mode = mode_near(loop, frequency)
    return measured_pole(trial, replace(varied.analysis, point=point), loop, there.path, s, mode)
