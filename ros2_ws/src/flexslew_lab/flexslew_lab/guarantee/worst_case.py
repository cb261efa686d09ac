"""The worst case of a trial's loop over its uncertain parameters."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import matrix_balance

from flexslew_control.analysis.loop import ControlLoop, loop_of
from flexslew_lab.analysis.analysis import Analysis, finite, is_stable
from flexslew_lab.guarantee.box import Box
from flexslew_lab.guarantee.certificate import (
    Certificate,
    GainLimit,
    UncertainLoop,
    certify,
    uncertain_loop,
)
from flexslew_lab.guarantee.parameters import (
    DEFAULT,
    Situation,
    Uncertain,
    Vary,
    box_of,
    largest_scale,
    loop_values,
    uncertain_parameters,
)
from flexslew_lab.guarantee.response import largest_peak, peak_at
from flexslew_lab.guarantee.search import Breakdown, breakdown
from flexslew_lab.short_values import short
from flexslew_lab.trial.trial import Trial
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.notebook_table import in_notebook

_LARGEST = 2.0  # scale to which the nearest unstable loop is sought [-]
_TRIES = (0.995, 0.96, 0.91, 0.8, 0.5)  # of its scale, to be certified
_GAIN_TRIES = (1.01, 1.05, 1.2)  # times the largest gain found
_SECONDS = 40.0  # of each attempt
_GAIN_SHARE = 0.25  # of the time of an attempt


@dataclass(frozen=True)
class GainBounds:
    """Peak of a closed-loop response at the plant's input over all parameters in the box.

    Args:
        name: S or T.
        nominal: at the centre of the box [-].
        found: largest one found, at `values` [-].
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
        gains: bounds of S and T over the certified box, at most the whole one.
        fit_error: of the linear fractional form, of the largest matrix entry [-].
        period: one tick [s].
    """

    controller: str
    parameters: tuple[Uncertain, ...]
    certified: float
    certificate: Certificate
    unstable: Breakdown | None
    searched: float
    gains: tuple[GainBounds, ...]
    fit_error: float
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
            parts = [f"not certified{at}"]
        if self.unstable is not None:
            values = loop_values(self.parameters, self.unstable.values)
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
        values = {} if self.unstable is None else loop_values(self.parameters, self.unstable.values)
        rows = (
            (p.name, short(p.low), short(p.high), short(values[p.name]) if values else "-")
            for p in self.parameters
        )
        return in_notebook(repr(self), ("parameter", "low", "high", "unstable at"), rows)

    def plain(self) -> dict[str, Any]:
        """Return the numbers as JSON holds them."""
        unstable = self.unstable
        found: dict[str, Any] = finite(
            {
                "verdict": self.verdict,
                "guaranteed": self.guaranteed,
                "parameters": [p._asdict() for p in self.parameters],
                "certified_scale": self.certified,
                "parts": len(self.certificate.parts),
                "checked_points": self.certificate.checked,
                "unstable_scale": None if unstable is None else unstable.scale,
                "unstable_at": None
                if unstable is None
                else loop_values(self.parameters, unstable.values),
                "unstable_frequency": self.frequency,
                "searched_scale": self.searched,
                "gap": self.gap,
                "gains": [vars(gain) | {"values": dict(gain.values)} for gain in self.gains],
                "fit_error": self.fit_error,
            }
        )
        return found


@dataclass(frozen=True)
class VariedLoop:
    """A trial's controller on plants that differ.

    Args:
        situation: of the trial.
        parameters: that differ.
        analysis: of the loop as it is: its law stays.
        scales: that balance the states, shape (states,).
    """

    situation: Situation
    parameters: tuple[Uncertain, ...]
    analysis: Analysis
    scales: Vector

    def at(self, values: Vector) -> ControlLoop:
        """Return the loop at values of the parameters, shape (m,)."""
        changes = loop_values(self.parameters, values)
        return loop_of(self.situation.changed(changes).plant, self.analysis.running.form)

    def matrix(self, values: Vector) -> Matrix:
        """Return [[A, B], [C, D]] of -T at the plant's input, its states balanced."""
        closed, m, t = self.at(values).closed, self.analysis.loop.efforts, self.scales
        return np.block([[closed.a * t / t[:, None], closed.b[:, :m] / t[:, None]],
                         [closed.c[:m] * t, closed.d[:m, :m]]])  # fmt: skip

    def stable(self, values: Vector) -> bool:
        """Return whether the loop is stable at values of the parameters."""
        return is_stable(self.at(values))

    def over(self, box: Box) -> UncertainLoop:
        """Return its linear fractional form over a box.

        Raises:
            BadInput: if the number of states differs within the box.
        """
        return uncertain_loop(box, len(self.scales), self.matrix, self.stable)


