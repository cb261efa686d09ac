from typing import Any

import numpy as np
import pytest
from tests.plants import plant

from flexslew_control.planners import make_plan
from flexslew_control.planners.input_shaping.input_shaping import command_profile
from flexslew_control.planners.input_shaping.section import Command, InputShaping
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.settings import validated
from flexslew_plant.testbeds.csa import CsaTestbed, CsaVariant

LIMIT = np.array([150.0, 150.0])


def planned(limit: Any = LIMIT, **more: Any) -> Any:
    settings = validated(InputShaping, more, "trial.yaml")
    return make_plan(settings, plant(0.01, limit))


@pytest.mark.parametrize("command", ["cubic", "quintic", "sin2", "bang_bang"])
def test_commands_have_the_rates_of_their_ways_and_reach_one(command: Command) -> None:
    s, h = np.linspace(0.013, 0.983, 971), 1e-6
    after, before = (command_profile(command, s + d)[0] for d in (h, -h))
    assert command_profile(command, s)[1] == pytest.approx((after - before) / (2 * h), abs=1e-5)
    assert command_profile(command, np.array([0.0, 1.0]))[0] == pytest.approx([0, 1], abs=1e-14)


@pytest.mark.parametrize("variant", ["printed", "complete"])
@pytest.mark.parametrize("command", ["cubic", "quintic", "sin2", "bang_bang"])
def test_the_modes_end_at_rest_and_the_joints_at_the_goal_while_both_move(
    command: Command, variant: CsaVariant
) -> None:
    plan = planned(duration=20.0, command=command, model={"variant": variant, "modes": 2})
    assert plan.state[-1] == pytest.approx([1.0, 0.5, *np.zeros(6)], abs=1e-5)
    smooth = command in ("quintic", "sin2")
    assert np.max(plan.summary["modal_residual"]) < (1e-9 if smooth else 1e-5)


@pytest.mark.parametrize("variant", ["printed", "complete"])
@pytest.mark.parametrize("command", ["quintic", "bang_bang"])
def test_the_effort_flies_the_model_along_the_plan(command: Command, variant: CsaVariant) -> None:
    plan = planned(duration=20.0, command=command, model={"variant": variant, "modes": 1})
    model = CsaTestbed(variant=variant, modes=1).model()
    x = plan.state[0]
    for k, effort in enumerate(plan.effort):
        assert x == pytest.approx(plan.state[k], abs=1e-5)
        x = model.advance(x, effort, 0.01)
    assert x == pytest.approx(plan.state[-1], abs=1e-5)


def test_the_bench_keeps_within_millimetres_with_modes_nobody_shaped() -> None:
    plan = planned(duration=18.0, command="sin2", goal={"base_yaw": np.pi / 6, "hub_pitch": 0.5})
    model, x, tip = CsaTestbed(modes=3).model(), np.zeros(10), 0.0
    for k in range(4000):
        requested = plan.reference(k)
        error, slip = requested.position - x[:2], requested.velocity - x[5:7]
        x = model.advance(x, requested.effort + 460.0 * error + 920.0 * slip, 0.01)
        if k > plan.ticks:
            tip = max(tip, abs(x[2:5].sum()))
    assert tip < 0.004  # the page's case; 0.308 m with theta' shaped instead


def test_damped_modes_end_at_rest() -> None:
    plan = planned(duration=20.0, damping=0.05, model={"damping_ratio": 0.05})
    assert np.abs(plan.state[-1] - [1.0, 0.5, 0, 0, 0, 0]).max() < 1e-9


def test_pitch_where_yaw_moves_no_appendage_is_refused() -> None:
    with pytest.raises(BadInput, match=r"goal: hub_pitch: 1\.6 is not allowed"):
        planned(goal={"base_yaw": 1.0, "hub_pitch": 1.6})


def test_what_cannot_be_shaped_is_said_in_one_line() -> None:
    with pytest.raises(PlanFailed, match=r"needs .* N m on base_yaw"):
        planned(duration=1.0)
    with pytest.raises(BadInput, match="negative: true"):
        planned(shaper="um_zv")
    with pytest.raises(BadInput, match="there already"):
        planned(goal={"base_yaw": 0.0, "hub_pitch": 0.0})
