"""Trials whose schedule switches from law to law, in a batch as on the bench."""

from collections.abc import Callable
from itertools import pairwise, permutations
from typing import Any

import numpy as np
import pytest
from tests.lab.studies.batch.both_ways import require_equal
from tests.representatives import seeds

from flexslew_lab.studies.batch.fleet import BatchRunner
from flexslew_lab.studies.batch.groups.charge import Charge, charge_of
from flexslew_lab.studies.cases import case_of
from flexslew_lab.studies.run import prepare
from flexslew_lab.studies.study import Study
from flexslew_lab.studies.ways import Way
from flexslew_lab.trial.sources import read_trial
from flexslew_plant.settings import plain

PLAN = {"method": "none", "goal": {"base_yaw": 0.2, "hub_pitch": -0.1}, "duration": 2.0}
LAWS: dict[str, dict[str, Any]] = {  # every kind of form that may take over
    "pd": {"law": "pd_feedforward", "handover_time": 0.3},
    "pid": {"law": "collocated_pid", "ki": [40.0, 30.0], "tracking_time": 0.4},
    "steady": {"law": "output_feedback", "mode": "tracking_b", "observer": "steady"},
    "held": {"law": "output_feedback", "mode": "rigid_hold", "observer": "steady"},
    "lqr": {"law": "lqr", "handover_time": 0.0},
}
NOISE = {"joint_velocity": {"noise": 1e-4}, "joint_position": {"bias": 1e-4, "noise": 1e-5}}


def trial_of(legs: list[tuple[float, str]], **keys: Any) -> dict[str, Any]:
    """Return a trial on csa that these laws fly, each from its time on [s]."""
    names = {name for _, name in legs}
    return {
        "duration": 4.0,
        "testbed": {"modes": 1, "effort_limit": [60.0, 40.0]},
        "plan": PLAN,
        "controllers": {name: LAWS[name] for name in names},
        "active": legs[0][1],
        "sensors": NOISE,
        "actuator": {"lag": 0.05, "slew_rate": 200.0},
        "schedule": [{"at": at, "switch": name} for at, name in legs[1:]],
        **keys,
    }


def tour(names: list[str]) -> list[str]:
    """Return a way from each to every other one: each pair of neighbours once."""
    left = {name: [other for other in names if other != name] for name in names}
    way, back = [names[0]], list[str]()
    while way:  # Hierholzer's
        if left[way[-1]]:
            way.append(left[way[-1]].pop())
        else:
            back.append(way.pop())
    return back[::-1]


@pytest.mark.slow
def test_every_law_takes_over_from_every_other_in_a_batch_as_on_the_bench(
    study_of: Callable[..., Study],
) -> None:
    names = tour(list(LAWS))
    assert set(pairwise(names)) == set(permutations(LAWS, 2))
    legs = [(round(0.17 * k, 2), name) for k, name in enumerate(names)]
    trial = trial_of(legs, duration=3.7)
    trial["schedule"].append({"at": 0.5, "until": 1.0, "disturbance": {"hub_pitch": 3.0}})
    vary = {"sensors.joint_position.bias": {"uniform": [-1e-3, 1e-3]}}
    vary |= {"testbed.effort_limit.0": {"uniform": [20.0, 60.0]}}
    require_equal(prepare(study_of(flown=trial, batch=True, vary=vary)), [0, 3])


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(4))
def test_random_schedules_fly_in_a_batch_as_on_the_bench(
    study_of: Callable[..., Study], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    at = np.sort(rng.choice(np.arange(1, 390), 7, replace=False)) * 0.01
    names = [
        *rng.permutation(list(LAWS)),
        *rng.choice(list(LAWS), 8 - len(LAWS)),
    ]  # all have the same loops
    legs = list(zip([0.0, *np.round(at, 2).tolist()], map(str, names), strict=True))
    limit = {"testbed.effort_limit.0": {"uniform": [20.0, 60.0]}}
    require_equal(prepare(study_of(flown=trial_of(legs), batch=True, vary=limit)), [0, 1, 2])


@pytest.mark.slow
def test_each_member_has_gains_and_a_craft_of_its_own_on_every_leg(
    study_of: Callable[..., Study],
) -> None:
    observatory, _ = read_trial("observatory", None)
    charge = charge_of(observatory)
    assert isinstance(charge, Charge)
    assert charge.segments == ((0, "slewing"), (4200, "settling"), (9000, "pointing"))
    trial = plain(observatory) | {
        "duration": 30.0,
        "plan": {"method": "reference_only", "goal": {"to": [0.1, -0.06, 0.99]}, "duration": 20.0},
        "schedule": [{"at": 9.1, "switch": "settling"}, {"at": 17.0, "switch": "pointing"}],
    }
    trial["testbed"] |= {"pointing_from": 20.0, "pointing_window": 5.0}
    vary = {
        "testbed.platform.mass": {"uniform": [850.0, 950.0]},
        "controllers.settling.kp.0": {"uniform": [10.0, 14.0]},
        "controllers.pointing.kd.1": {"uniform": [180.0, 210.0]},
    }
    ready = prepare(study_of(flown=trial, batch=True, vary=vary))
    cases = [case_of(ready.study, ready.samples, k) for k in range(4)]
    flown, others = zip(*BatchRunner(ready.study, ready.plans).fly(cases), strict=True)
    assert ([*map(len, flown)], others) == ([4], ([],))  # beside each other
    require_equal(ready, [0, 3])


@pytest.mark.parametrize(
    ("schedule", "way"),
    [
        ([{"at": 0.0, "switch": "pid"}], Way.SCHEDULE),  # a beginning in which nobody was before
        ([{"at": 1.0, "switch": "pid"}, {"at": 1.0, "switch": "pd"}], Way.SCHEDULE),  # with a step
        ([{"at": 1.0, "switch": "rests"}], Way.NOT_ALLOWED),  # it follows no plan that moves
        ([{"at": 1.0, "switch": "own"}], Way.SWITCH),  # its state is its own, not an estimator's
    ],
)
def test_what_only_the_bench_knows_is_left_to_it(
    study_of: Callable[..., Study], schedule: list[dict[str, Any]], way: Way
) -> None:
    system = {
        "a": [[0.0]],
        "b": [[1.0]],
        "c": [[1.0], [0.0]],
        "d": [[100.0], [0.0]],
        "inputs": ["error.base_yaw"],
    }
    own = {"law": "linear", "system": system, "allow_unstable": True}
    trial = trial_of([(0.0, "pd"), (1.0, "pid"), (2.0, "lqr")]) | {"schedule": schedule}
    trial["controllers"] |= {"own": own, "rests": {"law": "modal_space"}}
    ready = prepare(study_of(flown=trial, batch=True))
    case = case_of(ready.study, ready.samples, 0)
    left = [
        one.way for _, others in BatchRunner(ready.study, ready.plans).fly([case]) for one in others
    ]
    assert left == [way]
