"""A plan that cannot be made exact on ticks stays what it was."""

from typing import Any

import numpy as np
import pytest

from flexslew_lab.trial.trial import Trial, parse_trial, plan_of_trial
from flexslew_plant.yaml_data import yaml_text


def skew() -> Trial:
    """Return a slew in nine switches of a craft with four modes of two booms, askew to the axis."""
    axis = [0.8545326124207336, -0.054697987902292945, 0.516509578254689]
    booms: dict[str, Any] = {
        "long": {
            "hinge": {
                "place": [0.41, -0.4575, 0.4803],
                "axes": [
                    [-0.5595116045335695, 0.7325712657851343, 0.3876675185493824],
                    [-0.7840315784578291, -0.31612972512176885, -0.5341876831932383],
                    [-0.2687773211660445, -0.6028277842306211, 0.7512372555900064],
                ],
            },
            "shape": beam(5.664, 0.7738, 1253.0, 1),
            "damping": {"ratio": 0.02},
        },
        "soft": {
            "hinge": {
                "place": [0.4365, 0.2663, 0.4381],
                "axes": [
                    [-0.3127848575712797, 0.22419676711611458, 0.9229850716500223],
                    [-0.7944298841059305, -0.594387072985271, -0.12484056515187658],
                    [0.520621544035158, -0.7722951618925791, 0.36402388768288696],
                ],
            },
            "shape": beam(2.863, 0.8037, 15.58, 3),
            "body": {"mass": 1.0, "inertia": {"xx": 0.5, "yy": 0.5, "zz": 0.5}},
            "damping": {"ratio": 0.005},
        },
    }
    platform = {"mass": 184.65, "inertia": {"xx": 38.89, "yy": 42.21, "zz": 48.24}}
    turn = {"kind": "torque", "direction": axis, "limit": 2.8}
    trial = {
        "duration": 60.0,
        "period": 0.02,
        "testbed": {
            "kind": "spacecraft",
            "platform": {"motion": "pivot", "axis": axis, "place": [0.0084, -0.058, 0.0732]}
            | platform,
            "appendages": booms,
            "actuators": {"turn": turn},
        },
        "plan": {"method": "time_optimal", "goal": {"turn": 1.5}},
        "controllers": {"pd_feedforward": {"kp": [10.0], "kd": [30.0]}},
        "active": "pd_feedforward",
    }
    return parse_trial(yaml_text(trial), "test")


def beam(length: float, density: float, stiffness: float, modes: int) -> dict[str, Any]:
    own = {"length": length, "linear_density": density, "bending_stiffness": stiffness}
    return {"kind": "beam", "modes": modes, **own}


@pytest.mark.slow
def test_a_correction_that_leads_out_of_all_bounds_leaves_the_plan_as_it_was() -> None:
    """Two combinations of the modes can hardly be told apart, so efforts beyond all limits would
    be needed to end at rest exactly: flown, they end in NaN."""
    plan = plan_of_trial(skew())
    assert plan is not None
    assert plan.summary["switches"] == 9
    assert np.isfinite(plan.effort).all()
    assert np.abs(plan.effort).max() <= 2.8 * (1.0 + 1e-12)
    np.testing.assert_allclose(plan.position[-1], 1.5, atol=1e-4)


def test_the_peak_that_is_told_is_that_of_the_exact_efforts() -> None:
    text = """
    name: shaped
    duration: 60.0
    period: 0.02
    testbed:
      kind: floating_oscillator
      damping_ratio: 0.3
      parameters: {driven_mass: 3.7, free_mass: 1.2, stiffness: 4.4}
    plan: {method: input_shaping, goal: {mass: -2.0}, duration: 27.0, command: cubic, shaper: zvdd}
    controllers: {pd_feedforward: {kp: [0.5], kd: [1.0]}}
    """
    plan = plan_of_trial(parse_trial(text, "here"))
    assert plan is not None
    # 0.2 % less before the efforts were made exact
    np.testing.assert_allclose(plan.summary["peak_effort"], np.abs(plan.effort).max(axis=0))
