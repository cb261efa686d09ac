"""Plans of linear plants scale with the goal, where the limits do."""

from typing import Any

import numpy as np
import pytest

from flexslew_control.law import PlantDescription
from flexslew_control.plan import Plan
from flexslew_control.planners import PLANNERS, make_plan, plan_settings
from flexslew_control.planners.slew import Feedback
from flexslew_plant.testbeds import read_testbed

BEDS: dict[str, dict[str, Any]] = {
    "oscillator": {
        "kind": "floating_oscillator",
        "parameters": {"driven_mass": 50.0, "free_mass": 1.0, "stiffness": 16.0},
    },
    "two_modes": {
        "kind": "identified",
        "inertia": [[100.0]],
        "free_modes": [
            {"frequency": 3.0, "joints": [0.05], "tips": [1.0], "damping_ratio": 0.005},
            {"frequency": 8.0, "joints": [0.02], "tips": [0.5], "damping_ratio": 0.005},
        ],
    },
}
LIMIT = 400.0  # for a goal of one
SHAPERS = ("none", "zv", "zvd", "zvdd", "ei", "ei_two_hump", "um_zv")
SHAPED = [{"shaper": name, "negative": True, "duration": 5.0} for name in SHAPERS]
OWN: dict[str, list[dict[str, Any]]] = {
    "input_shaping": [
        *SHAPED,
        {"shaper": "ei", "tolerance": 0.004, "duration": 5.0},
        {"shaper": "zv", "frequencies": [4.5], "duration": 5.0},
    ],
    "start_coast_stop": [{"duration": 25.0}, {"amplitude": 40.0}],
    "time_optimal": [{}, {"robust": True}],
}
SLEWS = [
    (name, keys)
    for name, entry in PLANNERS.items()
    if entry.slews and name not in ("retargeting", "trajectory")
    for keys in OWN.get(name, [{}])
]
# powers of two change no digit, so that an optimum which is not unique stays the same
SIZES = [2.0**-3, 2.0**-7, 2.0**-10, 2.0**-13]


def planned(bed: str, method: str, size: float, keys: dict[str, Any]) -> Plan:
    """Return the plan of a goal of this size [m or rad], with limits in proportion."""
    limit = LIMIT * size
    testbed = read_testbed({**BEDS[bed], "effort_limit": [limit]}, "here")
    goal = {testbed.model().joint_names[0]: size}
    values = {"method": method, "goal": goal, **PLANNERS[method].example, **keys}
    if "amplitude" in keys:
        values["amplitude"] = keys["amplitude"] * size
    plant = PlantDescription(testbed, 0.05, np.array([limit]))
    return make_plan(plan_settings(values, "here"), plant, Feedback(kp=(20.0,), kd=(60.0,)))


def require_scaled(bed: str, method: str, keys: dict[str, Any], sizes: list[float]) -> None:
    """Check that efforts, references and states are in proportion to the goal."""
    whole = planned(bed, method, 1.0, keys)
    for size in sizes:
        plan = planned(bed, method, size, keys)
        for name in ("effort", "position", "velocity", "state"):
            one, part = getattr(whole, name), getattr(plan, name)
            assert part.shape == one.shape
            largest = np.abs(one).max(initial=0.0)
            np.testing.assert_allclose(
                part / size, one, atol=1e-8 * largest, rtol=0.0, err_msg=f"{name} at {size:g}"
            )


QUICK = [one for one in SLEWS if one[0] not in ("robust_feedforward", "minimax_feedforward")]


@pytest.mark.parametrize(("method", "keys"), QUICK)
def test_a_plan_scales_with_its_goal(method: str, keys: dict[str, Any]) -> None:
    require_scaled("oscillator", method, keys, [2.0**-13])


@pytest.mark.matrix
@pytest.mark.parametrize("bed", BEDS)
@pytest.mark.parametrize(("method", "keys"), SLEWS)
def test_every_plan_scales_with_its_goal(bed: str, method: str, keys: dict[str, Any]) -> None:
    require_scaled(bed, method, keys, SIZES)


@pytest.mark.parametrize("size", [0.1, 0.01, 1e-4])
def test_a_shaper_keeps_the_residual_that_it_tolerates(size: float) -> None:
    """An EI shaper for 5 rad/s on its own model leaves 5 % there, at any size."""
    keys = {"shaper": "ei", "tolerance": 0.05, "duration": 1.0, "command": "bang_bang"}
    plan = planned("oscillator", "input_shaping", size, {**keys, "frequencies": [4.0]})
    bare = planned("oscillator", "input_shaping", size, {**keys, "shaper": "none"})
    left, without = (one.summary["modal_residual"][0] for one in (plan, bare))
    assert left / without == pytest.approx(0.05, rel=1e-3)
    rest = float(np.hypot(plan.state[-1, 1], plan.state[-1, 3] / 4.0))
    assert rest == pytest.approx(left, rel=1e-12)
