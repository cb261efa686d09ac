"""What a plan promises is what is flown, also where the bench moves before the plan begins."""

from typing import Any

import numpy as np
import pytest
from tests.control.planners.residuals import residual_of
from tests.present import present

from flexslew_control.plans.known_motion import PREDICTED, with_motion, with_tip_motion
from flexslew_lab.trial.trial import Trial, plan_of_trial, set_up, trial_of_values

LAWS: dict[str, Any] = {
    "pd_feedforward": {"kp": [0.05], "kd": [0.1]},
    "collocated_pid": {"kp": [0.05], "kd": [0.1], "ki": [0.0]},
}
METHODS: dict[str, dict[str, Any]] = {
    "minimax_feedforward": {"duration": 10.0},
    "reference_only": {"duration": 8.0},
    "input_shaping": {"duration": 12.0},
}


def trial(law: str, rate: float, start: float, method: str, **more: Any) -> Trial:
    values = {
        "testbed": {
            "kind": "floating_oscillator",
            "damping_ratio": 1e-3,
            "initial": {"free_mass_rate": rate},
        },
        "period": 0.02,
        "duration": start + METHODS[method]["duration"] + 41.0,
        "plan": {
            "method": method,
            "goal": {"mass": 0.5},
            "start": start,
            **METHODS[method],
            **more,
        },
        "controllers": {law: LAWS[law]},
        "active": law,
    }
    return trial_of_values(values, "test")


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("method", METHODS)
def test_the_motion_of_the_start_is_in_the_prediction(law: str, method: str) -> None:
    """Promised 4.0e-5 m, flown 6.6e-2 m, before a plan counted with it."""
    rng = np.random.default_rng([53, len(law), len(method)])
    for start in (0.0, 2.0 * float(rng.integers(1, 5))):
        rate = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.04, 0.1))
        asked = trial(law, rate, start, method)
        plan = present(plan_of_trial(asked))
        residual = residual_of(plan, *set_up(asked, "test"))
        promised = plan.summary["predicted_residual_tip_deflection"]
        assert residual.tip == pytest.approx(promised, rel=1e-6, abs=1e-7)
        away = plan.summary["predicted_residual_attitude_error"]["mass"]
        assert residual.joints[0] == pytest.approx(away, rel=1e-6, abs=1e-7)
        assert residual.tip > 1e-2


@pytest.mark.slow
def test_the_case_of_a_slew_on_a_moving_bench_is_warned_of() -> None:
    asked = trial("pd_feedforward", 0.1, 0.0, "minimax_feedforward")
    plan = present(plan_of_trial(asked))
    assert plan.summary["predicted_residual_tip_deflection"] == pytest.approx(6.6e-2, rel=0.1)
    assert "the bench moves before the plan begins" in plan.summary["warning"]
    still = present(plan_of_trial(trial("pd_feedforward", 0.0, 0.0, "minimax_feedforward")))
    assert still.summary["predicted_residual_tip_deflection"] < 1e-3
    assert "warning" not in still.summary
    np.testing.assert_array_equal(still.effort, plan.effort)


def test_a_swing_of_unknown_state_is_in_the_promise_where_it_is_not_small() -> None:
    plan = present(plan_of_trial(trial("pd_feedforward", 0.0, 0.0, "reference_only")))
    promised = plan.summary[PREDICTED]
    assert with_tip_motion(plan, 0.05 * promised) is plan
    swinging = with_tip_motion(plan, 10.0 * promised)
    assert "the tips swing by " in swinging.summary["warning"]
    assert swinging.summary[PREDICTED] == pytest.approx(11.0 * promised)
    known = with_motion(plan, 2.0 * promised, {"mass": 0.0}, 1.0)
    assert known.summary[PREDICTED] == 2.0 * promised
    assert "the bench moves at 1 s" in known.summary["warning"]
    assert with_tip_motion(known, 10.0 * promised) is known
    assert "warning" not in with_motion(plan, promised, {"mass": 0.0}, 1.0).summary
