"""Faults in a schedule fly in a batch as on the bench, each member with its own."""

from collections.abc import Callable
from copy import deepcopy
from itertools import product
from typing import Any

import numpy as np
import pytest
from tests.lab.studies.batch.both_ways import CRAFT, require_equal, ways_of
from tests.representatives import representatives, seeds

from flexslew_lab.studies.batch.fleet import BatchRunner
from flexslew_lab.studies.cases import case_of
from flexslew_lab.studies.flight import simulate_case
from flexslew_lab.studies.run import prepare
from flexslew_lab.studies.study import Study
from flexslew_lab.studies.ways import Way
from flexslew_plant.faults import FAULTS
from flexslew_plant.testbeds import read_testbed

PLAN = {"method": "none", "goal": {"base_yaw": 0.2, "hub_pitch": -0.1}, "duration": 2.0}
LAWS: dict[str, dict[str, Any]] = {
    "pd": {"law": "pd_feedforward", "handover_time": 0.3},
    "pid": {"law": "collocated_pid", "ki": [40.0, 30.0], "tracking_time": 0.4},
    "lqr": {"law": "lqr", "handover_time": 0.0},
}
SIZES = {  # of what is random in faults that have it
    "effort": [-20.0, 20.0],
    "gain": [-0.2, 1.2],
    "bias": [-2e-3, 2e-3],
    "probability": [0.05, 0.4],
}


def faulty(study_of: Callable[..., Study], faults: list[dict[str, Any]], **keys: Any) -> Study:
    """Return a study of csa in which times and sizes of the faults differ from trial to trial."""
    schedule, vary = [{"at": 0.3, "until": 0.9, "disturbance": {"hub_pitch": 3.0}}], {}
    for k, fault in enumerate(faults, start=1):
        at = 0.2 + 0.13 * k
        schedule.append({"at": at, "until": at + 1.5, "fault": fault})
        vary[f"schedule.{k}.at"] = {"uniform": [at - 0.1, at + 0.4]}
        for name in fault.keys() & SIZES.keys():
            vary[f"schedule.{k}.fault.{name}"] = {"uniform": SIZES[name]}
    vary["schedule.0.disturbance.hub_pitch"] = {"uniform": [1.0, 8.0]}
    schedule += keys.pop("switches", [])
    vary |= keys.pop("vary", {})
    trial = {
        "duration": 3.0,
        "testbed": {"modes": 1, "effort_limit": [60.0, 40.0]},
        "plan": PLAN,
        "controllers": LAWS,
        "active": "pd",
        "allow_faults": True,
        "sensors": {"joint_velocity": {"noise": 1e-4}, "tip_deflection": {"noise": 1e-4}},
        "schedule": schedule,
        **keys,
    }
    return study_of(flown=trial, batch=True, vary=vary)


NAN = {"kind": "sensor_nan", "channel": "joint_position"}
NAN_TIPS = {"kind": "sensor_nan", "channel": "tip_deflection"}
ZERO = {"kind": "sensor_dropout", "channel": "joint_position"}
LOST = {"at": 1.1, "until": 1.22, "fault": {"kind": "command_lost"}}
KINDS: list[dict[str, Any]] = [
    {"kind": "actuator_stuck", "joint": "hub_pitch"},
    {"kind": "actuator_stuck", "joint": "base_yaw", "effort": 5.0},
    {"kind": "actuator_gain", "joint": "hub_pitch", "gain": 0.5},
    {"kind": "command_delay", "ticks": 3},
    {"kind": "command_delay", "ticks": 0.4, "joint": "base_yaw"},
    {"kind": "command_delay", "ticks": 2.6, "joint": "hub_pitch"},
    {"kind": "command_lost", "probability": 0.2},
    {"kind": "command_late", "probability": 0.2, "ticks": 2, "seed": 4},
    {"kind": "command_reordered", "probability": 0.2},
    {"kind": "command_duplicated", "probability": 0.3},
    {"kind": "sensor_bias", "channel": "joint_position", "of": "base_yaw", "bias": 1e-3},
    {"kind": "sensor_bias", "channel": "joint_velocity", "bias": 1e-3},
    {"kind": "sensor_dropout", "channel": "joint_velocity", "probability": 0.1},
    {"kind": "sensor_dropout", "channel": "tip_deflection"},
    {"kind": "sensor_dropout", "channel": "root_curvature"},
    {"kind": "sensor_freeze", "channel": "joint_velocity", "of": "hub_pitch"},
    {"kind": "sensor_freeze", "channel": "joint_position"},
]


