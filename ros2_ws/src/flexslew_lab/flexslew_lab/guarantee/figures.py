"""A worst case as figures: mu over frequency with both bounds, and the bands of the responses."""

from time import thread_time

import numpy as np

from flexslew_lab.guarantee.deadline import OutOfTimeError
from flexslew_lab.guarantee.model.uncertain_loop import (
    GainLimit,
    UncertainLoop,
    channels_of,
    structure,
)
from flexslew_lab.guarantee.model.varied_loop import VariedLoop
from flexslew_lab.guarantee.response import grid_of, sample_points, sizes
from flexslew_lab.guarantee.scalings.frequency_cover import peak
from flexslew_lab.guarantee.scalings.multipliers import MOST_UNKNOWNS
from flexslew_lab.guarantee.worst_case import RESPONSES, DisturbanceResponse, WorstCase
from flexslew_lab.report.panels import Group, Panel, decibels, legend, style
from flexslew_lab.report.sections import Section
from flexslew_plant.arrays import Matrix

_CURVE, _SECONDS = 24, 8.0  # most frequencies of the curve of mu, and its time [s]
_RAY = 80  # points from the centre to the side of the box
_TOP, _BOTTOM = 60.0, -120.0  # of the bands [dB]


def worst_case_figures(found: WorstCase, varied: VariedLoop) -> list[Section]:
    """Return the curve of mu and the bands of the responses of a certified worst case."""
    return [*_mu(found, varied), *_bands(found, varied)]


def upper_bounds(loop: UncertainLoop) -> Matrix:
    """Return angles [rad] and upper bounds of mu there, shape (2, k), over the loop's box.

    After `_SECONDS` no frequency is added; those that are done are spread evenly. None are done
    where the scalings are too many.
    """
    channels, blocks, end = channels_of(loop), structure(loop), thread_time() + _SECONDS
    if blocks.unknowns > MOST_UNKNOWNS:
        return np.zeros((2, 0))
    angles = grid_of(channels.a)
    few = angles[np.unique(np.linspace(0, len(angles) - 1, _CURVE).astype(int))]
    done: list[tuple[float, float]] = []
    for k in sorted(range(len(few)), key=lambda k: bin(k)[:1:-1]):  # halves, then quarters, ...
        try:
            done.append((float(few[k]), peak(channels, blocks, float(few[k]), 0.05, end)))
        except OutOfTimeError:
            break
    return np.array(sorted(done)).reshape(-1, 2).T


def lower_bounds(loop: UncertainLoop, scale: float) -> Matrix:
    """Return angles [rad] and lower bounds of mu, shape (2, k): loops with a pole on the circle.

    On rays from the centre to the side of the box, the first of a few points that is not stable.

    Args:
        loop: over a box about the same centre as the ranges.
        scale: of this box, of the ranges.
    """
    steps, found, end = np.linspace(0.0, 1.0, _RAY + 1), [], thread_time() + _SECONDS
    for ray in sample_points(loop)[1:]:
        if thread_time() > end:
            break
        side = ray / abs(ray).max()
        z = loop.fit.poles(steps[:, None] * side)
        outside = np.flatnonzero(abs(z).max(axis=1) > 1.0)
        if outside.size:
            first = z[outside[0]]
            angle = abs(np.angle(first[np.argmax(abs(first))]))
            found.append((float(angle), 1.0 / (scale * steps[outside[0]])))
    return np.array(sorted(found)).reshape(-1, 2).T


def _mu(found: WorstCase, varied: VariedLoop) -> list[Group]:
    angle, upper = upper_bounds(varied.over(found.box))
    panel = Panel("mu over the ranges", "-", height=200)
    names = list[str]()
    if angle.size:
        panel.line(angle / found.period, upper, "upper bound at this frequency", style(0))
        names.append("upper bound at this frequency")
    w, lower = lower_bounds(varied.over(found.box.scaled(found.searched)), found.searched)
    if found.unstable is not None:
        w, lower = np.append(w, found.unstable.angle), np.append(lower, 1.0 / found.unstable.scale)
    if w.size:
        panel.line(w / found.period, lower, "lower bound", style(1), mode="markers")
        names.append("lower bound")
    if found.certified > 0.0 and angle.size:
        everywhere = np.full(angle.size, 1.0 / found.certified)
        panel.line(angle / found.period, everywhere, "upper bound at all frequencies", style(2))
        names.append("upper bound at all frequencies")
    panel.limits = (1.0,)
    if not (angle.size or w.size):
        return []
    panel.over_frequency(np.sort(np.append(angle, w)) / found.period)
    words = (
        "Below one: every loop within the ranges is stable at this frequency. Mu of real "
        "parameters jumps where a loop has a pole on the circle, also between the frequencies of "
        "the curve; the line of all frequencies bounds it there. The curve is of the undivided "
        "box: where it is above the line, parts of the box decide. Each lower bound is a loop "
        "with a pole at this frequency that is not stable."
    )
    return [Group("Structured singular value", words, [panel], legend(names))]


def _bands(found: WorstCase, varied: VariedLoop) -> list[Group]:
    """Return the responses of loops in the certified part of the box, and their bounds."""
    box = found.box.scaled(min(found.certified, 1.0))
    loops = {pointing: varied.over(box, pointing) for pointing in (False, True)}
    panels: list[Panel] = []
    names: list[str] = []
    for response in RESPONSES:
        panel, own = _band(found, loops[response.pointing], response)
        panels.append(panel)
        names = max(names, own, key=len)
    words = (
        "Largest singular values over frequency, of loops in the certified part of the box. The "
        "worst case is the loop with the largest peak found; the bound holds at every frequency."
    )
    return [Group("Worst-case bands", words, panels, legend(names))]


def _band(
    found: WorstCase, loop: UncertainLoop, response: DisturbanceResponse
) -> tuple[Panel, list[str]]:
    limit = GainLimit(1.0, response.complement)
    points = sample_points(loop)
    responses = [loop.response(loop.box.at(delta), limit) for delta in points]
    angles = grid_of(responses[0].a)
    curves = [sizes(system, angles) for system in responses]
    unit = "dB re 1 rad/(N m)" if response.pointing else "dB"
    panel, w = Panel(f"{response.name} to the efforts' disturbance", unit, height=220), angles
    w = angles / found.period
    lines = [
        ("centre", curves[0]),
        ("largest found", np.max(curves, axis=0)),
        ("smallest found", np.min(curves, axis=0)),
    ]
    gain = next((g for g in found.gains if g.name == response.name), None)
    if gain is not None:
        values = np.array([gain.values[p.name] for p in found.parameters])
        lines.append(("worst case", sizes(loop.response(values, limit), angles)))
        if np.isfinite(gain.bound):
            lines.append(("none above", np.full(len(w), gain.bound)))
    for k, (name, values) in enumerate(lines):
        panel.line(w, decibels(values), name, style(k))
    panel.y_range = (_BOTTOM if response.pointing else -_TOP, _TOP)
    panel.over_frequency(w)
    return panel, [name for name, _ in lines]
