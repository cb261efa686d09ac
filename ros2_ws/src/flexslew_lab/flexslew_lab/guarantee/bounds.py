"""Both bounds of a worst case: the nearest unstable loop, and the largest certified box."""

from collections.abc import Sequence
from time import thread_time
from typing import NamedTuple

import numpy as np

from flexslew_lab.analysis.analysis import Analysis
from flexslew_lab.guarantee.box import Box
from flexslew_lab.guarantee.certificate import Certificate, certify
from flexslew_lab.guarantee.model.parameters import Vary, box_of, largest_scale, loop_values
from flexslew_lab.guarantee.model.uncertain_loop import GainLimit, UncertainLoop
from flexslew_lab.guarantee.model.varied_loop import VariedLoop, default_vary, varied_loop
from flexslew_lab.guarantee.response import largest_peak, peak_at
from flexslew_lab.guarantee.search import Breakdown, breakdown
from flexslew_lab.guarantee.worst_case import (
    RESPONSES,
    DisturbanceResponse,
    GainBounds,
    WorstCase,
)
from flexslew_lab.progress import phase
from flexslew_lab.trial.trial import Trial
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput

_LARGEST = 2.0  # scale to which the nearest unstable loop is sought [-]
_TRIES = (0.995, 0.96, 0.91, 0.8, 0.5)  # of its scale, to be certified
_GAIN_TRIES = (1.2, 1.04, 1.01)  # times the largest gain found
SECONDS = 60.0  # of the processor, for all of it
_SEARCH_SHARE, _STABILITY_SHARE = 0.2, 0.7  # of the time: until then at most, from the beginning
_ATTEMPT_SHARE = 0.6  # of the time that is left, for one attempt
_PEAK_SHARE = 0.3  # of a gain's time, for its largest peak
_LONGER, _LEAST_GAIN = 5.0, 2.0  # times the last try, or so long [s], a smaller bound is tried


def worst_case_of(
    trial: Trial,
    analysis: Analysis,
    vary: Vary | None = None,
    seconds: float = SECONDS,
    responses: Sequence[DisturbanceResponse] = RESPONSES,
) -> WorstCase:
    """Return the worst case of an analysed loop.

    Args:
        trial: that was analysed.
        analysis: of its loop.
        vary: uncertain parameters, see uncertain_parameters; None: see default_vary.
        seconds: of the processor for all of it.
        responses: whose peaks are bounded.

    Raises:
        BadInput: if a parameter is not understood, or the loop is not stable, or not at the centre.
    """
    if not analysis.stable:
        raise BadInput("--guarantee: the loop is not stable: nothing can be guaranteed")
    start = thread_time()
    varied = varied_loop(trial, analysis, default_vary(trial) if vary is None else vary)
    box = box_of(varied.parameters)
    if not varied.stable(box.centre):
        raise BadInput("the loop is not stable at the centre of these ranges", key="vary")
    searched = largest_scale(varied.parameters, _LARGEST)
    wide, whole = varied.over(box.scaled(searched)), varied.over(box)
    with phase("searching for an unstable loop"):
        unstable = _nearest(wide, box, start + _SEARCH_SHARE * seconds)
    proof = _Proof(varied, wide, whole, start + _STABILITY_SHARE * seconds)
    certified, certificate, unstable = proof.certified(unstable)
    gains: tuple[GainBounds, ...] = ()
    if certified > 0.0:
        gains = _gain_bounds(varied, min(certified, 1.0), start + seconds, responses)
    return WorstCase(
        analysis.controller, varied.parameters, certified, certificate, unstable, searched, gains,
        whole.fit.quality, analysis.loop.system.period,
    )  # fmt: skip


def _nearest(
    wide: UncertainLoop, box: Box, end: float, start: Vector | None = None
) -> Breakdown | None:
    """Return the nearest unstable loop within a wide box, its scale of a box about its centre."""
    found = breakdown(wide, start, end=end)
    scale = float((wide.box.radius / box.radius)[0])
    return None if found is None else found._replace(scale=found.scale * scale)


class _Proof(NamedTuple):
    """Attempts to certify scales of a box.

    Args:
        varied: loop.
        wide: over the largest box that is searched.
        whole: over the ranges.
        end: of all attempts, as time.thread_time counts [s].
    """

    varied: VariedLoop
    wide: UncertainLoop
    whole: UncertainLoop
    end: float

    def attempt(self, scale: float) -> Certificate:
        """Return the certificate of a scale, or how far it has come."""
        seconds = _ATTEMPT_SHARE * (self.end - thread_time())
        if seconds <= 0.0:
            return Certificate((), ended="no time")
        loop = self.whole if scale == 1.0 else self.varied.over(self.whole.box.scaled(scale))
        with phase(f"certifying {scale:.3g} times the ranges"):
            return certify(loop, seconds=seconds)

    def certified(self, unstable: Breakdown | None) -> tuple[float, Certificate, Breakdown | None]:
        """Return the largest scale that is certified, 0: none, and the nearest unstable loop.

        The ranges themselves come first. Where they hold, larger ones follow, else smaller ones. A
        loop that is not stable, and that the search has not found, begins another search.
        """
        edge = np.inf if unstable is None else unstable.scale
        first = 1.0 if edge > 1.0 else _TRIES[0] * edge
        certificate = self.attempt(first)
        if certificate.unstable is not None:
            nearer = _nearest(self.wide, self.whole.box, self.end, certificate.unstable)
            if nearer is not None and nearer.scale < edge:
                return self.certified(nearer)
        holds = certificate.holds
        scales = [share * edge for share in _TRIES] if edge < np.inf else [*_TRIES[3:]]
        for scale in scales if edge < np.inf or not holds else []:
            if (scale > first) if holds else (scale < first):
                other = self.attempt(scale)
                if other.holds:
                    return scale, other, unstable
        return (first if holds else 0.0), certificate, unstable


def _gain_bounds(
    varied: VariedLoop, scale: float, end: float, responses: Sequence[DisturbanceResponse]
) -> tuple[GainBounds, ...]:
    """Return bounds of the responses at the plant's input within a scale of the box.

    Each response has an even share of the time that is left.
    """
    box = box_of(varied.parameters).scaled(scale)
    loops = {pointing: varied.over(box, pointing) for pointing in (False, True)}
    out = []
    for number, response in enumerate(responses):
        seconds = max(end - thread_time(), 0.0) / (len(responses) - number)
        with phase(f"bounding {response.name}"):
            out.append(_gain_bound(varied, loops[response.pointing], response, seconds))
    return tuple(out)


def _gain_bound(
    varied: VariedLoop, loop: UncertainLoop, response: DisturbanceResponse, seconds: float
) -> GainBounds:
    end, unit = thread_time() + seconds, GainLimit(1.0, response.complement)
    peak = largest_peak(loop, unit, thread_time() + _PEAK_SHARE * seconds)
    bound, most = np.inf, seconds
    for factor in _GAIN_TRIES:
        begin, gain = thread_time(), GainLimit(factor * peak.size, response.complement)
        left = min(end - begin, most)
        if left <= 0.0 or not certify(loop, gain, seconds=left).holds:
            break
        bound, most = gain.bound, max(_LONGER * (thread_time() - begin), _LEAST_GAIN)
    nominal = peak_at(loop, np.zeros(len(loop.box.centre)), unit)
    values = loop_values(varied.parameters, loop.box.at(peak.delta))
    return GainBounds(response.name, nominal, peak.size, bound, values)
