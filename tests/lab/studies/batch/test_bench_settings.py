"""Motors, sensors at single tips and metrics of a trial's own, in a batch as on the bench."""

from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
from tests.lab.studies.batch.both_ways import CRAFT, require_equal
from tests.representatives import representatives

from flexslew_lab.studies.batch.fleet import BatchRunner
from flexslew_lab.studies.cases import case_of
from flexslew_lab.studies.flight import simulate_case
from flexslew_lab.studies.run import prepare
from flexslew_lab.studies.study import Study
from flexslew_lab.studies.ways import Way

PLAN = {
    "method": "reference_only",
    "goal": {"base_yaw": 0.1, "hub_pitch": -0.05},
    "start": 0.5,
    "duration": 3.0,
}


@pytest.mark.slow
def test_time_in_which_two_drives_are_at_their_limits_counts_once(
    study_of: Callable[..., Study],
) -> None:
    trial = {
        "duration": 4.0,
        "testbed": {"modes": 1, "effort_limit": [20.0, 10.0]},
        "plan": {"method": "none", "goal": {"base_yaw": 0.1, "hub_pitch": -0.05}, "duration": 1.0},
        "controllers": {"pd_feedforward": {"kp": [460.0, 460.0], "kd": [920.0, 920.0]}},
    }
    vary = {"testbed.parameters.bending_stiffness": {"relative": {"uniform": [-0.2, 0.2]}}}
    ready = prepare(study_of(flown=trial, batch=True, vary=vary))
    require_equal(ready, [0, 1])
    metrics = simulate_case(
        ready.study, case_of(ready.study, ready.samples, 0), ready.plans
    ).metrics
    assert (metrics["saturated_time"] or 0.0) > 1.0  # both are from the start


INTEGRAL = {
    "a": [[0.0, 0.0], [0.0, 0.0]],
    "b": [[0.1, 0.0, 0.0, 0.0], [0.0, 0.1, 0.0, 0.0]],
    "c": [[100.0, 0.0], [0.0, 100.0]],
    "d": [[300.0, 0.0, 600.0, 0.0], [0.0, 300.0, 0.0, 600.0]],
}
OWN_WINDING: dict[str, dict[str, Any]] = {  # laws that stop their integral by their own demand
    "linear": {
        "duration": 4.0,
        "testbed": {"modes": 1},
        "plan": PLAN,
        "controllers": {"linear": {"system": INTEGRAL, "tracking_time": 0.5}},
    },
    "planned_gains": {
        "duration": 1.0,
        "period": 0.002,
        "testbed": {"kind": "varying_oscillator"},
        "plan": {
            "method": "retargeting",
            "duration": 1.0,
            "gains": "perturbation",
            "weights": {"state": 1.0, "force": 1.0, "force_rate": 0.01},
        },
        "controllers": {"planned_gains": {"tracking_time": 0.5}},
    },
}
BETWEEN: dict[str, dict[str, Any]] = {  # what stands between a demand and what is applied
    "lag": {"actuator": {"lag": 0.05}},
    "gain": {"allow_faults": True, "schedule": [{"at": 0.3, "fault": {"kind": "actuator_gain"}}]},
    "lost": {
        "allow_faults": True,
        "schedule": [{"at": 0.3, "fault": {"kind": "command_lost", "probability": 0.1}}],
    },
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "between"),
    representatives(
        [("linear", "lost"), ("linear", "gain"), ("planned_gains", "lag")], ("linear", "lost")
    ),
)
def test_an_integral_does_not_wind_back_by_what_motors_make_of_its_demand(
    study_of: Callable[..., Study], law: str, between: str
) -> None:
    trial = deepcopy({**OWN_WINDING[law], **BETWEEN[between], "active": law})
    joint = "mass" if law == "planned_gains" else "base_yaw"
    if between == "gain":
        trial["schedule"][0]["fault"] |= {"joint": joint, "gain": 0.8}
    parameter = "stiffness" if law == "planned_gains" else "base_inertia"
    vary = {f"testbed.parameters.{parameter}": {"relative": {"uniform": [-0.1, 0.1]}}}
    require_equal(prepare(study_of(flown=trial, batch=True, vary=vary)), [0, 1])


def test_a_sensor_with_noise_flies_beside_one_without(study_of: Callable[..., Study]) -> None:
    trial = {"sensors": {"joint_position": {"bias": 1e-3}}}
    vary = {"sensors.joint_position.noise": {"choice": [0.0, 1e-4]}}
    ready = prepare(study_of(flown=trial, batch=True, vary=vary))
    noise = ready.samples["sensors.joint_position.noise"].to_pylist()
    still = noise.index(0.0)
    require_equal(ready, [still, noise.index(1e-4, still)])


