import numpy as np
import pytest

from flexslew_control.input_shaping import InputShaping, command_profile, plan_input_shaping
from flexslew_plant.csa import CsaTestbed
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.settings import validated
from flexslew_plant.testbeds import build_model

LIMIT = np.array([150.0, 150.0])
UNSHAPED = np.array([1000.0, 1000.0])  # the swing that nobody shapes costs torque


def planned(limit=LIMIT, **more):
    settings = validated(InputShaping, more, "trial.yaml")
    return plan_input_shaping(settings, 0.01, limit, lambda update: None)


@pytest.mark.parametrize("command", ["cubic", "quintic", "sin2", "bang_bang"])
def test_commands_are_their_own_derivatives_and_reach_one(command):
    s = np.linspace(0.013, 0.983, 971)
    h = 1e-6
    _, rate, slope = command_profile(command, s)
    ahead, behind = command_profile(command, s + h), command_profile(command, s - h)
    assert rate == pytest.approx((ahead[0] - behind[0]) / (2 * h), abs=1e-5)
    smooth = np.abs(s - 0.5) > 1e-3
    assert slope[smooth] == pytest.approx(((ahead[1] - behind[1]) / (2 * h))[smooth], abs=1e-6)
    assert command_profile(command, np.array([0.0, 1.0]))[0] == pytest.approx([0, 1], abs=1e-14)


@pytest.mark.parametrize("command", ["cubic", "quintic", "sin2"])
def test_the_modes_end_at_rest_and_the_joints_at_the_goal_while_both_move(command):
    printed = {"variant": "printed"}  # its modes are driven by -m d/dt(theta' cos psi) exactly
    plan = planned(limit=UNSHAPED, duration=20.0, command=command, model=printed)
    assert plan.position[-1] == pytest.approx([1.0, 0.5], abs=1e-9)
    assert plan.velocity[-1] == pytest.approx([0.0, 0.0], abs=1e-9)
    residual = np.hypot(plan.state[-1, 2], plan.state[-1, 5] / 0.338329)
    assert residual < 2e-3  # the jumps of the cubic lie between ticks
    unshaped = planned(
        limit=UNSHAPED, duration=20.0, command=command, model=printed, shaper="none"
    ).state[-1]
    assert residual < 0.05 * np.hypot(unshaped[2], unshaped[5] / 0.338329)


def test_the_complete_model_ends_at_rest_too_while_the_pitch_is_held():
    plan = planned(initial={"hub_pitch": 0.5}, goal={"base_yaw": 1.0, "hub_pitch": 0.5})
    assert np.abs(plan.state[-1] - [1.0, 0.5, 0, 0, 0, 0]).max() < 1e-6


def test_the_effort_flies_the_model_along_the_plan():
    plan = planned(command="quintic")
    model = build_model(CsaTestbed(modes=1))
    x = plan.state[0]
    for effort in plan.effort:
        x = model.advance(x, effort, 0.01)
    assert x == pytest.approx(plan.state[-1], abs=1e-3)


def test_what_cannot_be_shaped_is_said_in_one_line():
    with pytest.raises(PlanFailed, match=r"needs .* N m on base_yaw"):
        planned(duration=1.0)
    with pytest.raises(BadInput, match="negative: true"):
        planned(shaper="um_zv")
    with pytest.raises(BadInput, match="there already"):
        planned(goal={"base_yaw": 0.0, "hub_pitch": 0.0})
