"""Trials without a plan, whose laws hold what they first measure, in a batch as on the bench."""

from collections.abc import Callable
from copy import deepcopy
from typing import Any

import pytest
from tests.lab.studies.batch.both_ways import CRAFT, require_equal
from tests.representatives import representatives

from flexslew_lab.studies.batch.fleet import BatchRunner
from flexslew_lab.studies.cases import case_of
from flexslew_lab.studies.run import prepare
from flexslew_lab.studies.study import Study

LAWS: dict[str, dict[str, Any]] = {
    "pd_feedforward": {},
    "collocated_pid": {"ki": [40.0, 30.0], "tracking_time": 0.4},
    "lqr": {},
    "output_feedback": {"mode": "tracking_b", "observer": "steady"},
}
PUSHED = [{"at": 0.5, "until": 0.9, "disturbance": {"hub_pitch": 6.0}}]
NOISE = {"joint_velocity": {"noise": 1e-4}, "joint_position": {"noise": 1e-4}}


def held(law: str, **keys: Any) -> dict[str, Any]:
    """Return a trial of csa that a law holds."""
    return {
        "duration": 3.0,
        "testbed": {"modes": 1, "effort_limit": [60.0, 40.0]},
        "plan": None,
        "controllers": {law: LAWS[law]},
        "active": law,
        "schedule": PUSHED,
        **keys,
    }


@pytest.mark.slow
@pytest.mark.parametrize("law", representatives(LAWS, "output_feedback"))
def test_every_law_holds_what_it_has_measured_as_on_the_bench(
    study_of: Callable[..., Study], law: str
) -> None:
    sensors: dict[str, Any] = {} if law == "output_feedback" else NOISE
    push = {"schedule.0.disturbance.hub_pitch": {"uniform": [2.0, 8.0]}}
    require_equal(
        prepare(study_of(flown=held(law, sensors=sensors), batch=True, vary=push)), [0, 3]
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "law", representatives(["pd_feedforward", "collocated_pid"], "pd_feedforward")
)
def test_members_that_hold_positions_of_their_own_fly_beside_each_other(
    study_of: Callable[..., Study], law: str
) -> None:
    bias = {"sensors.joint_position.bias": {"uniform": [-1e-2, 1e-2]}}
    ready = prepare(study_of(flown=held(law, sensors=NOISE), batch=True, vary=bias))
    cases = [case_of(ready.study, ready.samples, k) for k in range(8)]
    groups = [len(some) for some, _ in BatchRunner(ready.study, ready.plans).fly(cases)]
    assert groups == [8]
    require_equal(ready, [0, 1, 2, 3])


@pytest.mark.slow
def test_what_a_fault_says_first_is_held(study_of: Callable[..., Study]) -> None:
    fault = {"kind": "sensor_bias", "channel": "joint_position", "of": "base_yaw", "bias": 1e-2}
    schedule = [{"at": 0.0, "until": 0.4, "fault": fault}, *PUSHED]
    keys = {"allow_faults": True, "schedule": schedule, "sensors": NOISE}
    bias = {"schedule.0.fault.bias": {"uniform": [-1e-2, 1e-2]}}
    ready = prepare(study_of(flown=held("pd_feedforward", **keys), batch=True, vary=bias))
    require_equal(ready, [0, 1])


@pytest.mark.slow
def test_a_craft_holds_its_attitude(study_of: Callable[..., Study]) -> None:
    axes = {"roll": [1.0, 0.0, 0.0], "pitch": [0.0, 1.0, 0.0], "yaw": [0.0, 0.0, 1.0]}
    testbed = deepcopy(CRAFT)
    testbed["wheels"] = {n: {"axis": a, "inertia": 0.05, "limit": 20.0} for n, a in axes.items()}
    trial = {
        "duration": 3.0,
        "testbed": testbed,
        "plan": None,
        "controllers": {"pd_feedforward": {"kp": [30.0], "kd": [60.0]}},
        "schedule": [{"at": 0.5, "until": 0.9, "disturbance": {"roll": 2.0, "yaw": -1.0}}],
        "sensors": {"joint_position": {"bias": 0.01}, "joint_velocity": {"noise": 1e-4}},
    }
    vary = {"testbed.platform.mass": {"uniform": [100.0, 200.0]}}
    require_equal(prepare(study_of(flown=trial, batch=True, vary=vary)), [0, 3])
