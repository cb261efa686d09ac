"""A spacecraft is planned about one axis: which modes count, and what a plan says of all joints."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.plants import torques
from tests.present import present
from tests.representatives import products, representatives

from flexslew_control.law import PlantDescription
from flexslew_control.planners import make_plan, plan_settings
from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.reproduce.scole_flights import example_trial
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import feedback_of, plan_of_trial, plant_of
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.spacecraft.testbed import SpacecraftTestbed


def planned(name: str, **changes: Any) -> Any:
    trial = example_trial(name, {"plan": changes})
    return present(plan_of_trial(trial))


@pytest.mark.slow
@pytest.mark.parametrize("modes", representatives([2, 8], 2))
def test_after_a_plan_the_modes_are_at_rest_however_many_it_has(modes: int) -> None:
    plan = planned("scole_s_a", model={"appendages": {"mast": {"shape": {"modes": modes}}}})
    assert plan.state.shape[1] == 2 * (1 + modes)
    after = plan.reference(len(plan.effort) + 5)
    np.testing.assert_allclose(after.state, [plan.position[-1, 3], *np.zeros(1 + 2 * modes)])


@pytest.mark.slow
def test_the_reference_may_swing_on_after_the_end() -> None:
    plan = planned("scole_s_a", equal_frequencies=False, swing_on=2.0)
    end = round(plan.duration / plan.period) + 2
    assert plan.ticks == pytest.approx((plan.duration + 2.0) / plan.period, abs=2)
    assert (plan.position[end:] == plan.position[-1]).all()
    assert abs(plan.effort[end:]).max() < 1e-9
    second = plan.state[end:, 2]
    assert abs(second).max() > 0.01 * abs(plan.state[:, 2]).max()
    assert planned("scole_s_a", equal_frequencies=False).ticks < plan.ticks


def test_equal_panels_swing_together_in_the_planners_model() -> None:
    testbed = example_trial("own_spacecraft").testbed
    assert isinstance(testbed, SpacecraftTestbed)
    one = testbed.turning("roll", 1)
    assert {name: part.only_modes for name, part in one.appendages.items()} == {
        "left": (1,),
        "right": (1,),
    }
    model, whole = one.model(), testbed.turning("roll").model()
    # the pair reproduces the first frequency of the whole; one panel alone would not
    found, expected = (m.linearise(m.rest({})).frequencies for m in (model, whole))
    assert found.max() == pytest.approx(expected[abs(expected - found.max()).argmin()], rel=0.02)
    assert found.max() == pytest.approx(6.7419, rel=1e-4)


@pytest.mark.slow
def test_functions_too_long_for_a_mode_are_told_with_a_number_that_is_enough() -> None:
    with pytest.raises(PlanFailed, match=r"functions: 72 \(now 9\) is enough") as e:
        planned("own_spacecraft", functions=9)
    assert "period is 0.932 s" in str(e.value)
    plan = planned("own_spacecraft", functions=72)
    assert abs(plan.effort).max() <= 0.5


@pytest.mark.parametrize("name", ["own_spacecraft", "three_axes"])
def test_a_step_of_a_free_platform_promises_nothing_and_flies(name: str, tmp_path: Path) -> None:
    trial = example_trial(name)
    settings = plan_settings({"method": "none", "goal": {"roll": 1e-3}, "duration": 1.0}, "test")
    plan = make_plan(settings, plant_of(trial), feedback_of(trial))
    assert not [key for key in plan.summary if key.startswith("predicted")]
    step = replace(trial, plan=settings, duration=1.0, schedule=())
    run_trial(step, "test", tmp_path / "run", in_process=True, report=False)
    assert metrics_of(tmp_path / "run" / "bag")["ticks"] == 1.0 / trial.period


@pytest.mark.parametrize("askew", [0.4, 2.2])
def test_a_drive_askew_to_the_turn_reads_its_share_of_it(askew: float) -> None:
    """The efforts alone fly the reference of both, which in two axes tell no attitude."""
    along = [np.cos(askew), 0.6 * np.sin(askew), 0.8 * np.sin(askew)]
    craft = {
        "kind": "spacecraft",
        "platform": {"mass": 200.0, "inertia": {"xx": 40.0, "yy": 45.0, "zz": 50.0}},
        "wheels": {"one": {"axis": [1.0, 0.0, 0.0], "inertia": 0.05, "limit": 6.0}},
        "actuators": {"two": {"kind": "torque", "direction": along, "limit": 6.0}},
    }
    testbed = read_testbed(craft, "here")
    bench = PlantDescription(testbed, 0.02, np.array([6.0, 6.0]))
    settings = {"method": "start_coast_stop", "goal": {"one": 0.4}, "duration": 30.0}
    assert bench.joint_names == ("two", "one")
    plan = make_plan(plan_settings(settings, "here"), bench)
    np.testing.assert_allclose(plan.position[-1], [0.4 * np.cos(askew), 0.4], atol=1e-12)
    model = testbed.model()
    x = np.concatenate((model.rest({}), np.zeros(model.coordinates)))
    position, rate = model.joint_states(model.path(x, plan.effort, 0.02))
    np.testing.assert_allclose(position, plan.position[1:], atol=1e-5)
    np.testing.assert_allclose(rate, plan.velocity[1:], atol=1e-5)


@pytest.mark.parametrize(
    ("goal", "angle"),
    products([{"pitch": 0.5}, {"axis": [1.0, 2.0, -1.0], "angle": 0.6}], [0.0, 0.9]),
)
def test_a_driven_hinge_stays_where_it_starts_held_by_its_motor(goal: Any, angle: float) -> None:
    """The efforts alone fly hub and dish along the plan, and none would leave the hinge behind."""
    craft = {
        "kind": "spacecraft",
        "platform": {"mass": 200.0, "inertia": {"xx": 40.0, "yy": 45.0, "zz": 50.0}},
        "appendages": {
            "dish": {
                "hinge": {
                    "kind": "driven",
                    "place": [0.3, 0.2, 0.4],
                    "turned": {"axis": [0.0, 1.0, 1.0], "angle": 0.4},
                    "axis": [1.0, 0.3, 0.0],
                    "limit": 5.0,
                },
                "body": {
                    "mass": 8.0,
                    "centre": [0.5, 0.0, 0.6],
                    "inertia": {"xx": 4.0, "yy": 6.0, "zz": 3.5, "xz": -2.4},
                },
            }
        },
        "actuators": torques(3.0),
        "initial": {"dish_hinge": angle},
    }
    testbed = read_testbed(craft, "here")
    bench = PlantDescription(testbed, 0.02, np.array([3.0, 3.0, 3.0, 5.0]))
    settings = {"method": "start_coast_stop", "goal": goal, "duration": 40.0}
    plan = make_plan(plan_settings(settings, "here"), bench)
    model = testbed.model()
    x = np.concatenate((model.rest({"dish_hinge": angle}), np.zeros(model.coordinates)))
    flown = model.path(x, plan.effort, 0.02)
    position, rate = model.joint_states(flown)
    assert np.abs(plan.effort[:, 3]).max() > 0.01  # of 3 kg m^2: a radian in 25 s
    np.testing.assert_array_equal(plan.position[:, 3], angle)
    np.testing.assert_allclose(position, plan.position[1:], atol=1e-5)
    np.testing.assert_allclose(rate, plan.velocity[1:], atol=1e-5)


@pytest.mark.parametrize("passive", [False, True])
def test_a_hinge_of_a_platform_that_is_held_is_a_goal_unless_another_swings(passive: bool) -> None:
    body = {"mass": 5.0, "centre": [0.5, 0.0, 0.0], "inertia": {"xx": 1.0, "yy": 2.5, "zz": 2.5}}
    axis = [0.0, 0.0, 1.0]
    parts: dict[str, Any] = {"arm": {"hinge": {"kind": "driven", "axis": axis}, "body": body}}
    if passive:
        parts["flap"] = {"hinge": {"kind": "passive", "axis": axis, "spring": 4.0}, "body": body}
    held = {"kind": "spacecraft", "platform": {"motion": "held"}, "actuators": {}}
    bench = PlantDescription(
        read_testbed({**held, "appendages": parts}, "here"), 0.02, np.array([2.0])
    )
    section = {"method": "input_shaping", "goal": {"arm_hinge": 0.4}, "duration": 20.0}
    if passive:
        with pytest.raises(BadInput, match="as no joint does; method joint_trajectory moves"):
            make_plan(plan_settings(section, "here"), bench)
        return
    plan = make_plan(plan_settings(section, "here"), bench)
    flown = bench.testbed.model().path(np.zeros(2), plan.effort, 0.02)
    np.testing.assert_allclose(flown[-1], [0.4, 0.0], atol=1e-6)
