"""Figures 3, 4, 5 and 7 of Gorinevsky and Vukovich 1998, computed again."""

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from flexslew_lab.report.panels import COLOURS, LINE
from flexslew_lab.reproduce.csa_flights import (
    KD,
    KP,
    M1,
    STEP_ANGLE,
    csa_feedforward,
    csa_model,
    simulate,
    step_response,
)
from flexslew_lab.reproduce.pd_margins import (
    PITCH_RANGE,
    best_gains,
    margin_table,
)
from flexslew_plant.arrays import Vector


def csa_figures() -> dict[str, go.Figure]:
    """Return Figures 3, 4, 5 and 7 of Gorinevsky and Vukovich 1998, computed again, by name."""
    return {
        "figure_3": _margin_figure("s at psi = 0.5 rad [1/s]", np.array([0.5])),
        "figure_4": _margin_figure("guaranteed s [1/s]", np.linspace(*PITCH_RANGE, 9)),
        "figure_5": _step_figure(),
        "figure_7": _manoeuvre_figure(),
    }


def _margin_figure(title: str, pitch_values: Vector) -> go.Figure:
    """Return the margin over the gains as a map with contour lines."""
    kp, kd = np.linspace(10.0, 2000.0, 70), np.linspace(10.0, 4000.0, 70)
    table = margin_table(csa_model(), kp, kd, pitch_values)
    best = best_gains(csa_model(), 0.5) if len(pitch_values) == 1 else best_gains(csa_model())
    figure = go.Figure(
        go.Contour(x=kp, y=kd, z=table.T, colorscale="Blues", ncontours=16,
                   contours={"showlabels": True}, colorbar={"title": {"text": "[1/s]"}})
    )  # fmt: skip
    for name, x, y, symbol in (
        ("largest", best.kp, best.kd, "star"),
        ("the paper's gains", KP, KD, "circle"),
    ):
        figure.add_trace(
            go.Scatter(x=[x], y=[y], name=name, mode="markers", showlegend=True,
                       marker={"color": COLOURS[1], "size": 12, "symbol": symbol})
        )  # fmt: skip
    figure.update_layout(
        title=title,
        xaxis_title="kP [N m/rad]",
        yaxis_title="kD [N m s/rad]",
        legend={"orientation": "h", "y": 1.08},
    )
    return figure


def _step_figure() -> go.Figure:
    t, x = step_response()
    figure = _rows_over_time(["theta [rad]", "psi [rad]", "tip [m]"])
    for k in range(3):
        _curve(figure, k + 1, t[::5], x[::5, k], COLOURS[0])
    for k in (1, 2):
        figure.add_hline(
            y=STEP_ANGLE, line={"color": LINE, "width": 1, "dash": "dot"}, row=k, col=1
        )
    return figure


def _manoeuvre_figure() -> go.Figure:
    names = ["theta [rad]", "psi [rad]", "tip [m]", "tau_theta [N m]", "tau_psi [N m]"]
    figure = _rows_over_time(names)
    for label, found, colour in (
        ("with feedforward", csa_feedforward(M1), COLOURS[0]),
        ("without", None, COLOURS[1]),
    ):
        t, x, effort = simulate(M1, found)
        columns = [x[:, 0], x[:, 1], x[:, 2], effort[:, 0], effort[:, 1]]
        for k, column in enumerate(columns, start=1):
            _curve(figure, k, t[::5], column[::5], colour, label if k == 1 else "")
    return figure


def _rows_over_time(labels: list[str]) -> go.Figure:
    figure = make_subplots(rows=len(labels), cols=1, shared_xaxes=True, vertical_spacing=0.03)
    for row, title in enumerate(labels, start=1):
        figure.update_yaxes(title_text=title, row=row, col=1)
    figure.update_xaxes(title_text="time [s]", row=len(labels), col=1)
    return figure.update_layout(height=170 * len(labels) + 60, hovermode="x unified")


def _curve(figure: go.Figure, row: int, t: Vector, y: Vector, colour: str, label: str = "") -> None:
    line = {"color": colour, "width": 1.6}
    trace = go.Scatter(x=t, y=y, mode="lines", line=line, name=label, showlegend=bool(label))
    figure.add_trace(trace, row=row, col=1)