TIPS = ("tip_deflection", "root_curvature")


def test_every_fault_but_those_that_silence_a_law_is_flown_alone_below() -> None:
    left = {"controller_silent", "sensor_nan"}  # which take an answer, or an estimate
    assert {fault["kind"] for fault in KINDS} | left == FAULTS.keys()


@pytest.mark.first(4)
@pytest.mark.parametrize(
    ("law", "fault"),
    # on joints, and on an estimate with tips, whose design takes longer
    representatives(
        product(["pd", "lqr"], KINDS),
        *product(["pd"], [fault for fault in KINDS if fault.get("channel") not in TIPS]),
        *product(["lqr"], [fault for fault in KINDS if fault.get("channel") in TIPS]),
    ),
    ids=lambda value: value if isinstance(value, str) else "-".join(map(str, value.values())),
)
def test_a_fault_acts_in_a_batch_as_on_the_bench(
    study_of: Callable[..., Study], law: str, fault: dict[str, Any]
) -> None:
    ready = prepare(faulty(study_of, [fault], active=law, max_missed=100))
    require_equal(ready, [0, 1, 2])


def test_delays_and_gains_that_overlap_act_as_on_the_bench(study_of: Callable[..., Study]) -> None:
    faults = [
        {"kind": "actuator_gain", "joint": "hub_pitch", "gain": 0.1},
        {"kind": "command_delay", "ticks": 2.6, "joint": "hub_pitch"},
        {"kind": "command_delay", "ticks": 3},
        {"kind": "actuator_gain", "joint": "base_yaw", "gain": -0.3},
    ]
    require_equal(prepare(faulty(study_of, faults, max_missed=100)), [0, 1, 2])


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(4, default=2))  # each kind of motors
def test_random_faults_fly_in_a_batch_as_on_the_bench(
    study_of: Callable[..., Study], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    faults = [KINDS[k] for k in rng.integers(len(KINDS), size=5)]
    motors = {"lag": 0.05, "slew_rate": 200.0} if seed % 2 else {"shortest_pulse": 0.002}
    switches = [{"at": 1.31, "switch": "pid"}, {"at": 2.2, "switch": "lqr"}]
    study = faulty(study_of, faults, switches=switches, actuator=motors, max_missed=100)
    ready = prepare(study)
    answered = [k for k, way in enumerate(ways_of(ready, 8)) if way is Way.BATCH]
    assert len(answered) >= 3  # of the others the first answer of a newcomer is lost
    require_equal(ready, answered[:3])


SILENT = {"at": 0.9, "fault": {"kind": "controller_silent", "controller": "pd"}}


@pytest.mark.slow
def test_who_falls_silent_is_followed_by_a_fallback_as_on_the_bench(
    study_of: Callable[..., Study],
) -> None:
    lost = {"kind": "command_lost", "probability": 0.5}
    switches = [SILENT, {"at": 1.6, "switch": "pid"}]
    study = faulty(study_of, [lost], switches=switches, fallback=["pd", "lqr", "pid"], max_missed=4)
    ready = prepare(study)
    flies = [k for k, way in enumerate(ways_of(ready, 12)) if way is Way.BATCH]
    assert len(flies) >= 3
    require_equal(ready, flies[:4])
    bench = simulate_case(ready.study, case_of(ready.study, ready.samples, flies[0]), ready.plans)
    assert (bench.metrics["fallbacks"] or 0.0) >= 1.0


def blind(at: float, until: float, **keys: Any) -> dict[str, Any]:
    """Return the entry of a schedule that lets joints read NaN."""
    return {"at": at, "until": until, "fault": {**NAN, **keys}}


@pytest.mark.slow
@pytest.mark.parametrize("law", representatives(LAWS, "lqr"))
def test_who_reads_no_numbers_for_a_while_begins_anew_as_on_the_bench(
    study_of: Callable[..., Study], law: str
) -> None:
    switches = [blind(0.5, 0.53), blind(1.4, 1.44, channel="joint_velocity", of="hub_pitch")]
    switches.append({"at": 2.2, "switch": next(other for other in LAWS if other != law)})
    require_equal(prepare(faulty(study_of, [], active=law, switches=switches)), [0, 3])


@pytest.mark.slow
@pytest.mark.parametrize(
    "switches",
    [
        [{"at": 0.7, "until": 1.9, "fault": NAN_TIPS}],  # nobody in charge listens
        [blind(0.0, 0.03)],
        # frozen without a number, and read as zero
        [blind(0.5, 0.6), {"at": 0.55, "until": 0.63, "fault": KINDS[-1]}],
        [blind(0.5, 0.9), {"at": 0.5, "until": 0.9, "fault": ZERO}],
    ],
    ids=["tips", "first", "frozen", "zero"],
)
def test_who_listens_to_what_reads_no_numbers_is_known_before_the_flight(
    study_of: Callable[..., Study], switches: list[dict[str, Any]]
) -> None:
    study = faulty(study_of, [], switches=switches, max_missed=30, controllers={"pd": LAWS["pd"]})
    require_equal(prepare(study), [0, 3])


@pytest.mark.slow
def test_a_filter_that_hears_tips_is_silent_while_they_read_no_numbers(
    study_of: Callable[..., Study],
) -> None:
    switches = [{"at": 0.7, "until": 0.9, "fault": NAN_TIPS}]
    laws = {"lqr": {"filter": {"tip_sigma": 1e-4}}}
    study = faulty(study_of, [], active="lqr", controllers=laws, switches=switches, max_missed=30)
    require_equal(prepare(study), [0, 3])


@pytest.mark.slow
@pytest.mark.parametrize(
    "switches",
    [
        [SILENT],
        [blind(0.9, 5.0)],  # to the end: its reason says so
        [blind(0.9, 1.1), {"at": 0.5, "until": 1.0, "fault": NAN_TIPS}],
        [blind(0.0, 0.2)],
        [{"at": 0.4, "switch": "lqr"}, blind(0.9, 5.0)],
        [SILENT, {"at": 1.5, "until": 2.5, "disturbance": {"base_yaw": 1e30}}],
    ],
    ids=["silent", "blind", "blind-for-a-while", "first", "filter", "lost-under-the-brake"],
)
def test_a_trial_that_ends_in_the_brake_fails_for_the_reason_of_the_bench(
    study_of: Callable[..., Study], switches: list[dict[str, Any]]
) -> None:
    study = faulty(study_of, [], switches=switches, fallback=["pid"] * (SILENT not in switches))
    require_equal(prepare(study), [0, 3], "failed")


def test_who_was_blind_when_the_brake_took_over_is_told_though_all_see_again(
    study_of: Callable[..., Study],
) -> None:
    ready = prepare(faulty(study_of, [], switches=[blind(0.9, 1.1)]))
    found = simulate_case(ready.study, case_of(ready.study, ready.samples, 0), ready.plans)
    assert found.reason == "pd is silent: the brake takes over; pd: its estimate is not finite"


def test_faults_of_one_study_fly_beside_each_other(study_of: Callable[..., Study]) -> None:
    study = faulty(study_of, [KINDS[0], KINDS[3], KINDS[6], KINDS[12]], max_missed=100)
    ready = prepare(study)
    cases = [case_of(ready.study, ready.samples, k) for k in range(12)]
    groups = [len(some) for some, _ in BatchRunner(ready.study, ready.plans).fly(cases) if some]
    assert groups == [12]


@pytest.mark.parametrize(
    ("way", "keys"),
    [
        (Way.BRAKE, {"switches": [SILENT, {"at": 1.5, "switch": "pid"}]}),
        (Way.SCHEDULE, {"switches": [blind(1.19, 1.23), {"at": 1.2, "switch": "pid"}]}),
        (Way.SCHEDULE, {"switches": [LOST, {"at": 1.2, "switch": "lqr"}], "max_missed": 100}),
    ],
)
def test_what_only_the_bench_knows_is_left_to_it(
    study_of: Callable[..., Study], way: Way, keys: dict[str, Any]
) -> None:
    assert ways_of(prepare(faulty(study_of, [], **keys)), 1) == [way]


@pytest.mark.slow
def test_a_fault_that_the_bench_refuses_is_refused(study_of: Callable[..., Study]) -> None:
    trial = {
        "testbed": {"modes": 1, "effort_limit": [60.0, 40.0]},
        "allow_faults": True,
        "schedule": [
            {"at": 0.5, "fault": {"kind": "actuator_stuck", "joint": "base_yaw", "effort": 50.0}}
        ],
    }
    effort = {"schedule.0.fault.effort": {"uniform": [40.0, 70.0]}}  # within the limit, and beyond
    ready = prepare(study_of(flown=trial, batch=True, vary=effort))
    efforts = ready.samples["schedule.0.fault.effort"].to_pylist()
    ways = [Way.BATCH if effort <= 60.0 else Way.NOT_ALLOWED for effort in efforts]
    assert len(set(ways)) == 2
    assert ways_of(ready, len(ways)) == ways


@pytest.mark.slow
@pytest.mark.parametrize(
    "attitude", representatives([{}, {"modes": {}}], {}), ids=["rigid", "modes"]
)
def test_instruments_and_filters_of_an_attitude_are_misled_alike(
    study_of: Callable[..., Study], attitude: dict[str, Any]
) -> None:
    axes = {"roll": [1.0, 0.0, 0.0], "pitch": [0.0, 1.0, 0.0], "yaw": [0.0, 0.0, 1.0]}
    testbed = deepcopy(CRAFT)
    testbed["wheels"] = {n: {"axis": a, "inertia": 0.05, "limit": 20.0} for n, a in axes.items()}
    testbed["sensors"] = {
        "gyro": {"kind": "gyro", "angle_random_walk": 1e-5, "bias_spread": 1e-4},
        "tracker": {"kind": "star_tracker", "across": 1e-4, "about": 5e-4, "interval": 0.2},
    }
    names = read_testbed(testbed, "test").model().appendages.names
    gyro = next(name for name in names if name.startswith("gyro"))
    faults = [
        {"kind": "sensor_bias", "channel": "tip_deflection", "of": gyro, "bias": 1e-3},
        {"kind": "sensor_freeze", "channel": "joint_velocity", "of": "yaw"},
        {"kind": "sensor_dropout", "channel": "tip_deflection", "probability": 0.2},
        {"kind": "actuator_gain", "joint": "pitch", "gain": 0.6},
    ]
    trial = {
        "duration": 3.0,
        "period": 0.05,
        "testbed": testbed,
        "plan": {
            "method": "reference_only",
            "goal": {"axis": [1.0, -0.6, 0.4], "angle": 0.4},
            "duration": 2.5,
        },
        "controllers": {"pd_feedforward": {"kp": [20.0], "kd": [60.0], "attitude": attitude}},
        "allow_faults": True,
        "schedule": [{"at": 0.5 * k, "fault": fault} for k, fault in enumerate(faults)],
    }
    vary = {
        "testbed.platform.mass": {"uniform": [140.0, 160.0]},
        "schedule.3.fault.gain": {"uniform": [0.3, 0.9]},
    }
    require_equal(prepare(study_of(flown=trial, batch=True, vary=vary)), [0, 1, 3])


@pytest.mark.slow
@pytest.mark.parametrize("window", representatives([1, 7, 400], 7))
def test_what_the_drive_finds_implausible_is_left_to_the_bench_and_nothing_else(
    study_of: Callable[..., Study], window: int
) -> None:
    """400 ticks are never full."""
    jump = {"kind": "sensor_bias", "channel": "joint_position", "bias": 1e-3}
    frozen = {"kind": "sensor_freeze", "channel": "joint_velocity"}
    judged = {"plausibility": {"window": window}, "fallback": ["pid"]}
    allowed = {"plausibility.rate_difference": {"loguniform": [1e-3, 1.0]}}
    ready = prepare(faulty(study_of, [jump, frozen], vary=allowed, **judged))
    ways = ways_of(ready, 12)
    assert set(ways) == {Way.BATCH, Way.MONITORED}
    for k, way in enumerate(ways):
        case = case_of(ready.study, ready.samples, k)
        found = simulate_case(ready.study, case, ready.plans)
        left = found.status != "ok" or bool(found.metrics["fallbacks"])  # the brake at last
        assert found.status == "ok" or "uses implausible sensors" in found.reason
        assert left == (way is Way.MONITORED), k
    require_equal(ready, [k for k, way in enumerate(ways) if way is Way.BATCH])
