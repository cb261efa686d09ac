"""Quantised sensors and motors fly in a batch as on the bench, but for those that are in doubt."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from tests.lab.studies.batch.both_ways import require_equal, ways_of
from tests.representatives import seeds

from flexslew_lab.studies.run import PreparedStudy, prepare
from flexslew_lab.studies.study import Study
from flexslew_lab.studies.ways import Way

PLAN = {"method": "none", "goal": {"base_yaw": 0.2, "hub_pitch": -0.1}, "duration": 2.0}
CHANNELS = ("joint_position", "joint_velocity", "tip_deflection")


def in_quanta(
    study_of: Callable[..., Study], law: str, quanta: dict[str, float], **keys: Any
) -> PreparedStudy:
    """Return a study of csa in which quanta differ from trial to trial."""
    sensors: dict[str, Any] = {name: {"bias": 1e-5} for name in CHANNELS}
    actuator: dict[str, Any] = {}
    vary = {}
    for name, quantum in quanta.items():
        if name == "motors":
            actuator["quantisation"], key = quantum, "actuator.quantisation"
        else:
            sensors[name]["quantisation"], key = quantum, f"sensors.{name}.quantisation"
        vary[key] = {"relative": {"uniform": [-0.5, 0.5]}}
    trial = {
        "duration": 3.0,
        "testbed": {"modes": 1, "effort_limit": [60.0, 40.0]},
        "plan": PLAN,
        "controllers": {law: {}},
        "active": law,
        "sensors": sensors,
        "actuator": actuator,
        **keys,
    }
    return prepare(study_of(flown=trial, batch=True, vary=vary))


@pytest.mark.slow
@pytest.mark.first(1)
@pytest.mark.parametrize("law", ["pd_feedforward", "lqr"])
@pytest.mark.parametrize("seed", seeds(5))
def test_random_quanta_fly_in_a_batch_as_on_the_bench(
    study_of: Callable[..., Study], law: str, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    quanta = {name: float(10.0 ** rng.uniform(-6.0, -2.0)) for name in CHANNELS}
    ready = in_quanta(study_of, law, quanta | {"motors": float(rng.uniform(0.05, 5.0))})
    certain = [k for k, way in enumerate(ways_of(ready, 8)) if way is Way.BATCH]
    assert len(certain) >= 6  # nearly all: chance has to hit a part in a million of a quantum
    require_equal(ready, certain[:3])


@pytest.mark.slow
def test_quantised_motors_may_lag_and_thrusters_pulse(study_of: Callable[..., Study]) -> None:
    motors = {"lag": 0.05, "slew_rate": 200.0, "shortest_pulse": 0.002, "quantisation": 0.5}
    ready = in_quanta(study_of, "pd_feedforward", {"motors": 0.5}, actuator=motors)
    certain = [k for k, way in enumerate(ways_of(ready, 4)) if way is Way.BATCH]
    require_equal(ready, certain[:3])


@pytest.mark.slow
def test_a_reading_at_the_edge_of_a_quantum_leaves_its_trial_to_the_bench(
    study_of: Callable[..., Study],
) -> None:
    quantum = 1e-4
    parts = [0.5, 0.5 - 1e-7, 0.5 + 1e-7, 0.4, 0.6]  # of a quantum, of a craft at rest
    name = "sensors.joint_position.bias"
    trial = {
        "testbed": {"modes": 1, "effort_limit": [60.0, 40.0]},
        "sensors": {"joint_position": {"quantisation": quantum}},
        "plan": PLAN | {"start": 0.9},
    }
    vary = {name: {"choice": [part * quantum for part in parts]}}
    ready = prepare(study_of(flown=trial, batch=True, vary=vary))
    drawn = [bias / quantum for bias in ready.samples[name].to_pylist()]
    expected = [Way.EDGE if part == pytest.approx(0.5, abs=1e-9) else Way.BATCH for part in drawn]
    assert set(expected) == {Way.EDGE, Way.BATCH}
    assert ways_of(ready, len(drawn)) == expected


@pytest.mark.slow
def test_a_loop_that_is_not_stable_between_two_quanta_is_the_bench_s(
    study_of: Callable[..., Study],
) -> None:
    """What differs by rounding at its beginning differs by half of its move at the end."""
    trial = {
        "duration": 4.0,
        "testbed": {"kind": "floating_oscillator"},
        "plan": {"method": "none", "goal": {"mass": 0.1}, "duration": 3.0},
        "controllers": {"output_feedback": {}},
        "active": "output_feedback",
    }
    quantum = {"sensors.joint_velocity.quantisation": {"choice": [0.0, 4e-4]}}
    ready = prepare(study_of(flown=trial, batch=True, vary=quantum))
    drawn = ready.samples["sensors.joint_velocity.quantisation"].to_pylist()[:6]
    ways = ways_of(ready, len(drawn))
    assert {way for way, step in zip(ways, drawn, strict=True) if step} == {Way.ROUNDING}
