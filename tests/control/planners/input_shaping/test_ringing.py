"""A start-coast-stop slew that leaves the tips vibrating says so, whatever its feedforward."""

from typing import Any

import pytest
from tests.plants import plant

from flexslew_control.planners import make_plan, plan_settings
from flexslew_control.planners.slew import Feedback
from flexslew_plant.errors import PlanFailed
from flexslew_plant.testbeds.oscillators.floating_oscillator import FloatingOscillatorTestbed

GAINS = Feedback(kp=(460.0,), kd=(920.0,))


def planned(**more: Any) -> Any:
    values = {"method": "start_coast_stop", "goal": {"base_yaw": 1.0}, **more}
    return make_plan(plan_settings(values, "test"), plant(), GAINS)


@pytest.mark.parametrize("shaper", ["none", "clamped"])
@pytest.mark.parametrize("feedforward", ["rigid", "zero_order"])
def test_a_feedforward_without_the_modes_warns_of_what_it_leaves(
    feedforward: str, shaper: str
) -> None:
    summary = planned(feedforward=feedforward, shaper=shaper).summary
    left = summary["predicted_residual_tip_deflection"]
    assert left > 0.5
    assert f"vibrates by {left:.3g} m" in summary["warning"]


def test_an_elastic_one_that_comes_to_rest_does_not() -> None:
    plan = planned(model={"modes": 1})
    assert plan.summary["predicted_residual_tip_deflection"] < 1e-5
    assert "warning" not in plan.summary


def test_a_shaped_slew_that_is_too_fast_is_not_told_of_feedback() -> None:
    """The default gains do not hold a light oscillator, which this planner does not count with."""
    values = {"method": "input_shaping", "goal": {"mass": 1.0}, "duration": 1.0}
    bench = plant(0.01, (1.0,), FloatingOscillatorTestbed())
    with pytest.raises(PlanFailed, match=r"the shaped slew needs .* a duration of .* is enough"):
        make_plan(plan_settings(values, "test"), bench)
