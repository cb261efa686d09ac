"""Figures 3, 4, 5 and 7 of Gorinevsky and Vukovich 1998, computed again."""

import numpy as np

from flexslew_lab.report.panels import COLOURS, Entry, Group, Panel, stacked
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


def csa_figures() -> dict[str, Group]:
    """Return Figures 3, 4, 5 and 7 of Gorinevsky and Vukovich 1998, computed again, by name."""
    return {
        "figure_3": _margin_figure("s at psi = 0.5 rad [1/s]", np.array([0.5])),
        "figure_4": _margin_figure("guaranteed s [1/s]", np.linspace(*PITCH_RANGE, 9)),
        "figure_5": _step_figure(),
        "figure_7": _manoeuvre_figure(),
    }


def _margin_figure(title: str, pitch_values: Vector) -> Group:
    """Return the margin over the gains as a map with contour lines."""
    kp, kd = np.linspace(10.0, 2000.0, 70), np.linspace(10.0, 4000.0, 70)
    table = margin_table(csa_model(), kp, kd, pitch_values)
    best = best_gains(csa_model(), 0.5) if len(pitch_values) == 1 else best_gains(csa_model())
    panel = Panel("kD [N m s/rad]", x_title="kP [N m/rad]", height=480, single=True)
    panel.traces.append(
        {
            "type": "contour",
            "x": kp.tolist(),
            "y": kd.tolist(),
            "z": table.T.tolist(),
            "colorscale": "Blues",
            "ncontours": 16,
            "contours": {"showlabels": True},
            "colorbar": {"title": {"text": "[1/s]"}},
        }
    )
    points = (("largest", best.kp, best.kd, "star"), ("the paper's gains", KP, KD, "circle"))
    for name, x, y, symbol in points:
        marker = {"color": COLOURS[1], "size": 12, "symbol": symbol}
        panel.line(np.array([x]), np.array([y]), name, {}, mode="markers", marker=marker)
    return Group("", title, [panel], tuple(Entry(name, COLOURS[1]) for name, *_ in points))


def _step_figure() -> Group:
    t, x = step_response()
    group = stacked(("theta [rad]", "psi [rad]", "tip [m]"), {"": (t[::5], x[::5, :3])})
    for panel in group.panels[:2]:
        panel.limits = (STEP_ANGLE,)
    return group


def _manoeuvre_figure() -> Group:
    paths = {}
    for label, found in (("with feedforward", csa_feedforward(M1)), ("without", None)):
        t, x, effort = simulate(M1, found)
        paths[label] = t[::5], np.hstack((x[::5, :3], effort[::5, :2]))
    names = ("theta [rad]", "psi [rad]", "tip [m]", "tau_theta [N m]", "tau_psi [N m]")
    return stacked(names, paths)
