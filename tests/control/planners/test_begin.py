"""A slew that begins later is planned for what the testbed does then."""

from typing import Any

import numpy as np
import pytest
from tests.plants import with_dish

from flexslew_control.law import ActiveLaw, PlantDescription
from flexslew_control.plan import Plan
from flexslew_control.planners import make_plan, plan_settings
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import read_testbed

SKEW: dict[str, Any] = {"axis": [1.0, 2.0, -1.0], "angle": 0.6}
LIMIT = 3.0  # [N m]


def bench(at: float) -> PlantDescription:
    """Return a craft whose dish turns from a time on, in 10 s."""
    craft = with_dish(to=1.0, duration=10.0, at=at)
    return PlantDescription(read_testbed(craft, "here"), 0.02, np.full(3, LIMIT))


def planned(method: str, start: float, at: float, **keys: Any) -> Plan:
    section = {"goal": SKEW, "method": method, "start": start, "duration": 30.0, **keys}
    return make_plan(plan_settings(section, "here"), bench(at))


@pytest.mark.slow
@pytest.mark.parametrize("method", ["input_shaping", "optimized_feedforward"])
def test_a_slew_that_begins_as_much_later_as_the_dish_turns_is_the_same(method: str) -> None:
    now, later = planned(method, 0.0, 4.0), planned(method, 6.0, 10.0)
    np.testing.assert_allclose(later.effort, now.effort, atol=1e-10)
    assert np.abs(planned(method, 6.0, 4.0).effort - now.effort).max() > 0.05


@pytest.mark.parametrize("goal", [SKEW, {"yaw": 0.5}, {"roll": -0.5}], ids=str)
def test_efforts_alone_fly_a_craft_whose_dish_turns_meanwhile_to_its_goal(goal: Any) -> None:
    plan, model = planned("input_shaping", 6.0, 10.0, goal=goal), bench(10.0).testbed.model()
    x = np.concatenate((model.rest({}), np.zeros(model.coordinates)))
    position = model.joint_states(model.path(x, plan.effort, 0.02, t=6.0))[0]
    np.testing.assert_allclose(position, plan.position[1:], atol=1e-6)


def test_what_pushes_during_a_slew_alone_leaves_it_at_rest() -> None:
    """The dish has turned when the efforts end, and is still turning in a shorter slew."""
    keys = {"method": "robust_feedforward", "goal": SKEW}
    settings = plan_settings({**keys, "duration": 20.0}, "here")
    assert make_plan(settings, bench(4.0)).effort.any()
    with pytest.raises(BadInput, match="springs or loads push the joints away"):
        make_plan(plan_settings({**keys, "duration": 12.0}, "here"), bench(4.0))


@pytest.mark.parametrize("method", ["input_shaping", "start_coast_stop"])
def test_shaped_efforts_move_a_spring_that_varies_meanwhile(method: str) -> None:
    spring = {"load": 0.0, "stiffness": 1.0, "stiffness_swing": 0.9, "frequency": 0.02}
    testbed = read_testbed({"kind": "varying_oscillator", "parameters": spring}, "here")
    plant = PlantDescription(testbed, 0.02, np.array([100.0]))
    section = {"method": method, "goal": {"mass": 1.0}, "duration": 20.0, "start": 7.0}
    plan = make_plan(plan_settings(section, "here"), plant)
    flown = testbed.model().path(np.zeros(2), plan.effort, 0.02, t=7.0)
    np.testing.assert_allclose(flown[:, 0], plan.position[1:, 0], atol=1e-5)


def test_a_spring_that_varies_is_moved_in_time() -> None:
    model = read_testbed({"kind": "varying_oscillator"}, "here").model()
    q, v = np.array([0.3]), np.array([0.1])
    for time in (0.0, 0.2, 1.7):
        expected = model.bias(q, v, time + 0.3)
        np.testing.assert_allclose(model.with_time_zero(0.3).bias(q, v, time), expected, rtol=1e-12)


def test_what_a_later_slew_leaves_under_a_law_is_that_of_its_own_time() -> None:
    """A PID without integral is the joint feedback that the planner counts with."""
    spring = {"load": 0.0, "stiffness": 1.0, "stiffness_swing": 0.9, "frequency": 0.004}
    testbed = read_testbed({"kind": "varying_oscillator", "parameters": spring}, "here")
    gains = {"kp": [2.0], "kd": [3.0]}
    section = {"method": "reference_only", "goal": {"mass": 1.0}, "duration": 5.0, "start": 40.0}
    settings = plan_settings({**section, "feedback": gains}, "here")
    law = ActiveLaw("collocated_pid", {**gains, "ki": [0.0]})
    plant = PlantDescription(testbed, 0.05, np.array([1000.0]))
    left = [
        make_plan(settings, plant, law=flies).summary["predicted_residual_attitude_error"]["mass"]
        for flies in (None, law)
    ]
    assert left[1] == pytest.approx(left[0], rel=1e-9)  # 4 % apart where time counts twice
