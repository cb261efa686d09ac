"""The numbers and figures of papers/000 on the CSA testbed, computed again."""

from functools import lru_cache
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from flexslew_control.basis import Basis
from flexslew_control.gauss_newton import Optimum, Update
from flexslew_control.manoeuvre import Manoeuvre, stage_times
from flexslew_control.margins import (
    PITCH_RANGE,
    best_gains,
    guaranteed_margin,
    margin_table,
    stability_margin,
)
from flexslew_control.optimized_feedforward import OptimizedFeedforward, find_feedforward
from flexslew_control.shooting import roll_out
from flexslew_control.slew_request import CsaGoal, CsaModel
from flexslew_control.trajectories import rest_to_rest
from flexslew_lab.figures import COLOURS, INK
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.csa import CsaParameters, CsaTestbed, beam
from flexslew_plant.dynamics import STAGES
from flexslew_plant.model import Model
from flexslew_plant.testbeds import build_model

_KP, _KD = 460.0, 920.0  # the gains (17) [N m/rad, N m s/rad]
_GAINS: tuple[Vector, Vector] = (np.full(2, _KP), np.full(2, _KD))
_STEP_ANGLE = 0.2  # of Figure 5 [rad]
_DURATION = 25.0  # T_c [s]
_OBSERVED = 100.0  # until when the tip is looked at [s]
_INTERVAL = 0.02  # between the states that are looked at; the nodes are multiples of it [s]
_REST: Vector = np.zeros(2)
_M1 = (1.0, 0.5)  # goals (theta, psi) of the manoeuvres, from rest at zero [rad]
_M3 = (np.pi / 2.0, np.pi / 4.0)
_M8 = (1.0, 0.0)
_EVEN_SMALLER_RHO = 4e-14  # its optimum is the smallest norm with Y = 0, (23)


def csa_rows() -> list[dict[str, Any]]:
    """Return {item, paper, reference, ours, tolerance, ok} for every public number, recomputed.

    The tolerance is absolute; `paper` is what the paper prints, empty where it prints nothing.
    """
    return [
        *_model_rows(),
        *_linear_rows(),
        *_margin_rows(),
        *_step_rows(),
        *_feedforward_rows(),
        *_robustness_rows(),
    ]


def csa_figures() -> dict[str, go.Figure]:
    """Return Figures 3, 4, 5 and 7 of papers/000, computed anew, by name."""
    return {
        "figure_3": _margin_figure("s at psi = 0.5 rad [1/s]", np.array([0.5])),
        "figure_4": _margin_figure("guaranteed s [1/s]", np.linspace(*PITCH_RANGE, 9)),
        "figure_5": _step_figure(),
        "figure_7": _manoeuvre_figure(),
    }


def _row(
    item: str, reference: float, ours: float, tolerance: float, paper: str = ""
) -> dict[str, Any]:
    ok = bool(abs(ours - reference) <= tolerance)
    return {
        "item": item,
        "paper": paper,
        "reference": reference,
        "ours": float(ours),
        "tolerance": tolerance,
        "ok": ok,
    }


def _at_most(item: str, limit: float, ours: float, paper: str = "") -> dict[str, Any]:
    """Return a line whose reference is an upper bound."""
    found = _row(f"{item} (at most)", limit, ours, 0.0, paper)
    return {**found, "ok": bool(ours <= limit)}


@lru_cache
def _model(modes: int = 1, stiffness: float = 1.0, variant: Any = "printed") -> Model:
    parameters = CsaParameters(bending_stiffness=1500.0 * stiffness)
    return build_model(CsaTestbed(variant=variant, modes=modes, parameters=parameters))


def _model_rows() -> list[dict[str, Any]]:
    bed = CsaTestbed(variant="printed", modes=3)
    linear = build_model(bed).linearise(np.zeros(5))
    yaw = [build_model(bed).mass_matrix(np.array([0, p, 0, 0, 0]))[0, 0] for p in (0.0, np.pi / 2)]
    rows = [
        _row("J_a [kg m^2]", 3972.0, yaw[0] - yaw[1], 1e-9),
        _row("J_1 [kg m^2]", 4000.0, yaw[1], 1e-9),
        _row("J_2 [kg m^2]", 5972.0, linear.mass[1, 1], 1e-9),
    ]
    table = {
        "beam frequency {} [rad/s]": ((0.338329, 2.120270, 5.936817), beam(bed).frequencies, 1e-6),
        "m_theta_q {} [kg m]": ((107.08658, -18.94164, 7.36150), linear.mass[0, 2:], 1e-5),
        "M_qq {} [kg]": ((3.0, 3.0, 3.0), np.diag(linear.mass)[2:], 1e-9),
        "K_qq {} [N/m]": (
            (0.343399, 13.486634, 105.737396),
            np.diag(linear.stiffness)[2:],
            1e-6,
        ),
    }
    for item, (references, ours, tolerance) in table.items():
        pairs = enumerate(zip(references, ours, strict=True), start=1)
        rows += [_row(item.format(j), r, o, tolerance) for j, (r, o) in pairs]
    for variant in ("printed", "complete"):
        rows.append(_at_most(f"{variant}: energy drift over 100 s [-]", 1e-9, _drift(variant)))
    return rows


