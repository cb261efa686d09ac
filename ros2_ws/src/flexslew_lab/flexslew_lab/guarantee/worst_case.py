"""The worst case of a trial's loop over its uncertain parameters."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from flexslew_lab.guarantee.box import Box
from flexslew_lab.guarantee.certificate import Certificate
from flexslew_lab.guarantee.fit.polynomial import FitError
from flexslew_lab.guarantee.model.parameters import Uncertain, box_of, loop_values
from flexslew_lab.guarantee.search import Breakdown
from flexslew_lab.json_text import finite
from flexslew_plant.notebook_table import in_notebook


class DisturbanceResponse(NamedTuple):
    """A closed-loop response to a disturbance of the efforts, at the plant's input.

    Args:
        name: S, T or pointing.
        complement: whether it is one minus T.
        pointing: whether its outputs are the joint positions [rad/(N m), m/N], not the efforts.
    """

    name: str
    complement: bool = False
    pointing: bool = False


WORST_COLUMNS = ("parameter", "low", "high", "unstable at")
RESPONSES = (
    DisturbanceResponse("S", complement=True),
    DisturbanceResponse("T"),
    DisturbanceResponse("pointing", pointing=True),
)


@dataclass(frozen=True)
class GainBounds:
    """Peak over frequency of a response over all parameters in the box, in the response's unit.

    Args:
        name: of the response.
        nominal: at the centre of the box.
        found: largest one found, at `values`.
        bound: none is larger, certified; inf: no bound was found.
        values: where the largest one is, by parameter.
    """

    name: str
    nominal: float
    found: float
    bound: float
    values: Mapping[str, float]


@dataclass(frozen=True, repr=False)
class WorstCase:
    """Robust stability of a loop over a box of parameters, with both bounds.

    Args:
        controller: that closes the loop.
        parameters: with their ranges.
        certified: scale of the box about its centre within which every loop is stable [-]; 0: none.
        certificate: of that scale, or the last one that failed.
        unstable: the nearest loop that is not stable, or None up to `searched`.
        searched: largest scale that was searched [-].
        gains: bounds of the RESPONSES over the certified box, at most the whole one.
        fit: of A over the ranges, its states balanced [-].
        period: one tick [s].
    """

    controller: str
    parameters: tuple[Uncertain, ...]
    certified: float
    certificate: Certificate
    unstable: Breakdown | None
    searched: float
    gains: tuple[GainBounds, ...]
    fit: FitError
    period: float

    @property
    def box(self) -> Box:
        """The ranges of the parameters."""
        return box_of(self.parameters)

    @property
    def guaranteed(self) -> bool:
        """Whether every loop in the box is stable, by a certificate that was checked."""
        return self.certified >= 1.0

    @property
    def gap(self) -> float:
        """Difference of the two scales, of the larger one [-]; inf without an unstable loop."""
        if self.unstable is None:
            return np.inf
        return 1.0 - self.certified / self.unstable.scale

    @property
    def frequency(self) -> float:
        """Frequency of the pole of the nearest unstable loop [rad/s]; nan: there is none."""
        return np.nan if self.unstable is None else self.unstable.angle / self.period

    @property
    def verdict(self) -> str:
        """The result in a sentence, with the gap of the bounds."""
        if self.certified > 0.0:
            parts = [f"stable for every {self._ranges(self.certified)}"]
        else:
            angle = self.certificate.open_at
            at = "" if angle is None else f" at {angle / self.period:.3g} rad/s in the time allowed"
            reached = f": {self.certificate.ended}" if self.certificate.ended else ""
            parts = [f"not certified{at}{reached}"]
        if (values := self.unstable_at) is not None:
            at = ", ".join(self._value(p, values[p.name]) for p in self.parameters)
            parts.append(f"unstable at {at} ({self.frequency:.3g} rad/s)")
            if self.certified > 0.0:
                parts.append(f"gap of the bounds {100.0 * self.gap:.2g} %")
        else:
            parts.append(f"no unstable loop was found within {self.searched:.3g} times the ranges")
        return "; ".join(parts)

    def _ranges(self, scale: float) -> str:
        words = []
        for p in self.parameters:
            if p.relative is not None:
                words.append(f"{p.name} within +-{100.0 * scale * p.relative:.3g} %")
            else:
                centre, radius = (p.low + p.high) / 2.0, scale * (p.high - p.low) / 2.0
                low, high = max(centre - radius, 0.0 if p.low >= 0.0 else -np.inf), centre + radius
                words.append(f"{p.name} from {low:.4g} to {high:.4g} {p.unit}".rstrip())
        return ", ".join(words)

    def _value(self, p: Uncertain, value: float) -> str:
        if p.relative is not None:
            return f"{p.name} {100.0 * (value / p.nominal - 1.0):+.3g} %"
        return f"{p.name} {value:.4g} {p.unit}".rstrip()

    def __repr__(self) -> str:
        """Return one line: the controller and the verdict."""
        return f"<WorstCase of {self.controller}: {self.verdict}>"

    def _repr_html_(self) -> str:
        """Return the parameters of the nearest unstable loop, for notebooks."""
        return in_notebook(repr(self), WORST_COLUMNS, self.rows)

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """A row of WORST_COLUMNS for each parameter."""
        values = self.unstable_at
        return [
            (p.name, f"{p.low:.5g}", f"{p.high:.5g}", f"{values[p.name]:.6g}" if values else "-")
            for p in self.parameters
        ]

    @property
    def unstable_at(self) -> dict[str, float] | None:
        """Parameters of the nearest unstable loop by name, None if there is none."""
        found = self.unstable
        return None if found is None else loop_values(self.parameters, found.values)

    def plain(self) -> dict[str, Any]:
        """Return the numbers as JSON holds them."""
        found: dict[str, Any] = finite(
            {
                "verdict": self.verdict,
                "guaranteed": self.guaranteed,
                "parameters": [p._asdict() for p in self.parameters],
                "certified_scale": self.certified,
                "parts": len(self.certificate.parts),
                "checked_points": self.certificate.checked,
                "unstable_scale": None if self.unstable is None else self.unstable.scale,
                "unstable_at": self.unstable_at,
                "unstable_frequency": self.frequency,
                "searched_scale": self.searched,
                "gap": self.gap,
                "gains": [vars(gain) | {"values": dict(gain.values)} for gain in self.gains],
                "fit_error": 0.0 if self.fit.exact else self.fit.largest,
                "fit": self.fit.words,
            }
        )
        return found
