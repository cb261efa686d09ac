"""Trials whose law has a monitor fly in a batch until a test of it fails."""

from collections.abc import Callable
from itertools import product
from typing import Any

import pytest
from tests.lab.studies.batch.both_ways import require_equal, ways_of
from tests.representatives import representatives

from flexslew_lab.studies.cases import case_of
from flexslew_lab.studies.flight import simulate_case
from flexslew_lab.studies.run import prepare
from flexslew_lab.studies.study import Study
from flexslew_lab.studies.ways import Way

CSA = {"kind": "csa", "modes": 1}
LINEAR = {"kind": "floating_oscillator"}
NOISE = {"joint_position": {"noise": 1e-4}, "joint_velocity": {"noise": 1e-3}}
BENCHES: dict[str, tuple[dict[str, Any], str, dict[str, Any]]] = {
    "by equations": (CSA, "lqr", {}),
    "on the equations of motion": (CSA, "output_feedback", {"rate_sigma": 1e-3}),
    # it states the covariance of long after its beginning
    "steady": (
        CSA,
        "output_feedback",
        {"angle_sigma": 5e-4, "rate_sigma": 5e-3, "observer": "steady"},
    ),
    "by matrices": (LINEAR, "lqr", {"filter": {"prediction": "linear"}}),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("bench", "window"),
    representatives(
        [*product(BENCHES, (20,)), ("by matrices", 1), ("by matrices", 400)],
        ("by matrices", 1),
    ),
)
def test_what_a_monitor_doubts_is_left_to_the_bench_and_nothing_else(
    study_of: Callable[..., Study], bench: str, window: int
) -> None:
    """Biases that grow from trial to trial, and an alarm in about every tenth trial; 400 ticks are
    never full."""
    testbed, law, settings = BENCHES[bench]
    goal = {"base_yaw": 0.02, "hub_pitch": -0.01} if testbed is CSA else {"mass": 0.1}
    lie = {"kind": "sensor_bias", "channel": "joint_velocity", "bias": 1e-3}
    trial = {
        "duration": 3.0,
        "testbed": testbed,
        "plan": {"method": "none", "goal": goal, "duration": 2.0},
        "controllers": {law: {**settings, "monitor": {"window": window, "false_alarms": 100.0}}},
        "active": law,
        "allow_faults": True,
        "sensors": NOISE,
        "schedule": [{"at": 1.1, "fault": lie}],
    }
    vary = {"schedule.0.fault.bias": {"loguniform": [1e-4, 1e-1]}}
    ready = prepare(study_of(flown=trial, batch=True, vary=vary))
    ways = ways_of(ready, 12)
    assert set(ways) == {Way.BATCH, Way.MONITORED}
    for k, way in enumerate(ways):
        found = simulate_case(ready.study, case_of(ready.study, ready.samples, k), ready.plans)
        doubted = found.status != "ok" or bool(found.metrics["missed_ticks"])
        assert doubted == (way is Way.MONITORED), k
    require_equal(ready, [k for k, way in enumerate(ways) if way is Way.BATCH])