def _drift(variant: str) -> float:
    """Return the largest relative change of the energy over 100 s without effort, 10 ms ticks."""
    model = _model(3, variant=variant)
    x = np.array([0.1, 0.3, 0.5, 0.02, -0.01, 0.2, -0.1, 0.1, 0.05, 0.02])
    start, drift = model.energy(x), 0.0
    for _ in range(100):
        x = model.advance(x, _REST, 1.0, 100)
        drift = max(drift, abs(model.energy(x) / start - 1.0))
    return drift


def _linear_rows() -> list[dict[str, Any]]:
    rows = []
    for pitch, name, reference in ((0.0, "0", 0.468949), (np.pi / 2, "pi/2", 0.338329)):
        found = _model().linearise(np.array([0.0, pitch, 0.0])).frequencies[0]
        rows.append(_row(f"open-loop frequency at psi = {name} [rad/s]", reference, found, 1e-5))
    for pitch, reference in ((0.0, 29.560), (0.5, 27.842), (1.0, 23.116)):
        yaw, _ = _periods(pitch)
        rows.append(
            _row(f"longest period of the loop at psi = {pitch:g} [s]", reference, yaw, 1e-3)
        )
    rows.append(_row("period of the pitch axis [s]", 23.565, _periods(0.5)[1], 1e-3))
    return rows


def _periods(pitch: float) -> tuple[float, float]:
    """Return the longest damped period of yaw with the beams, and that of the pitch axis [s]."""
    loop = _model().linearise(np.array([0.0, pitch, 0.0])).with_feedback(*_GAINS)
    periods = []
    for keep in ([0, 2], [1]):  # (14) is not coupled between the two
        part = np.ix_(keep, keep)
        coefficients = [matrix[part] for matrix in (loop.mass, loop.damping, loop.stiffness)]
        n = len(keep)
        companion = np.block(
            [
                [np.zeros((n, n)), np.eye(n)],
                [-np.linalg.solve(coefficients[0], coefficients[2]),
                 -np.linalg.solve(coefficients[0], coefficients[1])],
            ]
        )  # fmt: skip
        rates = np.abs(np.linalg.eigvals(companion).imag)
        periods.append(float(2.0 * np.pi / rates[rates > 1e-9].min()))
    return periods[0], periods[1]


def _margin_rows() -> list[dict[str, Any]]:
    model = _model()
    rows = []
    for pitch, reference in (
        (0.0, 0.0331672),
        (0.5, 0.0360931),
        (1.0, 0.0458938),
        (1.25, 0.0333525),
    ):
        ours = stability_margin(model, _KP, _KD, pitch)
        rows.append(_row(f"s(460, 920) at psi = {pitch:g} [1/s]", reference, ours, 1e-6))
    for modes, reference in ((2, 0.002759), (3, 0.000403)):
        ours = stability_margin(_model(modes), _KP, _KD, 0.5)
        rows.append(_row(f"s(460, 920) at psi = 0.5, {modes} modes [1/s]", reference, ours, 1e-6))
    best, sure = best_gains(model, 0.5), best_gains(model)
    rows += [
        _row("Figure 3: largest s [1/s]", 0.143080, best.margin, 1e-4),
        _row("Figure 3: kP there [N m/rad]", 471.04, best.kp, 0.05),
        _row("Figure 3: kD there [N m s/rad]", 2355.2, best.kd, 0.25),
        _row("Figure 4: largest guaranteed s [1/s]", 0.034074, sure.margin, 0.00034),
        _row("Figure 4: kP there [N m/rad]", 442.1, sure.kp, 4.4, "460"),
        _row("Figure 4: kD there [N m s/rad]", 920.0, sure.kd, 9.2, "920"),
        _at_most(
            "guaranteed s at (460, 920) [1/s]", sure.margin, guaranteed_margin(model, _KP, _KD)
        ),
    ]
    return rows


def _slew(goal: tuple[float, float], stiffness: float = 1.0, variant: str = "printed") -> Manoeuvre:
    return Manoeuvre(
        model=_model(1, stiffness, variant),
        kp=_GAINS[0],
        kd=_GAINS[1],
        start=_REST,
        goal=np.array(goal),
        duration=_DURATION,
        reference="cubic",
    )


