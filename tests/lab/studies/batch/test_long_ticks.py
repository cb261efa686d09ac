"""Kalman filters in a batch as on the bench at ticks in which a mode turns far."""

from collections.abc import Callable

import pytest
from tests.lab.studies.batch.both_ways import require_equal
from tests.representatives import representatives

from flexslew_lab.studies.run import prepare
from flexslew_lab.studies.study import Study


@pytest.mark.slow
@pytest.mark.parametrize("law", representatives(["lqr", "proportional_integral"], "lqr"))
def test_a_filter_acts_in_a_batch_as_on_the_bench(study_of: Callable[..., Study], law: str) -> None:
    trial = {
        "duration": 12.0,
        "period": 0.06,  # 0.4 rad of the mode
        "testbed": {"kind": "hub_with_appendages", "damping_ratio": 0.01},
        "plan": {"method": "none", "goal": {"hub": 0.1}, "duration": 2.0},
        "controllers": {law: {}},
        "active": law,
        "sensors": {"joint_position": {"noise": 1e-4}, "joint_velocity": {"noise": 1e-3}},
    }
    vary = {"testbed.parameters.tip_mass": {"relative": {"uniform": [0.9, 1.1]}}}
    require_equal(prepare(study_of(flown=trial, batch=True, vary=vary)), [0, 1, 2])


@pytest.mark.slow
def test_a_tick_of_several_steps_is_one_in_a_batch_as_on_the_bench(
    study_of: Callable[..., Study],
) -> None:
    """At 2.9 rad a tick one step loses 0.1 % of the vibration, at 6 rad it is unstable."""
    trial = {
        "duration": 20.0,
        "period": 0.1,
        "testbed": {
            "kind": "floating_oscillator",
            "parameters": {"stiffness": 420.0},
            "initial": {"free_mass_rate": 0.01},
        },
        "plan": {"method": "none", "goal": {"mass": 0.0}},
        "controllers": {"pd_feedforward": {"kp": [0.05], "kd": [0.1]}},
    }
    vary = {"testbed.parameters.stiffness": {"uniform": [400.0, 1800.0]}}
    require_equal(prepare(study_of(flown=trial, batch=True, vary=vary)), [0, 1, 2])