def varied_loop(trial: Trial, analysis: Analysis, vary: Vary) -> VariedLoop:
    """Return the loop of an analysis with uncertain parameters.

    Raises:
        BadInput: see uncertain_parameters.
    """
    situation = situation_of(trial, analysis)
    parameters = uncertain_parameters(situation, vary)
    box = box_of(parameters)
    changes = loop_values(parameters, box.centre)
    loop = loop_of(situation.changed(changes).plant, analysis.running.form)
    _, (scales, _) = matrix_balance(loop.closed.a, permute=False, separate=True)
    return VariedLoop(situation, parameters, analysis, np.asarray(scales, dtype=np.float64))


def situation_of(trial: Trial, analysis: Analysis) -> Situation:
    """Return where the plant of an analysis is linear."""
    point = analysis.point
    position = point.rest.model.joint_state(point.rest.state)[0].tolist()
    joints = dict(zip(point.rest.model.joint_names, position, strict=True))
    return Situation(trial, trial.testbed, joints, point.rest, point.path)


def default_vary(trial: Trial) -> Vary:
    """Return the ranges of an analysis: stiffness, and payload where the testbed carries one."""
    try:
        trial.testbed.scaled(payload=1.0 + DEFAULT["payload"])
    except BadInput:
        return {"stiffness": DEFAULT["stiffness"]}
    return DEFAULT


def worst_case_of(
    trial: Trial, analysis: Analysis, vary: Vary | None = None, seconds: float = _SECONDS
) -> WorstCase:
    """Return the worst case of an analysed loop.

    Args:
        trial: that was analysed.
        analysis: of its loop.
        vary: uncertain parameters, see uncertain_parameters; None: see default_vary.
        seconds: for each attempt at a certificate.

    Raises:
        BadInput: if a parameter is not understood, or the loop is not stable, or not at the centre.
    """
    if not analysis.stable:
        raise BadInput("--guarantee: the loop is not stable: nothing can be guaranteed")
    varied = varied_loop(trial, analysis, default_vary(trial) if vary is None else vary)
    box = box_of(varied.parameters)
    if not varied.stable(box.centre):
        raise BadInput("the loop is not stable at the centre of these ranges", key="vary")
    searched = largest_scale(varied.parameters, _LARGEST)
    wide = varied.over(box.scaled(searched))
    found = breakdown(wide)
    unstable = None if found is None else found._replace(scale=found.scale * searched)
    certified, certificate, loop = _largest_certified(varied, box, unstable, seconds)
    gains = _gain_bounds(varied, min(certified, 1.0), seconds) if certified > 0.0 else ()
    return WorstCase(
        analysis.controller, varied.parameters, certified, certificate, unstable, searched, gains,
        loop.form.largest_error, analysis.loop.system.period,
    )  # fmt: skip


def _largest_certified(
    varied: VariedLoop, box: Box, unstable: Breakdown | None, seconds: float
) -> tuple[float, Certificate, UncertainLoop]:
    """Return the largest scale that is certified, 0 if none is, and the last attempt."""
    scales = [1.0] if unstable is None else [share * unstable.scale for share in _TRIES]
    if unstable is not None and unstable.scale > 1.0 / _TRIES[0]:
        scales = sorted({*(s for s in scales if s > 1.0), 1.0, _TRIES[-1]}, reverse=True)
    for scale in scales:
        loop = varied.over(box.scaled(scale))
        certificate = certify(loop, seconds=seconds)
        if certificate.holds:
            return scale, certificate, loop
    return 0.0, certificate, loop


def _gain_bounds(varied: VariedLoop, scale: float, seconds: float) -> tuple[GainBounds, ...]:
    """Return bounds of S and T at the plant's input within a scale of the box."""
    box = box_of(varied.parameters).scaled(scale)
    loop = varied.over(box)
    out = []
    for name, complement in (("S", True), ("T", False)):
        unit = GainLimit(1.0, complement)
        peak = largest_peak(loop, unit)
        bound = np.inf
        for factor in _GAIN_TRIES:
            gain = GainLimit(factor * peak.size, complement)
            if certify(loop, gain, seconds=_GAIN_SHARE * seconds).holds:
                bound = gain.bound
                break
        nominal = peak_at(loop, np.zeros(len(box.centre)), unit)
        values = loop_values(varied.parameters, loop.box.at(peak.delta))
        out.append(GainBounds(name, nominal, peak.size, bound, values))
    return tuple(out)
