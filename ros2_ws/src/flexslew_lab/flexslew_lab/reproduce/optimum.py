"""The least vibration that a bounded drive leaves: convex optima, and Liu and Wie's plan.

Floating oscillator, masses 1 and 1, k = 1 within 20 %, |u| <= 1, 1 m: the references were computed
with other transcriptions of the problem (docs/theory/optimum.md).
"""

from typing import Any

import numpy as np

from flexslew_control.law import PlantDescription
from flexslew_control.plan import Plan
from flexslew_control.planners import make_plan, plan_settings
from flexslew_lab.reproduce.rows import Row, absolute, at_most, relative
from flexslew_plant.testbeds.oscillators.floating_oscillator import FloatingOscillatorTestbed

_NONE, _PD = ((0.0,), (0.0,)), ((0.5,), (1.0,))  # kp and kd [N/m, N s/m]
_LEFT = (  # duration [s], feedback, exact at nominal, worst tip [m]
    (4.5, _NONE, False, 0.234),
    (5.0, _NONE, False, 0.165),
    (5.866, _NONE, False, 0.0262),
    (5.866, _NONE, True, 0.0507),
    (7.0, _NONE, False, 0.0107),
    (8.0, _NONE, False, 1.6e-3),
    (10.0, _NONE, False, 1.2e-4),
    (12.0, _NONE, False, 9.1e-6),
    (5.866, _PD, True, 0.0223),
    (10.0, _PD, True, 1.25e-3),
)
_LIU_WIE, _LEAVES = 5.865958, 0.0507  # their plan [s], and what it leaves within 20 % [m]


def optimum_rows() -> list[Row]:
    """Return the row of every optimum, recomputed."""
    rows = []
    for duration, feedback, exact, reference in _LEFT:
        found = _plan(feedback, duration=duration, exact_nominal=exact)
        loop = "under PD" if feedback is _PD else "without feedback"
        item = f"{duration:g} s {loop}{', exact at nominal' if exact else ''}: worst tip [m]"
        rows.append(relative(item, "", reference, found.summary["worst_residual"], 0.05))
    residual = _plan(_PD, duration=15.0, exact_nominal=True).summary["worst_residual"]
    item = "15 s under PD, exact at nominal: worst tip [m]"
    rows.append(at_most(item, "", 1.39e-5, residual))  # of a plan that was flown
    known: dict[str, Any] = {"residual_bound": _LEAVES, "duration": 9.0}
    exact_plan, free = (_plan(_NONE, exact_nominal=exact, **known) for exact in (True, False))
    left = f"shortest slew that leaves {_LEAVES:g} m"
    item = f"{left}, exact at nominal [s]"
    rows.append(relative(item, str(_LIU_WIE), _LIU_WIE, exact_plan.duration, 0.01))
    rows.append(at_most(f"{left} [s]", str(_LIU_WIE), _LIU_WIE, free.duration))
    nominal_only = {"ensemble": {"vary": {}}, "exact_nominal": True, "residual_bound": 1e-6}
    least = _plan(_NONE, duration=6.0, **nominal_only)
    # pieces of a sixtieth cannot switch where the optimum does
    rows.append(absolute("least time of the nominal plant [s]", "", 4.218, least.duration, 0.01))
    return rows


def _plan(feedback: tuple[tuple[float], tuple[float]], **section: Any) -> Plan:
    """Return the plan of a `plan` section for the oscillator's way of 1 m."""
    kp, kd = feedback
    values = {"method": "minimax_feedforward", "goal": {"mass": 1.0}, **section}
    values["feedback"] = {"kp": kp, "kd": kd}
    bench = PlantDescription(FloatingOscillatorTestbed(), 0.01, np.ones(1))
    return make_plan(plan_settings(values, "reproduce optimum"), bench)
