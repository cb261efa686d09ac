"""The figures of a report: plotly figures from what `read_run` thinned."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from flexslew_control.plan import Plan
from flexslew_lab.report.run_data import RunData, Trace

INK, GRID, PALE = "#1d2733", "#e4e8ee", "#8a97a8"
COLOURS = ("#0b6bcb", "#e0592a", "#1a9a6c", "#9a4fc4", "#c79100", "#c2375f", "#2aa3b8", "#6b7280")
BRAKE = "#b0b8c4"
_AXIS: dict[str, Any] = {
    "gridcolor": GRID,
    "linecolor": GRID,
    "zeroline": False,
    "automargin": True,
    "title_standoff": 10,
}


def manoeuvre(runs: Sequence[RunData]) -> go.Figure:
    """Return joints with reference, tip deflection and efforts with feedforward over time.

    As Figures 5 and 7 of papers/000, on one time axis; several runs lie over one another.
    """
    first = runs[0]
    joints = len(first.joint_names)
    titles = [f"{name} [{unit}]" for name, unit in _joints(first)]
    titles += ["tip [m]"]
    titles += [f"effort on<br>{name} [{_effort_unit(unit)}]" for name, unit in _joints(first)]
    figure = _stack(titles, heights=[1.0] * joints + [1.0] + [0.85] * joints)
    for number, run in enumerate(runs):
        colour = COLOURS[number % len(COLOURS)]
        group: dict[str, Any] = {"legendgroup": run.label}
        for k, name in enumerate(run.joint_names[:joints]):
            _line(figure, run, "position", k, k + 1, colour, run.label if k == 0 else "", **group)
            if number == 0:
                _dash(figure, run, "reference", k, k + 1, "reference" if k == 0 else "")
            row = joints + 2 + k
            _line(figure, run, "effort", k, row, colour, "", name=f"{run.label}: {name}", **group)
            if number == 0:
                _dash(figure, run, "feedforward", k, row, "feedforward" if k == 0 else "")
            _disturbance(figure, run, k, row, first=k == 0 and number == 0)
        _line(figure, run, "tip", 0, joints + 1, colour, "", **group)
    _mark_manoeuvre(figure, first)
    _mark_limits(figure, first, joints + 2)
    return _finished(figure, 130 * len(titles) + 130)


def charge(run: RunData) -> go.Figure:
    """Return who is in charge when, and the step of the effort at each swap."""
    figure = _stack(["", "effort step"], heights=[0.45, 1.0])
    names = sorted({phase.controller for phase in run.phases})
    for phase in run.phases:
        colour = COLOURS[names.index(phase.controller) % len(COLOURS)]
        label = phase.controller or "brake"
        figure.add_trace(
            go.Bar(
                x=[phase.end - phase.start],
                base=[phase.start],
                y=["in charge"],
                orientation="h",
                marker={"color": colour if phase.controller else BRAKE, "line": {"width": 0}},
                text=[label],
                textposition="inside",
                insidetextanchor="middle",
                textfont={"color": "white"},
                hovertemplate=f"{label}<br>{phase.start:.2f} to {phase.end:.2f} s<extra></extra>",
                showlegend=False,
            ),
            row=1,
            col=1,
        )
    swaps = [e for e in run.overview.events if e.kind == "switched" and isinstance(e.data, dict)]
    for k, (name, unit) in enumerate(_joints(run)):
        steps = [np.atleast_1d(e.data.get("effort_step", [])) for e in swaps]
        found = [(e, float(s[k])) for e, s in zip(swaps, steps, strict=True) if len(s) > k]
        figure.add_trace(
            go.Scatter(
                x=[e.time for e, _ in found],
                y=[step for _, step in found],
                mode="markers",
                name=f"{name} [{_effort_unit(unit)}]",
                marker={"color": COLOURS[k], "size": 11, "symbol": "diamond"},
                text=[e.message for e, _ in found],
                hovertemplate="%{text}<br>t = %{x} s, step %{y:.4g}<extra></extra>",
            ),
            row=2,
            col=1,
        )
    figure.update_layout(barmode="overlay", bargap=0.0)
    figure.update_yaxes(showgrid=False, row=1, col=1)
    figure.add_hline(y=0.0, line={"color": GRID, "width": 1}, row=2, col=1)
    if not swaps:
        figure.add_annotation(
            text="no swap in this run", showarrow=False, font={"color": PALE},
            xref="paper", yref="y2 domain", x=0.5, y=0.5,
        )  # fmt: skip
    _span(figure, run)
    return _finished(figure, 320, unified=False)


def estimation(run: RunData) -> go.Figure | None:
    """Return estimate minus truth, joints and modes; None where no estimate was logged."""
    trace = run.traces.get("estimate_error")
    if trace is None or not trace.value.size:
        return None
    joints = len(run.joint_names)
    modes = trace.value.shape[1] - joints
    figure = _stack([f"joints [{_unit(run)}]"] + (["modes [m]"] if modes > 0 else []))
    for k in range(trace.value.shape[1]):
        name = run.joint_names[k] if k < joints else f"mode {k - joints + 1}"
        _add(figure, trace, k, 1 if k < joints else 2, COLOURS[k % len(COLOURS)], name)
    return _finished(figure, 220 + 150 * (modes > 0))


def effort_terms(run: RunData) -> go.Figure | None:
    """Return the summands of the effort, joint by joint; None where none were logged."""
    if not run.terms:
        return None
    figure = _stack([f"{name} [{_effort_unit(unit)}]" for name, unit in _joints(run)])
    for number, (name, trace) in enumerate(run.terms.items()):
        for k in range(min(trace.value.shape[1], len(run.joint_names))):
            colour = COLOURS[number % len(COLOURS)]
            _add(figure, trace, k, k + 1, colour, name if k == 0 else "", legendgroup=name)
    for k in range(len(run.joint_names)):
        demand = run.traces.get("demand")
        if demand is not None and k < demand.value.shape[1]:
            _dashed(figure, demand, k, k + 1, "their sum, as answered" if k == 0 else "")
    return _finished(figure, 190 * len(run.joint_names) + 110)


def comparison(run: RunData, other: RunData) -> go.Figure:
    """Return error and tip deflection of two runs, with and without feedforward."""
    figure = _stack([f"{n} [{u}]" for n, u in _joints(run)] + ["tip deflection [m]"])
    for one, colour in ((run, COLOURS[0]), (other, COLOURS[1])):
        group: dict[str, Any] = {"legendgroup": one.label}
        for k in range(len(run.joint_names)):
            _line(figure, one, "position", k, k + 1, colour, one.label if k == 0 else "", **group)
        _line(figure, one, "tip", 0, len(run.joint_names) + 1, colour, "", **group)
    for k in range(len(run.joint_names)):
        _dash(figure, run, "reference", k, k + 1, "reference" if k == 0 else "")
    _mark_manoeuvre(figure, run)
    return _finished(figure, 170 * (len(run.joint_names) + 1) + 90)


def plan_figure(plan: Plan) -> go.Figure:
    """Return the reference and the feedforward of a plan over time, joint by joint."""
    joints = plan.joint_names
    titles = [f"{name} reference" for name in joints] + [f"feedforward on<br>{j}" for j in joints]
    figure = _stack(titles)
    time = plan.start + plan.period * np.arange(plan.ticks + 1)
    held = {"line_shape": "hv", "line_color": COLOURS[1]}
    for k, name in enumerate(joints):
        position, effort = plan.position[:, k], plan.effort[:, k]
        figure.add_scatter(x=time, y=position, name=name, row=k + 1, col=1)
        row = len(joints) + k + 1
        figure.add_scatter(x=time[:-1], y=effort, name=f"{name} effort", row=row, col=1, **held)
    figure.update_layout(title_text=f"{plan.method}, {plan.duration:g} s")
    return _finished(figure, 160 * len(titles) + 130)


def _joints(run: RunData) -> list[tuple[str, str]]:
    return list(zip(run.joint_names, run.joint_units, strict=True))


def _unit(run: RunData) -> str:
    return " or ".join(dict.fromkeys(run.joint_units))


def _effort_unit(unit: str) -> str:
    return "N" if unit == "m" else "N m"


def _stack(titles: Sequence[str], heights: Sequence[float] | None = None) -> go.Figure:
    rows = len(titles)
    figure = make_subplots(
        rows=rows,
        cols=1,
        shared_xaxes=True,
        vertical_spacing=0.16 / max(rows, 3),
        row_heights=list(heights) if heights else None,
    )
    for row, title in enumerate(titles, start=1):
        figure.update_yaxes(title_text=title, row=row, col=1)
    figure.update_xaxes(title_text="time [s]", row=rows, col=1)
    return figure


def _line(
    figure: go.Figure, run: RunData, key: str, column: int, row: int, colour: str, legend: str,
    **more: Any,
) -> None:  # fmt: skip
    trace = run.traces.get(key)
    if trace is not None and column < trace.value.shape[1]:
        more.setdefault("name", legend or run.label)
        _add(figure, trace, column, row, colour, legend, **more)


def _add(
    figure: go.Figure, trace: Trace, column: int, row: int, colour: str, legend: str, **more: Any
) -> None:
    more.setdefault("name", legend or more.get("legendgroup", ""))
    figure.add_trace(
        go.Scatter(
            x=trace.time[:, column],
            y=trace.value[:, column].astype(np.float32),
            mode="lines",
            line={"color": colour, "width": 1.6},
            showlegend=bool(legend),
            hovertemplate="%{y:.5g}",
            **more,
        ),
        row=row,
        col=1,
    )


def _dash(figure: go.Figure, run: RunData, key: str, column: int, row: int, legend: str) -> None:
    trace = run.traces.get(key)
    if trace is not None and column < trace.value.shape[1]:
        _dashed(figure, trace, column, row, legend)


def _dashed(figure: go.Figure, trace: Trace, column: int, row: int, legend: str) -> None:
    _add(figure, trace, column, row, INK, legend)
    figure.data[-1].line = {"color": INK, "width": 1.3, "dash": "dot"}


def _disturbance(figure: go.Figure, run: RunData, k: int, row: int, first: bool) -> None:
    trace = run.traces.get("disturbance")
    if trace is not None and k < trace.value.shape[1] and np.any(trace.value[:, k]):
        _add(figure, trace, k, row, COLOURS[3], "disturbance" if first else "")


def _mark_manoeuvre(figure: go.Figure, run: RunData) -> None:
    start, end = run.metrics["manoeuvre_start"], run.metrics["manoeuvre_end"]
    if end > start:
        figure.add_vrect(
            x0=start, x1=end, fillcolor="#0b6bcb", opacity=0.055, line_width=0, row="all", col=1
        )
    for event in run.overview.events:
        if event.kind in ("switched", "fallback", "brake") or event.level == "fault":
            colour = COLOURS[5] if event.level == "fault" else PALE
            figure.add_vline(
                x=event.time, line={"color": colour, "width": 1, "dash": "dash"}, row="all", col=1
            )
    _span(figure, run)


def _span(figure: go.Figure, run: RunData) -> None:
    times = run.traces["effort"].time
    figure.update_xaxes(range=[float(times.min()), float(times.max())])


def _mark_limits(figure: go.Figure, run: RunData, row: int) -> None:
    """Draw the drives' limits where the efforts come near them."""
    testbed = run.overview.testbed
    if testbed is None:
        return
    effort = run.traces["effort"].value
    for k, limit in enumerate(testbed.effort_limit[: effort.shape[1]]):
        if np.nanmax(np.abs(effort[:, k])) > 0.8 * limit:
            for y in (-limit, limit):
                figure.add_hline(
                    y=y, line={"color": COLOURS[5], "width": 1, "dash": "dot"}, row=row + k, col=1
                )


def _finished(figure: go.Figure, height: int, unified: bool = True) -> go.Figure:
    figure.update_xaxes(**_AXIS)
    figure.update_yaxes(**_AXIS)
    figure.update_layout(
        height=height,
        margin={"l": 70, "r": 20, "t": 40, "b": 50},
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor="rgba(0,0,0,0)",
        font={"family": "Inter, system-ui, sans-serif", "size": 12, "color": INK},
        legend={"orientation": "h", "yanchor": "bottom", "y": 1.0, "xanchor": "left", "x": 0.0},
        hovermode="x unified" if unified else "closest",
        modebar={"bgcolor": "rgba(0,0,0,0)", "color": PALE, "activecolor": INK},
    )
    return figure