@pytest.mark.slow
def test_joints_that_stick_fly_in_a_batch_as_on_the_bench(study_of: Callable[..., Study]) -> None:
    trial = {
        "duration": 5.0,
        "testbed": {"modes": 1, "effort_limit": [60.0, 40.0]},
        "plan": PLAN,
        "controllers": {"pd_feedforward": {"kp": 100.0, "kd": 200.0}},
        "sensors": {"joint_velocity": {"noise": 1e-4}},
        "actuator": {"viscous_friction": {"hub_pitch": 0.5}, "coulomb_friction": 2.0},
        "schedule": [{"at": 2.0, "until": 2.5, "disturbance": {"base_yaw": 10.0}}],
    }
    vary = {
        "actuator.coulomb_friction": {"loguniform": [0.01, 10.0]},
        "actuator.coulomb_speed": {"loguniform": [1e-5, 1e-2]},
        "actuator.viscous_friction.hub_pitch": {"uniform": [0.0, 20.0]},
    }
    require_equal(prepare(study_of(flown=trial, batch=True, vary=vary)), [0, 1, 2, 3])


@pytest.mark.slow
def test_benches_with_limits_of_their_own_fly_beside_each_other(
    study_of: Callable[..., Study],
) -> None:
    step = {"method": "none", "goal": {"base_yaw": 0.3, "hub_pitch": 0.2}, "duration": 2.0}
    limit = {"testbed.effort_limit.0": {"uniform": [5.0, 60.0]}}
    ready = prepare(study_of(flown={"duration": 4.0, "plan": step}, batch=True, vary=limit))
    cases = [case_of(ready.study, ready.samples, k) for k in range(4)]
    groups = [
        [one.number for one in some] for some, _ in BatchRunner(ready.study, ready.plans).fly(cases)
    ]
    assert groups == [[0, 1, 2, 3]]
    require_equal(ready, [0, 1, 2, 3])


@pytest.mark.slow
def test_sensors_at_tips_with_errors_of_their_own_fly_in_a_batch_as_on_the_bench(
    study_of: Callable[..., Study],
) -> None:
    testbed = deepcopy(CRAFT)
    shake = {"kind": "accelerometer", "appendage": "boom", "direction": [1.0, 0.0, 0.0]}
    testbed["sensors"] = {"shake": shake | {"noise": 1e-3}}
    trial = {
        "duration": 3.0,
        "testbed": testbed,
        "plan": {"method": "reference_only", "goal": {"roll": 0.2}, "duration": 2.0},
        "controllers": {"pd_feedforward": {"kp": [30.0], "kd": [60.0]}},
        "sensors": {"joint_velocity": {"noise": 1e-4}, "tip_deflection": {"noise": 1e-3}},
    }
    kp = {"controllers.pd_feedforward.kp": {"uniform": [25.0, 35.0]}}
    require_equal(prepare(study_of(flown=trial, batch=True, vary=kp)), [0, 3])


METRIC = '''
from flexslew_lab.metrics import Key

class Travel:
    """How far the first joint travels in all."""

    KEYS = {"travel": Key("rad or m", False, "distance travelled by the first joint")}

    def __init__(self, setup):
        self.way, self.last = 0.0, 0.0

    def add(self, block):
        for q in block.position[:, 0]:
            self.way, self.last = self.way + abs(q - self.last), q

    def result(self, ending):
        if self.way > MOST:
            raise ValueError("too far")
        return {"travel": float(self.way)}
'''


def travelling(study_of: Callable[..., Study], folder: Path, most: float) -> Study:
    """Return a study of trials with a metric that raises beyond a way [rad]."""
    (folder / "travel.py").write_text(METRIC.replace("MOST", str(most)))
    trial = {
        "duration": 25.0,  # the truth of more ticks than are measured at once
        "testbed": {"modes": 1},
        "plan": PLAN,
        "metrics": [f"{folder / 'travel.py'}:Travel"],
    }
    kd = {"controllers.pd_feedforward.kd.0": {"uniform": [50.0, 900.0]}}
    return study_of(flown=trial, batch=True, vary=kd)


@pytest.mark.slow
def test_metrics_of_a_trial_s_own_are_those_of_the_bench(
    study_of: Callable[..., Study], tmp_path: Path
) -> None:
    ready = prepare(travelling(study_of, tmp_path, 1e9))
    assert "travel" in ready.columns
    require_equal(ready, [0, 1, 2])


def test_a_metric_that_raises_leaves_its_trial_alone_to_the_bench(
    study_of: Callable[..., Study], tmp_path: Path
) -> None:
    ready = prepare(travelling(study_of, tmp_path, 0.25))
    cases = [case_of(ready.study, ready.samples, k) for k in range(12)]
    flown, lost = next(BatchRunner(ready.study, ready.plans).fly(cases))
    assert flown
    assert {one.way for one in lost} == {Way.METRICS}
    assert len(flown) + len(lost) == len(cases)
