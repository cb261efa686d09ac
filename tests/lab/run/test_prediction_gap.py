"""A flight that leaves more than its plan predicts is told where nothing else explains it."""

import pytest

from flexslew_lab.run.prediction_gap import prediction_gap
from flexslew_lab.trial.sources import read_trial
from flexslew_lab.trial.trial import plan_of_trial

OSCILLATOR, CRAFT = "time_optimal_oscillator", "own_spacecraft"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "changes", "told"),
    [
        (OSCILLATOR, [], True),
        (OSCILLATOR, ["testbed.initial.free_mass_rate=0.05"], True),
        (OSCILLATOR, ["sensors.joint_position.noise=0.001"], False),
        (OSCILLATOR, ["actuator.lag=0.01"], False),
        (OSCILLATOR, ["schedule=[{at: 1.0, until: 2.0, disturbance: {mass: 0.1}}]"], False),
        (CRAFT, [], True),
        (CRAFT, ["testbed.orbit={altitude: 6.0e+5, inclination: 1.2}"], False),
    ],
)
def test_who_flies_on_the_bench_as_it_was_planned_for_is_told(
    name: str, changes: list[str], told: bool
) -> None:
    trial, _ = read_trial(name, changes)
    plan = plan_of_trial(trial)
    assert plan is not None
    predicted = plan.summary["predicted_residual_tip_deflection"]
    assert not prediction_gap(trial, plan, {"residual_tip_deflection": predicted})
    words = prediction_gap(trial, plan, {"residual_tip_deflection": predicted + 0.1})
    assert bool(words) == told
