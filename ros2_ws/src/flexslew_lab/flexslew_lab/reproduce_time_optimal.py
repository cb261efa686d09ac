"""The numbers of papers/001: what the paper prints, an independent reference, and ours."""

from typing import Any

import numpy as np

from flexslew_control.pontryagin import switching_function
from flexslew_control.switching import BangBang, continued_durations
from flexslew_control.time_optimal import found_durations
from flexslew_plant.arrays import Vector
from flexslew_plant.csa import CsaTestbed
from flexslew_plant.errors import PlanFailed
from flexslew_plant.floating_oscillator import FloatingOscillatorTestbed
from flexslew_plant.hub_with_appendages import (
    FOOT_POUND,
    HubParameters,
    HubTestbed,
    energy_coefficients,
)
from flexslew_plant.testbeds import Testbed, build_model, with_stiffness

_SLEWS: dict[str, tuple[Testbed, float, float, bool, str, tuple[float, ...]]] = {
    "oscillator, time-optimal": (
        FloatingOscillatorTestbed(), 1.0, 1.0, False, "3 switches",
        (1.00267843, 2.10893326, 3.21518808, 4.21786651),
    ),
    "oscillator, robust": (
        FloatingOscillatorTestbed(), 1.0, 1.0, True, "5 switches",
        (0.71239863, 1.65634513, 2.93297922, 4.20961331, 5.15355981, 5.86595844),
    ),
    "hub, time-optimal": (
        HubTestbed(), 1.0, 2.0 * FOOT_POUND, False, "3 switches",
        (2.93665982, 3.00993354, 3.08320725, 6.01986708),
    ),
    "hub, robust": (
        HubTestbed(), 1.0, 2.0 * FOOT_POUND, True, "5 switches",
        (2.02038900, 2.29428977, 3.19079123, 4.08729269, 4.36119346, 6.38158246),
    ),
    "CSA yaw, time-optimal": (
        CsaTestbed(modes=1), 1.0, 100.0, False, "",
        (7.110356, 9.595312, 12.080268, 19.190624),
    ),
    "CSA yaw, robust": (
        CsaTestbed(modes=1), 1.0, 100.0, True, "",
        (4.172536, 6.103632, 11.274883, 16.446134, 18.377230, 22.549766),
    ),
}  # fmt: skip


def time_optimal_rows() -> list[dict[str, Any]]:
    """Return {item, paper, reference, ours, tolerance, ok} for every public number, recomputed."""
    rows: list[dict[str, Any]] = []
    solved: dict[str, tuple[BangBang, Vector]] = {}

    def add(item: str, paper: str, reference: float, ours: float, tolerance: float) -> None:
        ok = bool(abs(ours - reference) <= tolerance)
        rows.append({"item": item, "paper": paper, "reference": reference, "ours": float(ours),
                     "tolerance": tolerance, "ok": ok})  # fmt: skip

    for name, (testbed, distance, amplitude, robust, paper, times) in _SLEWS.items():
        slew = _slew(testbed, distance, amplitude, robust)
        durations = continued_durations(slew)
        if durations is None:
            raise PlanFailed(f"{name}: no slew was found")
        solved[name] = (slew, durations)
        ours = np.cumsum(durations)
        for k, (reference, found) in enumerate(zip(times, ours, strict=True)):
            what = "t_f [s]" if k == len(times) - 1 else f"switch {k + 1} [s]"
            add(f"{name}: {what}", paper, reference, float(found), 1e-6)
        holds = switching_function(slew, durations).holds
        add(f"{name}: Pontryagin holds", "", float(name != "hub, robust"), float(holds), 0.0)
    for name, low, high in (("time-optimal", 0.138505, 0.127333), ("robust", 0.0119410, 0.0106025)):
        for factor, reference in ((0.9, low), (1.1, high)):
            ours_left = residual(*solved[f"oscillator, {name}"], factor)
            add(f"oscillator, {name}: residual at k = {factor}", "", reference, ours_left, 6e-7)
    e = energy_coefficients(HubParameters())
    printed = (
        18.09815,
        -8.902248,
        18.278027,
        13.152322,
        17.930085,
        17.653088,
        73.112108,
        170.310339,
    )
    for label, reference, found in zip(e._fields, printed, e, strict=False):
        add(f"hub: {label}", "", reference, found, 6e-7)
    five = _slew(HubTestbed(), 2.0, 10.0 * FOOT_POUND, False)
    add("hub, 2 rad, 10 ft lb: t_f [s]", "", 3.80453683, found_durations(five).sum(), 1e-6)
    for sign, low_high, paper in ((-1, -0.113, "-13 %"), (1, 0.248, "+25 %")):
        edge = _equal_residual(solved["hub, time-optimal"], solved["hub, robust"], sign)
        add(f"hub: robust is better up to ({paper[0]})", paper, low_high, edge, 1e-3)
    return rows


def residual(slew: BangBang, durations: Vector, factor: float) -> float:
    """Return the amplitude of the mode after the end with the stiffness times factor [m]."""
    model = with_stiffness(slew.model, factor)
    x, n = slew.final(durations, factor), model.coordinates
    frequency = model.linearise(slew.start[:n]).frequencies[0]
    return float(np.hypot(x[n - 1], x[-1] / frequency))


def _slew(testbed: Testbed, distance: float, amplitude: float, robust: bool) -> BangBang:
    model = build_model(testbed)
    return BangBang(model, 0, np.zeros(2 * model.coordinates), distance, amplitude, robust)


def _equal_residual(
    plain: tuple[BangBang, Vector], robust: tuple[BangBang, Vector], sign: int
) -> float:
    """Return the stiffness error at which both slews leave the same residual [-]."""
    low, high = sign * 0.05, sign * 0.35
    for _ in range(40):
        middle = 0.5 * (low + high)
        better = residual(*robust, 1.0 + middle) < residual(*plain, 1.0 + middle)
        low, high = (middle, high) if better else (low, middle)
    return low
