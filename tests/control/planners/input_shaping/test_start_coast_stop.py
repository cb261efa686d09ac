import re
from typing import Any

import numpy as np
import pytest
from tests.plants import plant
from tests.present import present

from flexslew_control.planners import make_plan
from flexslew_control.planners.input_shaping.start_coast_stop import StartCoastStop, pulse_pair
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.testbeds.csa import CsaInitial, CsaTestbed

PERIOD = 0.01


GOAL = {"base_yaw": float(np.pi / 6), "hub_pitch": 0.5}


def planned(pitch: float = 0.0, limit: Any = (150.0, 150.0), **changes: Any) -> Any:
    testbed = CsaTestbed(variant="printed", initial=CsaInitial(hub_pitch=pitch))
    return make_plan(StartCoastStop(**{"goal": GOAL, **changes}), plant(PERIOD, limit, testbed))


def test_pulses_turn_a_rigid_body_by_the_angle() -> None:
    motion = pulse_pair(0.5, 100.0, 0.4, 7000.0)
    t = np.linspace(0.0, motion.duration, 20001)
    np.testing.assert_allclose(np.trapezoid(motion.rate(t), t), 0.5, rtol=1e-8)
    np.testing.assert_allclose(motion.rate(t).max(), 100.0 * motion.length / 14000.0)


def test_a_short_turn_weakens_the_pulses_instead_of_overlapping_them() -> None:
    motion = pulse_pair(-0.01, 100.0, 0.4, 7000.0)
    t = np.linspace(0.0, motion.duration, 20001)
    assert motion.stop == pytest.approx(motion.length)
    np.testing.assert_allclose(np.trapezoid(motion.rate(t), t), -0.01, rtol=1e-6)


@pytest.mark.parametrize("pitch", [0.0, 0.5])
def test_the_nominal_motion_reaches_the_goal_and_rests(pitch: float) -> None:
    plan = planned(pitch)
    np.testing.assert_allclose(plan.state[-1, :2], [np.pi / 6, 0.5], atol=1e-12)
    np.testing.assert_allclose(plan.state[-1, 2:], 0.0, atol=1e-8)
    velocity = np.diff(plan.position, axis=0) / PERIOD
    middle = 0.5 * (plan.velocity[1:] + plan.velocity[:-1])
    np.testing.assert_allclose(velocity, middle, atol=1e-6)


def test_an_unshaped_reference_rings() -> None:
    plan = planned(shaper="none")
    assert abs(plan.state[-1, [2, 5]]).max() > 0.05


def test_the_feedforward_drives_the_model_along_the_nominal_states() -> None:
    plan = planned()
    model = CsaTestbed(variant="printed", modes=1).model()
    x = plan.state[0]
    for effort in plan.effort:
        x = model.advance(x, effort, PERIOD)
    np.testing.assert_allclose(x, plan.state[-1], atol=2e-4)


def test_a_goal_that_is_reached_already_is_refused() -> None:
    with pytest.raises(BadInput, match="there already"):
        planned(0.5, goal={"base_yaw": 0.0, "hub_pitch": 0.5})


def test_a_feedforward_above_the_limit_fails() -> None:
    with pytest.raises(PlanFailed, match="above the limit"):
        planned(limit=(20.0, 150.0))


def test_a_given_duration_is_kept_and_takes_the_least_amplitude() -> None:
    plan = planned(duration=30.0)
    assert plan.duration == pytest.approx(30.0, abs=1e-12)
    assert plan.position[-1] == pytest.approx([np.pi / 6, 0.5])
    again = planned(amplitude=plan.summary["pulse_amplitude"])
    assert again.duration == pytest.approx(30.0, abs=1e-9)
    np.testing.assert_allclose(again.effort, plan.effort, atol=1e-8)
    with pytest.raises(PlanFailed, match=r"do not fit .* longer by 5 s or a pulse"):
        planned(duration=20.0)
    with pytest.raises(BadInput, match="amplitude and duration: only one"):
        planned(duration=30.0, amplitude=50.0)


def test_a_tip_that_swings_on_after_the_end_is_warned_of() -> None:
    assert "warning" not in planned().summary
    system = planned(shaper="system").summary
    assert system["tip_left_swinging"] > 1.0
    assert system["warning"].endswith(
        "shaper: system is for feedforward: rigid, where the joints yield to the modes"
    )
    assert "nothing is shaped" in planned(shaper="none").summary["warning"]
    yielding = planned(shaper="system", feedforward="rigid").summary  # what the feedback leaves
    assert "feedforward: rigid" in yielding["warning"]


@pytest.mark.parametrize("duration", [12.0, 17.3, 20.0])
def test_the_frequency_at_which_two_pulses_fit_is_enough(duration: float) -> None:
    with pytest.raises(PlanFailed, match=r"pulse_frequency of [\d.]+ rad/s \(now") as caught:
        planned(duration=duration)
    enough = float(present(re.search(r"pulse_frequency of ([\d.]+) rad", str(caught.value)))[1])
    plan = planned(duration=duration, pulse_frequency=enough, limit=(1e4, 1e4))
    assert plan.duration == pytest.approx(duration)
    with pytest.raises(PlanFailed, match="do not fit"):
        planned(duration=duration, pulse_frequency=0.99 * enough, limit=(1e4, 1e4))


def test_the_time_that_two_pulses_lack_is_enough() -> None:
    for duration in (8.1, 9.7, 12.34):
        with pytest.raises(PlanFailed, match="do not fit") as caught:
            planned(duration=duration)
        longer = float(present(re.search(r"longer by ([\d.]+) s", str(caught.value)))[1])
        assert planned(limit=(1e4, 1e4), duration=duration + longer).duration > duration
