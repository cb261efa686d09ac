"""Figures of chapter 4 of Kwak (1989), computed again."""

from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from flexslew_lab.report.panels import COLOURS
from flexslew_lab.reproduce import antenna_flights as flights
from flexslew_lab.reproduce.membrane_flights import half_way, membrane_flight
from flexslew_plant.arrays import Matrix
from flexslew_plant.testbeds.spacecraft.units import FOOT

FloatArray: TypeAlias = NDArray[np.floating[Any]]
_PLACES, _ANGLES = ("R_x [ft]", "R_y [ft]", "R_z [ft]"), ("theta_x", "theta_y", "theta_z")
_GAINS = ("integral gain", "proportional gain", "rate gain")
_LAWS = {"frozen": "adiabatic", "adiabatic": "perturbation", "zero": "perturbation, P1(tf) = 0"}


def antennas_figures() -> dict[str, go.Figure]:
    """Return Figures 5 to 8, 10 to 17, 19 to 21 and 23 to 30, by name."""
    one = {"open": flights.open_path("antenna_1"), "controlled": flights.minimum_disturbance_path()}
    two = {"open": flights.open_path("antenna_2"), "PI": flights.integral_path()}
    return {
        "figures_6_and_7": _platform(one, flights.STEP),
        "figures_5_and_8": _tips("antenna_1", one),
        "figures_10_and_11": _platform(two, flights.STEP),
        "figures_12_and_13": _tips("antenna_2", two),
        "figures_14_to_16": _oscillator_gains(),
        "figure_17": _oscillator(),
        "figures_19_to_21": _planar(),
        "figures_23_to_26": _membrane(1),
        "figures_27_to_30": _membrane(2),
    }


def _stack(labels: tuple[str, ...]) -> go.Figure:
    figure = make_subplots(rows=len(labels), cols=1, shared_xaxes=True, vertical_spacing=0.03)
    for row, title in enumerate(labels, start=1):
        figure.update_yaxes(title_text=title, row=row, col=1)
    figure.update_xaxes(title_text="time [s]", row=len(labels), col=1)
    return figure.update_layout(height=max(170 * len(labels) + 60, 380), hovermode="x unified")


def _curve(
    figure: go.Figure, row: int, name: str, number: int, x: FloatArray, y: FloatArray
) -> None:
    line = {"color": COLOURS[number % len(COLOURS)], "width": 1.6}
    trace = go.Scatter(
        x=x, y=y, name=name, legendgroup=name, showlegend=row == 1, mode="lines", line=line
    )
    figure.add_trace(trace, row=row, col=1)


def _platform(paths: dict[str, Matrix], step: float) -> go.Figure:
    figure = _stack((*_PLACES, *(f"{name} [rad]" for name in _ANGLES)))
    for number, (name, path) in enumerate(paths.items()):
        t = step * np.arange(len(path))[::5]
        for row in range(6):
            _curve(figure, row + 1, name, number, t, path[::5, row])
    return figure


def _tips(example: str, paths: dict[str, Matrix]) -> go.Figure:
    case = flights.example(example)
    names = case.motion.model.appendages.names
    visible = [k for k, row in enumerate(case.motion.model.appendages.tip) if abs(row).max() > 0.0]
    figure = _stack(tuple(f"{names[k]} [ft]" for k in visible))
    for number, (name, path) in enumerate(paths.items()):
        tips, t = case.tips(path)[::5], flights.STEP * np.arange(len(path))[::5]
        for row, k in enumerate(visible, start=1):
            _curve(figure, row, name, number, t, tips[:, k])
    return figure


def _oscillator_gains() -> go.Figure:
    figure = _stack(_GAINS)
    case = flights.time_varying(3)
    r, exact = case.regulator, flights.exact_riccati_of(3)
    t = flights.FINE * (np.arange(len(case.middle)) + 0.5)
    first = [0.5 * (a + b) - r.riccati for a, b in pairwise(exact)]
    gains_by_name = {
        "backward integration": [
            r.gains(r.change(frozen), p) for frozen, p in zip(case.middle, first, strict=True)
        ],
        "perturbation": flights.modal_gains_of(3, "adiabatic"),
        "adiabatic": flights.modal_gains_of(3, "frozen"),
    }
    for number, (name, gains) in enumerate(gains_by_name.items()):
        for row in range(3):
            values = np.array([float(g[row][0, 0]) for g in gains])
            _curve(figure, row + 1, name, number, t[::5], values[::5])
    return figure


def _oscillator() -> go.Figure:
    figure = _stack(("displacement [m]",))
    named = {"none": "uncontrolled", "adiabatic": "perturbation", "imsc": "independent modal space"}
    for number, (law, name) in enumerate(named.items()):
        path = flights.time_varying_path(3, law)
        t = flights.FINE * np.arange(len(path))
        _curve(figure, 1, name, number, t[::5], path[::5, 0])
    return figure


def _planar() -> go.Figure:
    figure = _stack(("R_y [ft]", "R_z [ft]", "theta [deg]", "q [ft]"))
    for number, (law, name) in enumerate(({"none": "uncontrolled"} | _LAWS).items()):
        path = flights.time_varying_path(4, law)[::10] * np.array([1.0, 1.0, np.degrees(1.0), 1.0])
        t = 10 * flights.FINE * np.arange(len(path))
        for row in range(4):
            _curve(figure, row + 1, name, number, t, path[:, row])
    return figure


def _membrane(case: int) -> go.Figure:
    """Return the flights of one of the cases of example 5; at r = a / 2 the point off x."""
    figure = _stack(("R_y [ft]", "R_z [ft]", "theta_x [rad]", "centre [ft]", "r = a / 2 [ft]"))
    name = f"antenna_5_{case}"
    shape = flights.flexible_shape(name)
    half = half_way(shape)
    linear, path = flights.example(name), flights.open_path(name)
    modes, centre = linear.modes(path), shape.tip.displacement[2]
    columns = (*path.T[1:4], modes @ centre / FOOT, modes @ half / FOOT)
    for row, column in enumerate(columns, start=1):
        t = flights.STEP * np.arange(len(column))
        _curve(figure, row, "linear, uncontrolled", 0, t[::5], column[::5])
    for number, closed_loop in enumerate((False, True), start=1):
        m, modes = membrane_flight(case, closed_loop)
        columns = (m.place[:, 1] / FOOT, m.place[:, 2] / FOOT, m.turned[:, 0],
                   m.tips["membrane"][:, 2] / FOOT, modes @ half / FOOT)  # fmt: skip
        t = np.linspace(0.0, flights.RUN, len(modes))
        for row, column in enumerate(columns, start=1):
            words = "controlled" if closed_loop else "uncontrolled"
            _curve(figure, row, words, number, t[::10], column[::10])
    return figure
