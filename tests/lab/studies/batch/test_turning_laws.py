"""Laws with a Kalman filter about the plan of a craft that turns in three axes, in a batch."""

from collections.abc import Callable
from typing import Any

import pytest
from tests.lab.studies.batch.both_ways import require_equal
from tests.representatives import representatives

from flexslew_lab.reproduce.scole_flights import example_values
from flexslew_lab.studies.batch.fleet import BatchRunner
from flexslew_lab.studies.cases import case_of
from flexslew_lab.studies.run import prepare
from flexslew_lab.studies.study import Study
from flexslew_lab.studies.ways import Way

LAWS: dict[str, dict[str, Any]] = {
    "lqr": {},
    "output_feedback": {},
    "output_feedback, rest": {"mode": "tracking_b"},
    "proportional_integral": {"tracking_time": 0.5},
}


def trial_of(controllers: dict[str, Any], active: str, *events: dict[str, Any]) -> dict[str, Any]:
    """Return a turn of the craft of three_axes, disturbed and measured with noise."""
    trial = example_values("three_axes")
    trial["plan"] |= {"method": "reference_only", "duration": 14.0, "goal": {"to": [0.2, -0.1, 1]}}
    trial["plan"].pop("reserve")
    return trial | {
        "duration": 20.0,
        "controllers": controllers,
        "active": active,
        "sensors": {"joint_velocity": {"noise": 1e-5}, "joint_position": {"noise": 1e-5}},
        "schedule": [{"at": 2.0, "until": 6.0, "disturbance": {"roll": 0.05}}, *events],
    }


BIAS = {"sensors.joint_position.bias": {"uniform": [-1e-4, 1e-4]}}


@pytest.mark.slow
@pytest.mark.parametrize("law", representatives(LAWS, "output_feedback"))
def test_a_law_about_its_plan_flies_in_a_batch_as_on_the_bench(
    study_of: Callable[..., Study], law: str
) -> None:
    trial = trial_of({"it": {"law": law.partition(",")[0], **LAWS[law]}}, "it")
    require_equal(prepare(study_of(flown=trial, batch=True, vary=BIAS)), [0, 3])


@pytest.mark.matrix
def test_laws_about_their_plan_take_over_in_a_batch_as_on_the_bench(
    study_of: Callable[..., Study],
) -> None:
    names = ("pd_feedforward", "proportional_integral", "lqr", "output_feedback")
    controllers: dict[str, Any] = {name: {} for name in names}
    controllers["pd_feedforward"] = {"kp": [12.0], "kd": [60.0]}
    events = [
        {"at": 3.3 * (k + 1), "switch": name}
        for k, name in enumerate((*names[1:], "proportional_integral", "pd_feedforward"))
    ]
    trial = trial_of(controllers, "pd_feedforward", *events)
    require_equal(prepare(study_of(flown=trial, batch=True, vary=BIAS)), [0, 3])


@pytest.mark.slow
def test_crafts_under_one_law_fly_beside_each_other(study_of: Callable[..., Study]) -> None:
    trial = trial_of({"lqr": {}}, "lqr")
    vary = {"testbed.platform.mass": {"uniform": [190.0, 210.0]}}
    ready = prepare(study_of(flown=trial, batch=True, vary=vary))
    cases = [case_of(ready.study, ready.samples, k) for k in range(3)]
    flown = [some for some, _ in BatchRunner(ready.study, ready.plans).fly(cases)]
    assert [*map(len, flown)] == [3]
    require_equal(ready, [0, 2])


def test_laws_with_a_filter_each_are_left_to_the_bench_after_the_first(
    study_of: Callable[..., Study],
) -> None:
    own = {"filter": {"rate_sigma": 1e-3}}
    trial = trial_of({"lqr": own}, "lqr") | {"duration": 60.0}  # of many ticks
    vary = {"controllers.lqr.filter.rate_sigma": {"uniform": [1e-4, 1e-3]}}
    ready = prepare(study_of(flown=trial, batch=True, vary=vary))
    cases = [case_of(ready.study, ready.samples, k) for k in range(3)]
    flown = [*BatchRunner(ready.study, ready.plans).fly(cases)]
    assert [result.number for some, _ in flown for result in some] == [0]
    left = [(one.case.number, one.way) for _, others in flown for one in others]
    assert left == [(1, Way.ALONG), (2, Way.ALONG)]
