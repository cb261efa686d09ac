"""A worst case as tables and figures: for the page of an analysis and for a terminal."""

import numpy as np

from flexslew_lab.guarantee.certificate import GainLimit, channels_of, structure
from flexslew_lab.guarantee.flight import Guarantee
from flexslew_lab.guarantee.frequency_cover import peak
from flexslew_lab.guarantee.parameters import loop_values
from flexslew_lab.guarantee.response import grid_of, response_at, sample_points, sizes
from flexslew_lab.guarantee.varied_loop import VariedLoop
from flexslew_lab.guarantee.worst_case import WorstCase
from flexslew_lab.report.panels import Group, Panel, legend, style
from flexslew_lab.report.sections import Section, Table
from flexslew_lab.short_values import in_columns
from flexslew_plant.arrays import Vector

WORST_COLUMNS = ("parameter", "low", "high", "unstable at")
_CURVE = 24  # frequencies of the curve of mu
_TOP, _BOTTOM = 60.0, -60.0  # of the band [dB]


def worst_rows(found: WorstCase) -> list[tuple[str, ...]]:
    """Return a row for each parameter."""
    unstable = found.unstable
    values = {} if unstable is None else loop_values(found.parameters, unstable.values)
    return [
        (p.name, f"{p.low:.5g}", f"{p.high:.5g}", f"{values[p.name]:.6g}" if values else "-")
        for p in found.parameters
    ]


def worst_case_sections(guarantee: Guarantee) -> list[Section]:
    """Return the tables, the curve of mu and the band of S of a worst case."""
    found, verdict = guarantee.found, guarantee.verdict
    words = (
        f"{verdict[0].upper()}{verdict[1:]}. Certified in {len(found.certificate.parts)} parts of "
        f"the box, and checked at {found.certificate.checked} points by other means."
    )
    gains = in_columns(
        (g.name, g.nominal, g.found, "-" if np.isinf(g.bound) else g.bound) for g in found.gains
    )
    bounds = "Peaks at the plant's input over all parameters within the certified part of the box."
    sections: list[Section] = [
        Table("Guarantee", words, WORST_COLUMNS, worst_rows(found)),
        Table("Worst-case gains", bounds, ("peak of", "centre", "found", "none above"), gains),
    ]
    if found.certified > 0.0:
        sections += _figures(found, guarantee.varied)
    return sections


def _figures(found: WorstCase, varied: VariedLoop) -> list[Section]:
    loop = varied.over(found.box)
    channels = channels_of(loop)
    angles = grid_of(channels.a)
    few = angles[np.unique(np.linspace(0, len(angles) - 1, _CURVE).astype(int))]
    blocks = structure(loop)
    mu = np.array([peak(channels, blocks, float(angle)) for angle in few])
    panel = Panel("mu over the ranges", "-", height=200)
    panel.line(few / found.period, mu, "upper bound", style(0))
    if found.unstable is not None:
        w, value = np.array([found.frequency]), np.array([1.0 / found.unstable.scale])
        panel.line(w, value, "lower bound", {"color": "#c2375f"}, mode="markers")
    panel.limits = (1.0,)
    _over_frequency(panel, few / found.period)
    names = ["upper bound"] + ["lower bound"] * (found.unstable is not None)
    words = (
        "Below one: every loop within the ranges is stable at this frequency. The upper bound is "
        "that of the undivided box; the lower bound is the nearest unstable loop."
    )
    return [Group("Structured singular value", words, [panel], legend(names)), _band(found, varied)]


def _band(found: WorstCase, varied: VariedLoop) -> Group:
    """Return S of the loops in the certified part of the box, and its certified bound."""
    loop = varied.over(found.box.scaled(min(found.certified, 1.0)))
    gain = GainLimit(1.0, complement=True)
    nominal = response_at(loop, np.zeros(len(found.parameters)), gain)
    angles = grid_of(nominal.a)
    curves = [sizes(response_at(loop, delta, gain), angles) for delta in sample_points(loop)]
    panel, w = Panel("S at the plant's input", "dB", height=240), angles / found.period
    panel.line(w, _decibels(curves[0]), "centre", style(0))
    panel.line(w, _decibels(np.max(curves, axis=0)), "largest found", style(1))
    names = ["centre", "largest found"]
    bound = next((g.bound for g in found.gains if g.name == "S"), np.inf)
    if np.isfinite(bound):
        names.append("none above")
        panel.line(w, _decibels(np.full(len(w), bound)), names[-1], style(2))
    panel.y_range = (_BOTTOM, _TOP)
    _over_frequency(panel, w)
    words = "Largest singular values; the bound holds at every frequency."
    return Group("Worst-case band", words, [panel], legend(names))


def _decibels(values: Vector) -> Vector:
    return np.asarray(20.0 * np.log10(np.maximum(values, 1e-12)))


def _over_frequency(panel: Panel, w: Vector) -> None:
    panel.x_title, panel.x_log = "frequency [rad/s]", True
    panel.x_range = (float(np.log10(w[0])), float(np.log10(w[-1])))
