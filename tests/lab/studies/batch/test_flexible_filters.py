"""Laws whose attitude filter knows the appendages' modes fly in a batch as on the bench."""

from collections.abc import Callable
from itertools import product
from typing import Any

import pytest
from tests.lab.studies.batch.both_ways import require_equal
from tests.representatives import representatives

from flexslew_lab.reproduce.scole_flights import example_values
from flexslew_lab.studies.batch.fleet import BatchRunner
from flexslew_lab.studies.cases import case_of, case_trial
from flexslew_lab.studies.run import prepare
from flexslew_lab.studies.study import Study
from flexslew_lab.studies.ways import Way
from flexslew_plant.settings import plain

TRACKER: dict[str, Any] = {"kind": "star_tracker", "across": 5e-6, "about": 4e-5}
ATTITUDE: dict[str, Any] = {"initial_bias": 5e-5, "modes": {}}
PD: dict[str, Any] = {"kp": [30.0], "kd": [70.0], "gyroscopic": True, "attitude": ATTITUDE}
PID: dict[str, Any] = PD | {"law": "collocated_pid", "ki": [3.0]}
WHEELS = {"kind": "wheels"}
MASS = {"testbed.platform.mass": {"uniform": [190.0, 210.0]}}  # each member has its own craft


def trial_of(
    controllers: dict[str, Any], tracker: dict[str, Any], **changes: Any
) -> dict[str, Any]:
    """Return a turn of the craft of three_axes, which finds its attitude itself."""
    sensors = {
        "gyro": {"kind": "gyro", "angle_random_walk": 2e-5, "bias_spread": 5e-5},
        "tracker": TRACKER | tracker,
        "sun": {"kind": "sun_sensor", "sun": [0.2, 0.1, 1.0], "noise": 1e-3, "half_angle": 0.6},
    }
    goal = {"axis": [1.0, -2.0, 0.5], "angle": 0.02}
    return example_values("three_axes", {"testbed": {"sensors": sensors}}) | {
        "period": 0.05,
        "duration": 7.0,
        "plan": {"method": "reference_only", "goal": goal, "duration": 5.0},
        "controllers": controllers,
        "active": next(iter(controllers)),
        "schedule": [{"at": 1.0, "until": 2.0, "disturbance": {"roll": 0.02}}],
        **changes,
    }


TRACKERS: dict[str, dict[str, Any]] = {
    "in time": {"interval": 0.2, "dropout": 0.3},
    "late": {"delay": 0.1, "interval": 0.2, "rate_noise": 1e-3, "blind": [[3.0, 4.0]]},
    "blind at first": {"blind": [[0.0, 1.0]]},
}
FILTERS: dict[str, dict[str, Any]] = {
    "as it is": ATTITUDE,
    "another craft": ATTITUDE
    | {
        "noise_factor": 3.0,
        "modes": {"model": {"platform": {"mass": 150.0}}, "effort_noise": 1e-2, "initial": 1e-4},
    },
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tracker", "filter_"),
    representatives(product(TRACKERS, FILTERS), ("late", "another craft")),
)
def test_a_law_by_such_a_filter_flies_in_a_batch_as_on_the_bench(
    study_of: Callable[..., Study], tracker: str, filter_: str
) -> None:
    law = PD | {"attitude": FILTERS[filter_]}
    trial = trial_of({"pd_feedforward": law}, TRACKERS[tracker])
    gains = {"controllers.pd_feedforward.kp": {"relative": {"uniform": [-0.2, 0.2]}}}
    require_equal(prepare(study_of(flown=trial, batch=True, vary=MASS | gains)), [0, 1, 3])


@pytest.mark.slow
def test_a_torque_by_such_a_filter_is_shared_out_as_on_the_bench(
    study_of: Callable[..., Study],
) -> None:
    trial = trial_of({"pid": PID | {"allocation": WHEELS}}, TRACKERS["late"])
    require_equal(prepare(study_of(flown=trial, batch=True, vary=MASS)), [0, 3])


@pytest.mark.matrix
def test_laws_by_one_such_filter_take_over_as_on_the_bench(study_of: Callable[..., Study]) -> None:
    controllers = {"pid": PID, "pd_feedforward": PD | {"handover_time": 0.4}}
    names = ("pd_feedforward", "pid", "pd_feedforward")
    switches = [{"at": 2.05 * (k + 1), "switch": name} for k, name in enumerate(names)]
    trial = trial_of(controllers, TRACKERS["late"], schedule=switches)
    require_equal(prepare(study_of(flown=trial, batch=True, vary=MASS)), [0, 3])


@pytest.mark.parametrize(
    "modes", [None, {"effort_noise": 1e-2}, {"model": {"platform": {"mass": 1e2}}}]
)
def test_laws_whose_filters_differ_are_left_to_the_bench(
    study_of: Callable[..., Study], modes: dict[str, Any] | None
) -> None:
    own = PD | {"attitude": ATTITUDE | {"modes": modes}}
    switch = [{"at": 2.0, "switch": "pd_feedforward"}]
    trial = trial_of({"pid": PID, "pd_feedforward": own}, {}, schedule=switch)
    ready = prepare(study_of(flown=trial, batch=True, vary=MASS))
    case = case_of(ready.study, ready.samples, 0)
    left = [
        one.way for _, others in BatchRunner(ready.study, ready.plans).fly([case]) for one in others
    ]
    assert left == [Way.SWITCH]


@pytest.mark.slow
def test_crafts_fly_beside_each_other_where_their_trackers_are_equally_late(
    study_of: Callable[..., Study],
) -> None:
    trial = trial_of({"pd_feedforward": PD}, TRACKERS["late"])
    late = {"testbed.sensors.tracker.delay": {"choice": [0.0, 0.1]}}
    ready = prepare(study_of(flown=trial, batch=True, vary=late | MASS))
    cases = [case_of(ready.study, ready.samples, k) for k in range(4)]
    testbeds = [plain(case_trial(ready.study, case).testbed) for case in cases]
    delays = [testbed["sensors"]["tracker"]["delay"] for testbed in testbeds]
    assert len(set(delays)) == 2
    flown = [
        [r.number for r in some] for some, _ in BatchRunner(ready.study, ready.plans).fly(cases)
    ]
    expected = [[k for k in range(4) if delays[k] == delay] for delay in dict.fromkeys(delays)]
    assert flown == expected
