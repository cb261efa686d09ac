"""The fastest reorientation of a flexible craft: all modes at rest, hardly later than rigid."""

from typing import Any

import numpy as np
import pytest
from tests.plants import torques

import flexslew as fs
from flexslew_control.law import ActiveLaw, PlantDescription
from flexslew_control.planners import make_plan, plan_settings
from flexslew_plant.testbeds import Testbed, read_testbed


def with_booms(**more: Any) -> Testbed:
    """Return a craft with two booms along y, each with a mode across in each direction."""
    booms = {
        f"boom_{k}": {
            "hinge": {"place": [0.0, side * 0.5, 0.0]},
            "shape": {
                "kind": "beam",
                "method": "closed_form",
                "length": 3.0,
                "linear_density": 0.6,
                "bending_stiffness": 60.0,
                "along": [0.0, side, 0.0],
                "across": [0.0, 0.0, 1.0],
                "modes_across": 1,
                "modes_third": 1,
            },
            "damping": {"ratio": 0.005},
        }
        for k, side in enumerate((1.0, -1.0))
    }
    platform = {"mass": 150.0, "inertia": {"xx": 40.0, "yy": 60.0, "zz": 50.0}}
    values = {"kind": "spacecraft", "platform": platform, "actuators": torques(1.5)}
    return read_testbed({**values, "appendages": booms, **more}, "here")


@pytest.mark.slow
def test_a_flexible_craft_ends_at_rest_and_hardly_later_than_a_rigid_one() -> None:
    bench = PlantDescription(with_booms(), 0.05, np.full(3, 1.5))
    values = {
        "method": "time_optimal",
        "drives": "all",
        "reserve": 0.2,
        "goal": {"axis": [1.0, 0.4, -0.8], "angle": "40 deg"},
    }
    law = ActiveLaw("pd_feedforward", {"kp": [20.0], "kd": [60.0]})
    summary = make_plan(plan_settings(values, "here"), bench, law=law).summary
    rigid, flexible = summary["rigid_duration"], summary["duration"]
    assert summary["later_than_rigid"] == flexible - rigid
    assert 0.999 * rigid < flexible < 1.02 * rigid
    assert flexible < summary["eigenaxis_duration"]
    assert max(abs(x) for x in summary["terminal_error"]) < 1e-7
    assert summary["predicted_residual_tip_deflection"] < 1e-5
    assert max(summary["predicted_residual_attitude_error"].values()) < 1e-5
    assert np.max(summary["peak_effort"]) <= 1.2 * (1.0 + 1e-9)


@pytest.mark.slow
def test_where_fast_modes_bind_the_duration_a_slower_slew_is_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # the programs ended 1 % before any slew that leaves the modes at rest; in full, its duration is
    # 29.587 s: here to 5 % alone, which takes 10 s in place of 50
    turns = "flexslew_control.planners.time_optimal.three_axes.fastest_turns."
    for name, value in (("STEPS", 10), ("_LEAST", 0.05)):
        monkeypatch.setattr(turns + name, value)
    goal = {"axis": [0.0, 1.0, 1.0], "angle": 1.5}
    section = {"method": "time_optimal", "drives": "all", "goal": goal, "longest": 32.0}
    trial = fs.trial("three_axes", {"plan": section, "schedule": [], "duration": 60.0})
    plan = fs.plan(trial)
    assert 28.82 < plan.duration < 32.0 < plan.summary["eigenaxis_duration"]
    assert (np.abs(plan.effort) <= 0.5).all()
    flown = fs.fly(trial).metrics
    assert flown["residual_tip_deflection"] < 1e-4
    assert max(flown["residual_attitude_error"].values()) < 1e-4
