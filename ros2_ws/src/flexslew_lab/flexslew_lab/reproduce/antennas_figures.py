"""Figures of chapter 4 of Kwak (1989), computed again."""

from itertools import pairwise

import numpy as np

from flexslew_lab.report.panels import Group, stacked
from flexslew_lab.reproduce import antenna_flights as flights
from flexslew_lab.reproduce.membrane_flights import half_way, membrane_flight
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.spacecraft.units import FOOT

_PLACES, _ANGLES = ("R_x [ft]", "R_y [ft]", "R_z [ft]"), ("theta_x", "theta_y", "theta_z")
_GAINS = ("integral gain", "proportional gain", "rate gain")
_LAWS = {"frozen": "adiabatic", "adiabatic": "perturbation", "zero": "perturbation, P1(tf) = 0"}
_THIN = 5  # of the samples, one is drawn


def antennas_figures() -> dict[str, Group]:
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


def _over_time(paths: dict[str, Matrix], step: float) -> dict[str, tuple[Vector, Matrix]]:
    return {
        name: (_THIN * step * np.arange(len(path[::_THIN]), dtype=np.float64), path[::_THIN])
        for name, path in paths.items()
    }


def _platform(paths: dict[str, Matrix], step: float) -> Group:
    return stacked((*_PLACES, *(f"{name} [rad]" for name in _ANGLES)), _over_time(paths, step))


def _tips(example: str, paths: dict[str, Matrix]) -> Group:
    case = flights.example(example)
    appendages = case.motion.model.appendages
    visible = [k for k, row in enumerate(appendages.tip) if abs(row).max() > 0.0]
    tips = {name: case.tips(path)[:, visible] for name, path in paths.items()}
    labels = tuple(f"{appendages.names[k]} [ft]" for k in visible)
    return stacked(labels, _over_time(tips, flights.STEP))


def _oscillator_gains() -> Group:
    case = flights.time_varying(3)
    r, exact = case.regulator, flights.exact_riccati_of(3)
    t = flights.FINE * (np.arange(len(case.middle), dtype=np.float64) + 0.5)
    first = [0.5 * (a + b) - r.riccati for a, b in pairwise(exact)]
    gains_by_name = {
        "backward integration": [
            r.gains(r.change(frozen), p) for frozen, p in zip(case.middle, first, strict=True)
        ],
        "perturbation": flights.modal_gains_of(3, "adiabatic"),
        "adiabatic": flights.modal_gains_of(3, "frozen"),
    }
    rows = {
        name: (t[::_THIN], np.array([[one[0, 0] for one in g] for g in gains[::_THIN]]))
        for name, gains in gains_by_name.items()
    }
    return stacked(_GAINS, rows)


def _oscillator() -> Group:
    named = {"none": "uncontrolled", "adiabatic": "perturbation", "imsc": "independent modal space"}
    paths = {name: flights.time_varying_path(3, law) for law, name in named.items()}
    return stacked(("displacement [m]",), _over_time(paths, flights.FINE))


def _planar() -> Group:
    in_degrees = np.array([1.0, 1.0, np.degrees(1.0), 1.0])
    paths = {
        name: flights.time_varying_path(4, law)[::2, :4] * in_degrees
        for law, name in ({"none": "uncontrolled"} | _LAWS).items()
    }
    labels = ("R_y [ft]", "R_z [ft]", "theta [deg]", "q [ft]")
    return stacked(labels, _over_time(paths, 2.0 * flights.FINE))


def _membrane(case: int) -> Group:
    """Return the flights of one of the cases of example 5; at r = a / 2 the point off x."""
    name = f"antenna_5_{case}"
    shape = flights.flexible_shape(name)
    half = half_way(shape)
    linear, path = flights.example(name), flights.open_path(name)
    modes, centre = linear.modes(path), shape.tip.displacement[2]
    columns = np.column_stack((path[:, 1:4], modes @ centre / FOOT, modes @ half / FOOT))
    curves = _over_time({"linear, uncontrolled": columns}, flights.STEP)
    for closed_loop in (False, True):
        m, modes = membrane_flight(case, closed_loop)
        columns = np.column_stack(
            (m.place[:, 1:3] / FOOT, m.turned[:, 0], m.tips["membrane"][:, 2] / FOOT,
             modes @ half / FOOT)
        )  # fmt: skip
        t = np.linspace(0.0, flights.RUN, len(modes))
        curves["controlled" if closed_loop else "uncontrolled"] = t[::10], columns[::10]
    labels = ("R_y [ft]", "R_z [ft]", "theta_x [rad]", "centre [ft]", "r = a / 2 [ft]")
    return stacked(labels, curves)