def _step_response() -> tuple[Vector, Matrix]:
    """Return times and states after a step of _STEP_ANGLE in both references at psi = 0."""
    model = _model()
    n, m = model.coordinates, model.joints
    edges = np.linspace(0.0, 130.0, 6501)
    stages = STAGES * (len(edges) - 1)
    goal = np.tile(_GAINS[0] * _STEP_ANGLE, (stages, 1))
    path = roll_out(
        model.kind,
        model.packed,
        np.zeros(2 * n),
        edges,
        goal,
        *_GAINS,
        ((0,) * n, (0,) * m),
        np.empty((stages, 2 * n)),
        np.empty((stages, n)),
    )
    return edges, path


def _step_rows() -> list[dict[str, Any]]:
    t, x = _step_response()
    tip = np.abs(x[:, 2])
    outside = np.abs(x[:, 0] - _STEP_ANGLE) > 0.02 * _STEP_ANGLE
    effort = _GAINS[0] * (_STEP_ANGLE - x[0, :2]) - _GAINS[1] * x[0, 3:5]
    late = tip[(t >= 75.0) & (t <= 100.0)].max()
    return [
        _row("step: largest tip deflection [m]", 3.5646, tip.max(), 1e-4),
        _row("step: tip deflection in 75..100 s [m]", 0.269, late, 1e-3),
        _row("step: theta settles to 2 % at [s]", 106.4, t[outside][-1], 0.1),
        _row("step: torque at t = 0 [N m]", _KP * _STEP_ANGLE, effort[0], 1e-9),
    ]


@lru_cache
def _feedforward(goal: tuple[float, float], **changes: Any) -> tuple[Basis, Optimum]:
    settings = OptimizedFeedforward(
        model=CsaModel(variant="printed"),
        goal=CsaGoal(base_yaw=goal[0], hub_pitch=goal[1]),
        **changes,
    )
    return find_feedforward(settings, _slew(goal), _unheard)


def _flown(
    goal: tuple[float, float], found: tuple[Basis, Optimum] | None, **bench: Any
) -> tuple[Vector, Matrix, Matrix]:
    """Return times, states and torques of a slew with this feedforward, or with none."""
    slew = _slew(goal, **bench)
    edges = np.linspace(0.0, _OBSERVED, round(_OBSERVED / _INTERVAL) + 1)
    feedforward = np.zeros((STAGES * (len(edges) - 1), 2))
    added = np.zeros((len(edges), 2))
    if found is not None:
        basis, optimum = found
        weights = optimum.weights.reshape(2, -1).T
        feedforward = basis.values(stage_times(edges)) @ weights
        added = basis.values(edges) @ weights
    path = slew.fly(edges, feedforward)
    r = rest_to_rest("cubic", slew.start, slew.goal, slew.duration, edges)
    effort = added + slew.kp * (r.position - path[:, :2]) + slew.kd * (r.velocity - path[:, 3:5])
    return edges, path, effort


def _residual_tip(
    goal: tuple[float, float], found: tuple[Basis, Optimum] | None, **bench: Any
) -> float:
    """Return the largest tip deflection after the manoeuvre [m]."""
    t, x, _ = _flown(goal, found, **bench)
    return float(np.abs(x[t >= _DURATION, 2]).max())


def _feedforward_rows() -> list[dict[str, Any]]:
    rows = []
    table = {  # J*, norm U*, norm Y*, smallest norm U with Y = 0
        "M1": (_M1, 1.120818e-3, 163.3732, 0.00729, 172.6733),
        "M3": (_M3, 2.547486e-3, 248.9926, None, 256.4065),
        "M8": (_M8, 1.136050e-3, None, None, None),
    }
    for name, (goal, objective, norm_input, norm_error, least) in table.items():
        last = _feedforward(goal, reading="regularised")[1].history[-1]
        paper = _feedforward(goal, reading="regularised", iterations="paper")[1].history
        excess = paper[-1].objective / last.objective - 1.0
        rows += [
            _row(f"{name}: J*", objective, last.objective, 1e-6 * objective),
            _at_most(f"{name}: J / J* - 1, two evaluations of G", 5e-5, excess),
        ]
        if norm_input is not None:
            rows.append(_row(f"{name}: norm U* [N m]", norm_input, last.norm_input, 5e-4))
        if norm_error is not None:
            rows.append(
                _row(f"{name}: norm Y*", norm_error, last.norm_terminal_error, 5e-6, "1e-4")
            )
        if least is not None:
            limit = _feedforward(goal, reading="regularised", rho=_EVEN_SMALLER_RHO)[1].history[-1]
            rows.append(
                _row(f"{name}: smallest norm U, Y = 0 [N m]", least, limit.norm_input, 5e-4)
            )
    first = _feedforward(_M8, reading="regularised", iterations="paper")[1].history[0].objective
    excess = abs(first / _feedforward(_M8, reading="regularised")[1].history[-1].objective - 1.0)
    rows.append(_at_most("M8: |J / J* - 1| after one update", 1e-6, excess))
    small = _feedforward(_M1, reading="regularised", rho=4e-10)
    six = _feedforward(_M1, iterations="paper")
    peak = abs(_flown(_M1, _feedforward(_M1, reading="regularised"))[2][:, 0]).max()
    rows += [
        _row("M1, rho 4e-10: norm Y", 1e-4, small[1].history[-1].norm_terminal_error, 1e-5, "1e-4"),
        _row("M1, rho 4e-10: residual tip [m]", 0.008, _residual_tip(_M1, small), 1e-3),
        _row("M1, damped, six updates: norm Y", 2e-5, six[1].history[-1].norm_terminal_error, 2e-6),
        _at_most("M1, damped, six updates: residual tip [m]", 0.002, _residual_tip(_M1, six)),
        _row("M1: peak torque on the base [N m]", 64.0, peak, 1.0),
    ]
    for name, goal, reference in (("M1", _M1, 0.09), ("M3", _M3, 0.26)):
        tip = _residual_tip(goal, _feedforward(goal), variant="complete")
        rows.append(_row(f"{name} on the complete model: residual tip [m]", reference, tip, 0.01))
    return rows


