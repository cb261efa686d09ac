"""Slews of craft whose modes are equal, nearly equal or distinct, beside a linear programme."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.control.planners.time_optimal.least_time import least_time
from tests.plants import AXES, torques
from tests.representatives import products, representatives

from flexslew_control.law import PlantDescription
from flexslew_control.planners import make_plan
from flexslew_control.planners.time_optimal import structures
from flexslew_control.planners.time_optimal.bang_bang import BangBang
from flexslew_control.planners.time_optimal.reachable import REACH_FLOOR, reachable_combinations
from flexslew_control.planners.time_optimal.time_optimal import TimeOptimal
from flexslew_lab.reproduce.scole_flights import example_trial
from flexslew_lab.trial.trial import feedback_of, plant_of
from flexslew_plant.errors import PlanFailed
from flexslew_plant.settings import validated
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.spacecraft.testbed import SpacecraftTestbed

# stiffness of the second panel over that of the first
ALIKE = {"equal": 1.0, "nearly": 1.0 + 1e-8, "close": 1.003, "distinct": 1.7}


def section(**values: Any) -> TimeOptimal:
    found: TimeOptimal = validated(TimeOptimal, {"method": "time_optimal", **values}, "test")
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    "goal", representatives([0.05, 0.1, 0.2, 0.3, 0.6, 1.0, 1.5, -0.4], 0.05, -0.4)
)
def test_the_shipped_spacecraft_is_slewed_in_the_least_time(goal: float) -> None:
    trial = example_trial("own_spacecraft")
    asked = section(goal={"roll": goal}, structure="optimal")
    plan = make_plan(asked, plant_of(trial), feedback_of(trial))
    assert isinstance(trial.testbed, SpacecraftTestbed)
    model = trial.testbed.turning("roll", 1).model()
    least = least_time(model, goal, 0.5, REACH_FLOOR)
    assert plan.summary["optimal"]
    assert plan.duration == pytest.approx(least, rel=0.01)
    assert plan.summary["residual_tip_deflection_on_model"] < 1e-6


def craft(rng: np.random.Generator, alike: str, joint: str, modes: int) -> SpacecraftTestbed:
    """Return a hub with two panels on opposite sides, across the axis of the joint."""
    along = AXES[{"roll": "pitch", "pitch": "yaw", "yaw": "roll"}[joint]]
    stiffness = float(rng.uniform(20.0, 120.0))
    shape = {
        "kind": "beam",
        "method": "closed_form",
        "length": float(rng.uniform(1.5, 4.0)),
        "linear_density": float(rng.uniform(0.5, 2.0)),
        "bending_stiffness": stiffness,
        "along": list(along),
        "across": list(np.cross(along, AXES[joint])),
        "modes_across": modes,
        "modes_third": 0,
    }
    panels = {
        "left": {"shape": shape, "damping": {"ratio": float(rng.choice([0.0, 0.005]))}},
        "right": {
            "shape": {**shape, "along": [-x for x in along]},
            "stiffness": ALIKE[alike],
            "damping": {"ratio": 0.0},
        },
    }
    panels["right"]["damping"] = panels["left"]["damping"]
    inertia = float(rng.uniform(15.0, 60.0))
    testbed = read_testbed(
        {
            "kind": "spacecraft",
            "platform": {"mass": 100.0, "inertia": dict.fromkeys(("xx", "yy", "zz"), inertia)},
            "appendages": panels,
            "actuators": {joint: torques(1.0)[joint]},
        },
        "test",
    )
    assert isinstance(testbed, SpacecraftTestbed)
    return testbed


@pytest.mark.parametrize(("alike", "joint"), products(ALIKE, AXES))
@pytest.mark.parametrize("seed", representatives([1, 2], 1))
def test_slews_of_random_craft_take_the_least_time(alike: str, joint: str, seed: int) -> None:
    rng = np.random.default_rng([seed, list(ALIKE).index(alike), list(AXES).index(joint)])
    testbed = craft(rng, alike, joint, 1)
    goal, limit = float(rng.uniform(0.1, 0.8)), np.array([float(rng.uniform(0.5, 2.0))])
    model = testbed.turning(joint).model()
    plant = PlantDescription(testbed, 0.01, limit)
    plan = make_plan(section(goal={joint: goal}, model={}, structure="optimal"), plant)
    assert plan.duration == pytest.approx(least_time(model, goal, limit[0], REACH_FLOOR), rel=0.01)
    assert plan.summary["predicted_residual_tip_deflection"] < 10.0 * REACH_FLOOR


@pytest.mark.parametrize(("alike", "count"), [("equal", 1), ("nearly", 1), ("distinct", 2)])
def test_equal_modes_count_as_one(alike: str, count: int) -> None:
    testbed = craft(np.random.default_rng(3), alike, "yaw", 1)
    model = testbed.turning("yaw").model()
    found = reachable_combinations(model, model.rest({}), 0, 1.0, 20.0)
    assert len(found) == count
    if count == 1:  # both swing the same way about the axis, one up and one down
        assert abs(found[0, 0]) == pytest.approx(abs(found[0, 1]), rel=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("robust", representatives([False, True], False))
def test_the_remedy_of_a_refusal_leads_to_a_slew(
    monkeypatch: pytest.MonkeyPatch, robust: bool
) -> None:
    known = structures.found_durations

    def narrow(slew: BangBang, structure: Any = "fewest") -> Any:
        if slew.robust or slew.amplitude > 0.4:
            raise PlanFailed("none was found")
        return known(slew, structure)

    monkeypatch.setattr(structures, "found_durations", narrow)
    trial = example_trial("own_spacecraft")
    asked = section(goal={"roll": 0.2}, robust=robust, amplitude=0.3 if robust else 0.5)
    with pytest.raises(PlanFailed) as refused:
        make_plan(asked, plant_of(trial), feedback_of(trial))
    key, value = str(refused.value).split("; ")[-1].split(" leads")[0].split(": ")
    wiser = {"robust": False} if key == "robust" else {"amplitude": float(value)}
    assert make_plan(replace(asked, **wiser), plant_of(trial), feedback_of(trial)).duration > 0.0


@pytest.mark.parametrize("robust", [False, True])
def test_a_mode_that_the_drive_does_not_move_leaves_the_slew_of_a_rigid_body(robust: bool) -> None:
    """A boom on a platform that is held does not feel an arm that turns there."""
    inertia = {"xx": 1.0, "yy": 2.5, "zz": 2.5}
    held = {
        "kind": "spacecraft",
        "platform": {"motion": "held"},
        "appendages": {
            "arm": {
                "hinge": {"kind": "driven", "axis": [0.0, 0.0, 1.0], "limit": 2.0},
                "body": {"mass": 5.0, "centre": [0.5, 0.0, 0.0], "inertia": inertia},
            },
            "boom": {
                "shape": {
                    "kind": "beam",
                    "length": 4.0,
                    "linear_density": 0.3,
                    "bending_stiffness": 200.0,
                    "modes": 1,
                }
            },
        },
        "actuators": {},
    }
    bench = PlantDescription(read_testbed(held, "here"), 0.01, np.array([2.0]))
    asked = section(
        goal={"arm_hinge": 0.4}, robust=robust, feedback={"kp": [2.0], "kd": [4.0]}, amplitude=2.0
    )
    plan = make_plan(asked, bench)
    assert plan.duration == pytest.approx(2.0 * np.sqrt(0.4 * 2.5 / 2.0))
    assert plan.summary["optimal"]


@pytest.mark.parametrize(
    "bench",
    [
        {"kind": "csa", "modes": 1},
        {
            "kind": "identified",
            "joints": ["base_yaw"],
            "modes": 2,
            "free_modes": [
                {"frequency": 1.3, "joints": [0.05], "tips": [0.5]},
                {"frequency": 1.9, "joints": [0.07], "tips": [0.5]},
            ],
        },
    ],
    ids=["csa", "identified"],
)
def test_a_joint_without_feedback_is_as_insensitive_as_the_modes(bench: Any) -> None:
    """Of a linear plant; so both cannot be asked for, and what can is said."""
    testbed = read_testbed(bench, "here")
    plant = PlantDescription(testbed, 0.02, np.array(testbed.effort_limit))
    keys = {"goal": {"base_yaw": 0.7}, "robust": True, "model": {"modes": testbed.modes}}
    with pytest.raises(PlanFailed, match="insensitive: modes leads to one"):
        make_plan(section(**keys, insensitive="state"), plant)
    assert abs(make_plan(section(**keys), plant).summary["joint_sensitivity"]) < 1e-7
