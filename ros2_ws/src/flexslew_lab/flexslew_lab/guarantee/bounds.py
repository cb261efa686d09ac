"""Both bounds of a worst case: the nearest unstable loop, and the largest certified box."""

from time import thread_time

import numpy as np

from flexslew_lab.analysis.analysis import Analysis
from flexslew_lab.guarantee.box import Box
from flexslew_lab.guarantee.certificate import Certificate, GainLimit, UncertainLoop, certify
from flexslew_lab.guarantee.parameters import Vary, box_of, largest_scale, loop_values
from flexslew_lab.guarantee.response import largest_peak, peak_at
from flexslew_lab.guarantee.search import Breakdown, breakdown
from flexslew_lab.guarantee.varied_loop import VariedLoop, default_vary, varied_loop
from flexslew_lab.guarantee.worst_case import RESPONSES, GainBounds, WorstCase
from flexslew_lab.trial.trial import Trial
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput

_LARGEST = 2.0  # scale to which the nearest unstable loop is sought [-]
_TRIES = (0.995, 0.96, 0.91, 0.8, 0.5)  # of its scale, to be certified
_GAIN_TRIES = (1.2, 1.04, 1.01)  # times the largest gain found
_SECONDS = 60.0  # of all attempts
_ATTEMPT_SHARE, _LEAST_SECONDS = 0.6, 2.0  # of the time that is left, for one attempt
_GAIN_SHARE, _LEAST_GAIN = 0.12, 0.1  # of the time, for a gain; of that, to try once more


def worst_case_of(
    trial: Trial, analysis: Analysis, vary: Vary | None = None, seconds: float = _SECONDS
) -> WorstCase:
    """Return the worst case of an analysed loop.

    Args:
        trial: that was analysed.
        analysis: of its loop.
        vary: uncertain parameters, see uncertain_parameters; None: see default_vary.
        seconds: for the certificates of stability.

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
    wide, end = varied.over(box.scaled(searched)), thread_time() + seconds
    unstable = _nearest(wide, box)
    certified, certificate, unstable = _certified(varied, wide, unstable, end)
    gains = _gain_bounds(varied, min(certified, 1.0), seconds) if certified > 0.0 else ()
    return WorstCase(
        analysis.controller, varied.parameters, certified, certificate, unstable, searched, gains,
        varied.over(box).fit.error, analysis.loop.system.period,
    )  # fmt: skip


def _nearest(wide: UncertainLoop, box: Box, start: Vector | None = None) -> Breakdown | None:
    """Return the nearest unstable loop within a wide box, its scale of a box about its centre."""
    found = breakdown(wide, start)
    scale = float((wide.box.radius / box.radius)[0])
    return None if found is None else found._replace(scale=found.scale * scale)


def _certified(
    varied: VariedLoop, wide: UncertainLoop, unstable: Breakdown | None, end: float
) -> tuple[float, Certificate, Breakdown | None]:
    """Return the largest scale that is certified, 0 if none is, and the nearest unstable loop.

    The ranges themselves come first. Where they hold, larger ones follow, else smaller ones. A
    loop that is not stable, and that the search has not found, begins another search.
    """
    box = box_of(varied.parameters)

    def attempt(scale: float) -> Certificate:
        seconds = max(_ATTEMPT_SHARE * (end - thread_time()), _LEAST_SECONDS)
        return certify(varied.over(box.scaled(scale)), seconds=seconds)

    edge = np.inf if unstable is None else unstable.scale
    first = 1.0 if edge > 1.0 else _TRIES[0] * edge
    certificate = attempt(first)
    if certificate.unstable is not None:
        nearer = _nearest(wide, box, certificate.unstable)
        if nearer is not None and nearer.scale < edge:
            return _certified(varied, wide, nearer, end)
    holds = certificate.holds
    scales = [share * edge for share in _TRIES] if edge < np.inf else [] if holds else [*_TRIES[3:]]
    for scale in scales:
        if (scale > first) if holds else (scale < first):
            other = attempt(scale)
            if other.holds:
                return scale, other, unstable
    return (first if holds else 0.0), certificate, unstable


def _gain_bounds(varied: VariedLoop, scale: float, seconds: float) -> tuple[GainBounds, ...]:
    """Return bounds of the responses at the plant's input within a scale of the box."""
    box = box_of(varied.parameters).scaled(scale)
    loops = {pointing: varied.over(box, pointing) for pointing in (False, True)}
    out = []
    for response in RESPONSES:
        loop = loops[response.pointing]
        unit = GainLimit(1.0, response.complement)
        peak = largest_peak(loop, unit)
        bound, most = np.inf, _GAIN_SHARE * seconds
        end = thread_time() + most
        for factor in _GAIN_TRIES:
            gain, left = GainLimit(factor * peak.size, response.complement), end - thread_time()
            if left < _LEAST_GAIN * most or not certify(loop, gain, seconds=left).holds:
                break
            bound = gain.bound
        nominal = peak_at(loop, np.zeros(len(box.centre)), unit)
        values = loop_values(varied.parameters, loop.box.at(peak.delta))
        out.append(GainBounds(response.name, nominal, peak.size, bound, values))
    return tuple(out)