def _robustness_rows() -> list[dict[str, Any]]:
    table = {0.8: (0.641, 6.76), 0.9: (0.284, 5.80), 1.1: (0.227, 4.51), 1.2: (0.415, 4.06)}
    plan = _feedforward(_M1, reading="regularised", rho=4e-10)
    rows = []
    for stiffness, (planned, bare) in table.items():
        name = f"EI {round(100 * (stiffness - 1)):+d} %"
        with_plan = _residual_tip(_M1, plan, stiffness=stiffness)
        without = _residual_tip(_M1, None, stiffness=stiffness)
        rows += [
            _row(f"{name}: residual tip of M1 [m]", planned, with_plan, 1e-3),
            _row(f"{name}: the same without feedforward [m]", bare, without, 6e-3),
        ]
    return rows


def _margin_figure(title: str, pitches: Vector) -> go.Figure:
    """Return the margin over the gains as a map with contour lines."""
    kp, kd = np.linspace(10.0, 2000.0, 70), np.linspace(10.0, 4000.0, 70)
    table = margin_table(_model(), kp, kd, pitches)
    best = best_gains(_model(), 0.5) if len(pitches) == 1 else best_gains(_model())
    figure = go.Figure(
        go.Contour(x=kp, y=kd, z=table.T, colorscale="Blues", ncontours=16,
                   contours={"showlabels": True}, colorbar={"title": {"text": "[1/s]"}})
    )  # fmt: skip
    for name, x, y, symbol in (
        ("largest", best.kp, best.kd, "star"),
        ("the paper's gains", _KP, _KD, "circle"),
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
    t, x = _step_response()
    figure = _rows_over_time(["theta [rad]", "psi [rad]", "tip [m]"])
    for k in range(3):
        _curve(figure, k + 1, t[::5], x[::5, k], COLOURS[0])
    for k in (1, 2):
        figure.add_hline(
            y=_STEP_ANGLE, line={"color": INK, "width": 1, "dash": "dot"}, row=k, col=1
        )
    return figure


def _manoeuvre_figure() -> go.Figure:
    names = ["theta [rad]", "psi [rad]", "tip [m]", "tau_theta [N m]", "tau_psi [N m]"]
    figure = _rows_over_time(names)
    for label, found, colour in (
        ("with feedforward", _feedforward(_M1), COLOURS[0]),
        ("without", None, COLOURS[1]),
    ):
        t, x, effort = _flown(_M1, found)
        columns = [x[:, 0], x[:, 1], x[:, 2], effort[:, 0], effort[:, 1]]
        for k, column in enumerate(columns, start=1):
            _curve(figure, k, t[::5], column[::5], colour, label if k == 1 else "")
    return figure


def _rows_over_time(titles: list[str]) -> go.Figure:
    figure = make_subplots(rows=len(titles), cols=1, shared_xaxes=True, vertical_spacing=0.03)
    for row, title in enumerate(titles, start=1):
        figure.update_yaxes(title_text=title, row=row, col=1)
    figure.update_xaxes(title_text="time [s]", row=len(titles), col=1)
    return figure.update_layout(height=170 * len(titles) + 60, hovermode="x unified")


def _curve(figure: go.Figure, row: int, t: Vector, y: Vector, colour: str, label: str = "") -> None:
    line = {"color": colour, "width": 1.6}
    trace = go.Scatter(x=t, y=y, mode="lines", line=line, name=label, showlegend=bool(label))
    figure.add_trace(trace, row=row, col=1)


def _unheard(update: Update) -> None:
    """Nobody listens."""
