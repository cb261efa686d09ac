"""Crafts on an orbit, and with wheels that are not balanced, fly in a batch as on the bench."""

from collections.abc import Callable
from copy import deepcopy
from typing import Any

import pytest
from tests.lab.studies.batch.both_ways import CRAFT as BOOM
from tests.lab.studies.batch.both_ways import require_equal
from tests.representatives import representatives

from flexslew_lab.studies.batch.groups.batch_trial import BatchBuilder, BatchTrial
from flexslew_lab.studies.cases import Cases, case_of
from flexslew_lab.studies.flight import simulate_case
from flexslew_lab.studies.run import PreparedStudy, prepare
from flexslew_lab.studies.study import Study

AXES = {"roll": [1.0, 0.0, 0.0], "pitch": [0.0, 1.0, 0.0], "yaw": [0.0, 0.0, 1.0]}
CRAFT: dict[str, Any] = BOOM | {
    "wheels": {name: {"axis": axis, "inertia": 0.05, "limit": 20.0} for name, axis in AXES.items()},
    "actuators": {},
    "sensors": {
        "gyro": {"kind": "gyro", "angle_random_walk": 1e-5, "bias_spread": 1e-4},
        "tracker": {"kind": "star_tracker", "across": 1e-4, "about": 5e-4, "interval": 0.2},
    },
}
ORBIT = {  # it and the wheels are strong enough to be seen within seconds
    "altitude": 4e5,
    "inclination": 1.2,
    "dipole": [300.0, -200.0, 100.0],
    "drag_area": 40.0,
    "air_density": 1e-10,
    "drag_centre": [0.0, 1.0, 0.5],
    "solar_area": 2000.0,
    "solar_centre": [0.2, 0.0, 1.0],
    "sun": [0.3, 0.5, -0.4],
}
SHAKING: dict[str, dict[str, Any]] = {
    "roll": {"static_imbalance": 5e-4, "dynamic_imbalance": 1e-4, "place": [0.2, 0.1, 0.0]},
    "yaw": {"harmonics": [{"order": 2.3, "force": 3e-4, "force_phase": 0.4, "torque": 1e-4}]},
}
# keys of the testbed that differ from member to member
OF_ORBIT: dict[str, Any] = {
    "testbed.orbit.altitude": {"uniform": [3e5, 6e5]},
    "testbed.orbit.dipole.0": {"uniform": [200.0, 400.0]},
}
OF_WHEELS: dict[str, Any] = {
    "testbed.wheels.roll.static_imbalance": {"uniform": [2e-4, 1e-3]},
    "testbed.wheels.yaw.harmonics.0.order": {"uniform": [0.5, 4.0]},
}
OF_CRAFT: dict[str, Any] = {
    "testbed.platform.mass": {"uniform": [140.0, 160.0]},
    "testbed.platform.inertia.xx": {"uniform": [35.0, 45.0]},
}


@pytest.fixture
def surrounded(study_of: Callable[..., Study]) -> Callable[..., PreparedStudy]:
    """Return a function that gives a study with an orbit, with wheels that shake, or both."""

    def make(
        orbit: bool, shaking: bool, more: dict[str, Any] | None = None, **law: Any
    ) -> PreparedStudy:
        testbed = deepcopy(CRAFT) | ({"orbit": ORBIT} if orbit else {})
        for name, imbalance in SHAKING.items() if shaking else ():
            testbed["wheels"][name] |= imbalance
        goal = {"axis": [1.0, -0.6, 0.4], "angle": 0.4}
        trial = {
            "duration": 3.0,
            "period": 0.05,
            "testbed": testbed,
            "plan": {"method": "reference_only", "goal": goal, "duration": 2.5},
            "controllers": {"pd_feedforward": {"kp": [20.0], "kd": [60.0], **law}},
        }
        vary = OF_CRAFT | (OF_ORBIT if orbit else {}) | (OF_WHEELS if shaking else {})
        vary = vary | (more or {})
        return prepare(study_of(flown=trial, batch=True, vary=vary))

    return make


@pytest.mark.slow
@pytest.mark.parametrize(
    ("orbit", "shaking", "law"),
    representatives(
        [(True, False, {}), (False, True, {}), (True, True, {}), (True, True, {"attitude": {}})],
        (True, True, {}),
    ),
)
def test_what_acts_from_outside_acts_in_a_batch_as_on_the_bench(
    surrounded: Callable[..., PreparedStudy], orbit: bool, shaking: bool, law: dict[str, Any]
) -> None:
    ready = surrounded(orbit, shaking, **law)
    require_equal(ready, [0, 1, 3])
    alone = surrounded(False, False, **law)
    ends = []
    for one in (ready, alone):
        found = simulate_case(one.study, case_of(one.study, one.samples, 0), one.plans)
        ends.append(found.metrics["goal_error"] or 0.0)
    assert abs(ends[0] - ends[1]) > 1e-5  # 10^4 times what batches may be wrong by


def test_only_members_with_equally_many_harmonics_stand_beside_each_other(
    surrounded: Callable[..., PreparedStudy],
) -> None:
    key = "testbed.wheels.yaw.dynamic_imbalance"
    ready = surrounded(True, True, {key: {"choice": [0.0, 1e-4]}})
    intake, groups = BatchBuilder(ready.study), set()
    for case in Cases(ready.study, ready.samples, range(8)):
        member = intake.batch_trials([case])[0]
        assert isinstance(member, BatchTrial)
        assert member.model.outside is not None
        groups.add((member.together, member.model.outside.numbers.size))
    assert len(groups) == len({together for together, _ in groups}) == 2
