"""The page of an analysis: tables, then curves, drawn by the report's own panels."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from flexslew_control.analysis.loop_margins import ChannelMargins
from flexslew_lab.analysis.analysis import Analysis, residual_curve, responses
from flexslew_lab.analysis.proof import Proof
from flexslew_lab.analysis.proof_tables import proof_tables
from flexslew_lab.report.panels import Group, Panel, decibels, legend, style
from flexslew_lab.report.sections import Section, Table, page_of_sections
from flexslew_lab.short_values import in_columns
from flexslew_plant.arrays import Vector

_MOST_TICKS = 4000  # of a response
_DECAY_LEVEL = 0.02  # of a pole's part at the end of a response
_MAX_POINTS = 2000  # points of a curve


def analysis_page(
    analysis: Analysis, name: str, proof: Proof | None = None, more: Sequence[Section] = ()
) -> str:
    """Return the analysis of a trial, and its proof, as HTML that needs nothing else.

    Args:
        analysis: of the trial.
        name: of the trial.
        proof: of its margins, or None.
        more: further sections, before the curves.
    """
    rest = analysis.point.rest
    position_text = ", ".join(f"{joint} {at:.4g}" for joint, at in rest.joints.items())
    sections: list[Section] = [
        *tables(analysis),
        *(proof_tables(proof) if proof is not None else ()),
        *more,
    ]
    sections += [_bode(analysis), _plane("Nyquist", analysis), _plane("Nichols", analysis),
                 _singular(analysis), _steps(analysis)]  # fmt: skip
    if analysis.plan is not None:
        sections.append(_residual(analysis))
    words = analysis.verdict
    if not analysis.stable:
        words = words.replace(analysis.statement, analysis.statement.upper(), 1)
    description = f"{analysis.law} about the rest at {position_text}, at {rest.time:g} s"
    title = f"{name}: {analysis.controller}"
    return page_of_sections("analysis", title, description, sections, words)


def tables(analysis: Analysis) -> list[Table]:
    """Return the tables of the numbers in the order of the questions."""
    found = [_modes(analysis), _poles(analysis)]
    if not analysis.stable:
        return found
    found.append(_margins("Margins at the plant's input", analysis.efforts))
    found.append(_margins("Margins at the plant's output", analysis.sensors))
    disks = [
        [place, d.alpha, 20.0 * np.log10(d.gain), np.degrees(d.phase), d.frequency]
        for place, d in analysis.disks.items()
    ]  # fmt: skip
    found.append(
        Table(
            "Disk margins",
            "All channels of the place change at once, each by its own gain and phase. The bounds "
            "are guaranteed.",
            ("place", "alpha", "gain +- [dB]", "phase +- [deg]", "at [rad/s]"),
            in_columns(disks),
        )
    )
    peaks = in_columns((place, s, t) for place, (s, t) in analysis.peaks.items())
    words = "Largest singular values of sensitivity and complementary sensitivity."
    found.append(Table("Peaks of S and T", words, ("place", "S", "T"), peaks))
    if analysis.others:
        rows = in_columns(
            (f"{o.stiffness:g}, {o.payload:g}", "yes" if o.stable else "NO", o.alpha, o.delay)
            for o in analysis.others
        )
        head = ("stiffness, payload", "stable", "disk margin", "delay margin [s]")
        words = "Factors on the plant, the law as it is."
        found.append(Table("Plants that differ from the design model", words, head, rows))
    return found


def _modes(analysis: Analysis) -> Table:
    modes = analysis.modes
    shape, actuation = (list(getattr(modes[0], key)) if modes else [] for key in ("shape", "moved"))
    seen = list(modes[0].seen) if modes else []
    rows = in_columns(
        [m.frequency, m.damping if abs(m.damping) > 1e-12 else 0.0,
         *(f"{m.shape[key]:+.3f}" for key in shape), *(f"{m.moved[key]:.3f}" for key in actuation),
         *(f"{m.seen[key]:.3f}" for key in seen)]
        for m in modes
    )  # fmt: skip
    columns = (
        "frequency [rad/s]", "damping [-]", *(f"shape: {key}" for key in shape),
        *(f"moved by {key}" for key in actuation), *(f"seen by {key}" for key in seen),
    )  # fmt: skip
    words = (
        "Of the plant alone. Moved and seen: of the mode that this actuator moves most, or this "
        "sensor sees most."
    )
    return Table("Natural modes", words, columns, rows)


def _poles(analysis: Analysis) -> Table:
    rows = in_columns(
        (p.frequency, p.damping, f"{p.z[0]:.7f} {p.z[1]:+.7f}j", p.strength) for p in analysis.poles
    )
    words = f"The law has {len(analysis.running.form.a)} states of its own."
    return Table(
        "Poles of the closed loop", words,
        ("frequency [rad/s]", "damping [-]", "z", "strength [-]"), rows,
    )  # fmt: skip


def _margins(title: str, channels: tuple[ChannelMargins, ...]) -> Table:
    rows = in_columns(
        (c.name, c.gain_up, c.up_frequency, c.gain_down, np.degrees(c.phase), c.phase_frequency,
         c.delay, c.delay_frequency, ", ".join(f"{w:.4g}" for w in c.crossovers[:8]))
        for c in channels
    )  # fmt: skip
    columns = ("channel", "gain up to", "at [rad/s]", "gain down to", "phase [deg]", "at [rad/s]",
               "delay [s]", "at [rad/s]", "crossovers [rad/s]")  # fmt: skip
    return Table(title, "One channel changes, all others are closed.", columns, rows)


def _number(value: float) -> str:
    return "-" if not np.isfinite(value) else f"{value:.5g}"


def _select_points(analysis: Analysis) -> Vector:
    """Return which points of the sweep are drawn."""
    count = len(analysis.sweep.grid)
    return np.unique(np.linspace(0, count - 1, min(count, _MAX_POINTS)).astype(int))


def _bode(analysis: Analysis) -> Group:
    rows, names = _select_points(analysis), analysis.loop.effort_names
    w = analysis.sweep.grid[rows]
    size, phase = Panel("gain of L", "dB", height=220), Panel("phase of L", "deg", height=180)
    for k, name in enumerate(names):
        value = analysis.sweep.gain((name,))[rows, 0, 0]
        size.line(w, decibels(abs(value)), name, style(k))
        phase.line(w, np.degrees(np.unwrap(np.angle(value))), name, style(k))
    for panel in (size, phase):
        panel.over_frequency(w)
    size.limits = (0.0,)
    words = "Each effort's loop, the others closed; a margin is a distance from -1."
    return Group("Bode", words, [size, phase], legend(names))


def _plane(kind: str, analysis: Analysis) -> Group:
    rows, names = _select_points(analysis), analysis.loop.effort_names
    nyquist = kind == "Nyquist"
    panel = Panel("L", "imaginary" if nyquist else "dB", height=420)
    panel.x_title = "real" if nyquist else "phase [deg]"
    panel.x_range = (-3.0, 1.5) if nyquist else (-360.0, 0.0)
    panel.y_range = (-2.0, 2.0) if nyquist else (-40.0, 40.0)
    for k, name in enumerate(names):
        value = analysis.sweep.gain((name,))[rows, 0, 0]
        if nyquist:
            panel.line(value.real, value.imag, name, style(k))
        else:
            phase = np.degrees(np.angle(value)) % -360.0
            phase[np.append(False, abs(np.diff(phase)) > 180.0)] = np.nan
            panel.line(np.asarray(phase), decibels(abs(value)), name, style(k))
    mark = (-1.0, 0.0) if nyquist else (-180.0, 0.0)
    panel.line(np.array(mark[:1]), np.array(mark[1:]), "-1", {"color": "#c2375f"}, mode="markers")
    return Group(kind, "Each effort's loop, the others closed.", [panel], legend(names))


def _singular(analysis: Analysis) -> Group:
    rows, names = _select_points(analysis), analysis.loop.effort_names
    w, gain = analysis.sweep.grid[rows], analysis.sweep.gain(names)[rows]
    s = np.linalg.inv(np.eye(len(names)) + gain)
    panel = Panel("singular values at the plant's input", "dB", height=240)
    matrices = (("L", gain), ("S", s), ("T", np.eye(len(names)) - s))
    for k, (name, value) in enumerate(matrices):
        sizes = np.linalg.svd(value, compute_uv=False)
        for column in (0, -1):
            panel.line(w, decibels(sizes[:, column]), name, style(k))
    panel.over_frequency(w)
    panel.limits, panel.y_range = (0.0,), (-80.0, 60.0)
    words = "Largest and smallest of the loop, its sensitivity and its complement."
    return Group("Singular values", words, [panel], legend([name for name, _ in matrices]))


def _steps(analysis: Analysis) -> Group:
    if not analysis.stable:
        return Group("Steps", "", [])
    period = analysis.loop.system.period
    slow = [
        p.frequency * p.damping for p in analysis.poles if p.damping > 0.0 and p.strength > 0.01
    ]
    ticks = int(np.clip(-np.log(_DECAY_LEVEL) / min(slow, default=1.0) / period, 100, _MOST_TICKS))
    time, names = period * np.arange(ticks), analysis.loop.sensor_names
    panels = []
    for name, answer in responses(analysis, ticks).items():
        panel = Panel(f"step of {name}", "", height=170)
        panel.x_title, panel.x_range = "time [s]", (0.0, float(time[-1]))
        for k, sensor in enumerate(names):
            panel.line(np.asarray(time, dtype=np.float64), answer[:, k], sensor, style(k))
        panels.append(panel)
    words = "One rad or m of a reference, or one N m or N that disturbs, limits off."
    return Group("Steps", words, panels, legend(names))


def _residual(analysis: Analysis) -> Group:
    plan, modes = analysis.plan, analysis.modes
    assert plan is not None
    top = 2.0 * max((mode.frequency for mode in modes), default=10.0)
    w = np.geomspace(0.01 * top, top, 800)
    curves, has_feedforward = residual_curve(plan, w)
    panel = Panel("residual amplitude of an oscillator", "-", log=True, height=220)
    for k, (name, curve) in enumerate(curves.items()):
        panel.line(w, np.maximum(curve, 1e-6), name, style(k))
    panel.y_range = (1e-4, 1.0)
    panel.over_frequency(w)
    what = "feedforward" if has_feedforward else "acceleration of the reference"
    frequencies = ", ".join(f"{mode.frequency:.4g}" for mode in modes)
    words = (
        f"Of the plan's {what}, for an oscillator of every frequency, relative to the "
        f"largest residual of the same effort. The plant's own: {frequencies} rad/s."
    )
    return Group("Residual over frequency", words, [panel], legend(list(curves)))


def summary_rows(analysis: Analysis) -> list[tuple[Any, ...]]:
    """Return the few lines that a terminal shows."""
    rows: list[tuple[Any, ...]] = [
        ("stable", "yes" if analysis.stable else f"NO: {analysis.statement}")
    ]
    for c in analysis.efforts:
        rows.append((f"{c.name}: gain", f"{_number(c.gain_down)} to {_number(c.gain_up)}"))
        rows.append((f"{c.name}: phase [deg]", _number(np.degrees(c.phase))))
        rows.append((f"{c.name}: delay [s]", _number(c.delay)))
    rows += [(f"disk margin, {place}", _number(d.alpha)) for place, d in analysis.disks.items()]
    rows += [(f"peaks of S, T at {place}", f"{_number(s)}, {_number(t)}")
             for place, (s, t) in analysis.peaks.items()]  # fmt: skip
    if analysis.worst is not None:
        w = analysis.worst
        where = f"stiffness {w.stiffness:g}, payload {w.payload:g}"
        rows.append(("worst disk margin, input", f"{_number(w.alpha)} at {where}"))
    return rows
