"""The page of a comparison: one HTML file with table, curves and plans."""

from typing import Any

import jinja2
import numpy as np
import plotly.graph_objects as go
from plotly.offline import get_plotlyjs
from plotly.subplots import make_subplots

from flexslew_lab.report.compare import Comparison, Entry
from flexslew_lab.report.figures import COLOURS, GRID, INK

_DASHES = ("solid", "dash", "dot")  # told apart where the colours run out
_AXIS: dict[str, Any] = {"gridcolor": GRID, "linecolor": GRID, "zeroline": False}


def comparison_page(comparison: Comparison) -> str:
    """Return the comparison as HTML that needs nothing else."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("flexslew_lab.report", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    trial = comparison.trial
    plan = comparison.entries[0].plan
    goal = {} if plan is None else dict(zip(plan.joint_names, plan.position[-1], strict=True))
    units = dict(zip(comparison.joint_names, comparison.joint_units, strict=True))
    drawn = {
        "robustness": robustness(comparison),
        "cost": cost(comparison),
        "motion": motion(comparison),
    }
    return environment.get_template("compare.html.j2").render(
        title=trial.name,
        goal=", ".join(f"{name} {at:.4g} {units[name]}" for name, at in goal.items()),
        testbed=f"{trial.testbed.kind}, {trial.testbed.modes} modes, {trial.active} in charge",
        bound=f"{comparison.lower_bound:.3f}",
        columns=_columns(comparison),
        rows=[_cells(comparison, entry) for entry in comparison.flown],
        refused=[(entry.name, entry.refused) for entry in comparison.entries if entry.refused],
        colours=_styles(comparison),
        figures={
            name: figure.to_html(full_html=False, include_plotlyjs=False)
            for name, figure in drawn.items()
        },
        plotly=get_plotlyjs(),
    )


def robustness(comparison: Comparison) -> go.Figure:
    """Return the residual tip deflection against stiffness and payload, method by method."""
    payload = any(len(entry.by_payload) > 1 for entry in comparison.flown)
    figure = make_subplots(rows=1, cols=1 + payload, shared_yaxes=True, horizontal_spacing=0.04)
    for entry, style in zip(comparison.flown, _lines(comparison), strict=True):
        curves = [[(flight.error, flight.residual_tip) for flight in entry.by_stiffness]]
        if payload:
            curves.append([(flight.payload, flight.residual_tip) for flight in entry.by_payload])
        for column, curve in enumerate(curves, start=1):
            figure.add_trace(
                go.Scatter(
                    x=[100.0 * error for error, _ in curve],
                    y=[left for _, left in curve],
                    mode="lines+markers",
                    name=entry.name,
                    legendgroup=entry.name,
                    showlegend=column == 1,
                    line=style,
                    hovertemplate="%{x:+g} %: %{y:.4g} m",
                ),
                row=1,
                col=column,
            )
    figure.update_xaxes(ticksuffix=" %")
    figure.update_xaxes(title_text="error of the stiffness", col=1)
    if payload:
        figure.update_xaxes(title_text="error of the hub's inertias", col=2)
    figure.update_yaxes(type="log")
    figure.update_yaxes(title_text="residual tip deflection [m]", col=1)
    return _finished(figure, 440)


def cost(comparison: Comparison) -> go.Figure:
    """Return the worst residual against the duration, with the rigid-body lower bound."""
    figure = go.Figure()
    timed = [e for e in comparison.flown if e.plan is not None and e.plan.duration > 0.0]
    timed.sort(key=lambda entry: entry.worst_residual)
    styles = {e.name: s for e, s in zip(comparison.flown, _lines(comparison), strict=True)}
    for number, entry in enumerate(timed):
        assert entry.plan is not None
        figure.add_trace(
            go.Scatter(
                x=[entry.plan.duration],
                y=[entry.worst_residual],
                mode="markers+text",
                name=entry.name,
                text=[entry.name],
                textposition="middle left" if number % 2 else "middle right",
                marker={"color": styles[entry.name]["color"], "size": 12},
                hovertemplate="%{x:.3f} s, worst %{y:.4g} m",
                showlegend=False,
            )
        )
    figure.add_vline(
        x=comparison.lower_bound,
        line={"color": INK, "width": 1, "dash": "dot"},
        annotation_text="rigid-body bound",
    )
    longest = max((e.plan.duration for e in timed if e.plan is not None), default=1.0)
    figure.update_xaxes(title_text="duration [s]", range=[0.0, 1.35 * longest])
    figure.update_yaxes(title_text="worst residual tip deflection [m]", type="log")
    return _finished(figure, 400)


def motion(comparison: Comparison) -> go.Figure:
    """Return joints, tip deflection and efforts of the nominal flights over time."""
    joints = comparison.joint_names
    linear = [unit == "m" for unit in comparison.joint_units]
    titles = [f"{n} [{u}]" for n, u in zip(joints, comparison.joint_units, strict=True)]
    titles += ["tip [m]"]
    titles += [f"{n} [{'N' if m else 'N m'}]" for n, m in zip(joints, linear, strict=True)]
    figure = make_subplots(
        rows=len(titles), cols=1, shared_xaxes=True, vertical_spacing=0.12 / len(titles)
    )
    for entry, style in zip(comparison.flown, _lines(comparison), strict=True):
        flight = entry.nominal
        curves = [*flight.position.T, flight.tip, *flight.applied.T]
        for row, values in enumerate(curves, start=1):
            figure.add_trace(
                go.Scatter(
                    x=flight.time.astype(np.float32),
                    y=values.astype(np.float32),
                    mode="lines",
                    name=entry.name,
                    legendgroup=entry.name,
                    showlegend=row == 1,
                    line={**style, "width": 1.4},
                    hovertemplate="%{y:.4g}",
                ),
                row=row,
                col=1,
            )
    for row, title in enumerate(titles, start=1):
        figure.update_yaxes(title_text=title, row=row, col=1)
    figure.update_xaxes(title_text="time [s]", row=len(titles), col=1)
    return _finished(figure, 170 * len(titles) + 80)


def _columns(comparison: Comparison) -> list[str]:
    linear = all(unit == "m" for unit in comparison.joint_units)
    torque, joint = ("N", "m") if linear else ("N m", "rad")
    efforts = [f"peak {name} [{torque}]" for name in comparison.joint_names]
    errors = []
    for entry in comparison.flown[:1]:
        errors += [f"tip, EI {f.error:+.0%} [m]" for f in entry.by_stiffness]
        errors += [f"tip, hub {f.payload:+.0%} [m]" for f in entry.by_payload if f.payload]
    head = ["duration [s]", "over bound", "settled [s]", f"joint error [{joint}]"]
    return [*head, *errors, *efforts, f"effort [({torque})² s]"]


def _cells(comparison: Comparison, entry: Entry) -> tuple[str, list[str]]:
    assert entry.plan is not None
    nominal = entry.nominal
    duration = entry.plan.duration
    over = f"{duration / comparison.lower_bound:.2f}" if comparison.lower_bound > 0.0 else "-"
    head = [f"{duration:.3f}", over] if duration > 0.0 else ["step", "-"]
    numbers = [
        f"{nominal.settling_time:.2f}",
        f"{nominal.residual_joint:.2e}",
        *(f"{flight.residual_tip:.4f}" for flight in entry.by_stiffness),
        *(f"{flight.residual_tip:.4f}" for flight in entry.by_payload if flight.payload),
        *(f"{peak:.4g}" for peak in nominal.peak_effort),
        f"{nominal.effort:.4g}",
    ]
    return entry.name, head + numbers


def _lines(comparison: Comparison) -> list[dict[str, Any]]:
    return [
        {"color": COLOURS[k % len(COLOURS)], "dash": _DASHES[k // len(COLOURS) % len(_DASHES)]}
        for k in range(len(comparison.flown))
    ]


def _styles(comparison: Comparison) -> list[str]:
    return [style["color"] for style in _lines(comparison)]


def _finished(figure: go.Figure, height: int) -> go.Figure:
    figure.update_xaxes(**_AXIS)
    figure.update_yaxes(**_AXIS)
    figure.update_layout(
        height=height,
        margin={"l": 70, "r": 20, "t": 40, "b": 50},
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor="rgba(0,0,0,0)",
        font={"family": "Inter, system-ui, sans-serif", "size": 12, "color": INK},
        legend={"orientation": "h", "yanchor": "bottom", "y": 1.0, "xanchor": "left", "x": 0.0},
        modebar={"bgcolor": "rgba(0,0,0,0)", "orientation": "v"},
    )
    return figure
