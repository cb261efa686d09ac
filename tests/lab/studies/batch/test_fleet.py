"""Trials in a batch are the trials of the bench: every metric, every law, every testbed."""

from collections.abc import Callable
from copy import deepcopy
from typing import Any

import numpy as np
import pytest
from tests.lab.studies.batch.both_ways import CRAFT, require_equal
from tests.representatives import representatives

from flexslew_lab.studies.batch.fleet import BatchRunner
from flexslew_lab.studies.batch.groups.batch_trial import BatchBuilder, BatchTrial
from flexslew_lab.studies.cases import case_of
from flexslew_lab.studies.execution.worker import Job
from flexslew_lab.studies.flight import FlightResult, simulate_case
from flexslew_lab.studies.run import PreparedStudy, prepare
from flexslew_lab.studies.study import Study
from flexslew_lab.studies.ways import Way
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.compiled.sine_cosine import angle_sum, sine_cosine
from flexslew_plant.testbeds.compiled.traced_kernel import traced_kernel
from flexslew_plant.testbeds.csa import CsaTestbed

LAWS: dict[str, dict[str, Any]] = {
    "pd_feedforward": {"kp": [300.0, 460.0], "kd": 800.0},
    "collocated_pid": {},
    "lqr": {},
    "proportional_integral": {},
    "output_feedback": {"mode": "tracking_b"},
    "output_feedback, steady": {
        "mode": "tracking_b",
        "observer": "steady",
        "attitude_gain": 0.1,
    },
    "output_feedback, on the equations of motion": {},
}
PLAN = {
    "method": "reference_only",
    "goal": {"base_yaw": 0.1, "hub_pitch": -0.05},
    "start": 0.5,
    "duration": 5.0,
}
NOISE = {
    "joint_velocity": {"noise": 1e-3, "bias": 1e-4},
    "tip_deflection": {"noise": 1e-2},
    "root_curvature": {"noise": 1e-4},
}
DISTURBED = [{"at": 2.0, "until": 3.0, "disturbance": {"base_yaw": 20.0}}]


STEADY = {"mode": "tracking_b", "observer": "steady"}


@pytest.fixture
def prepared(study_of: Callable[..., Study]) -> Callable[..., PreparedStudy]:
    """Return a function that gives a study in a batch with another trial."""

    def make(
        vary: dict[str, Any] | None = None, replan: bool = False, **trial: Any
    ) -> PreparedStudy:
        whole = {"duration": 9.0, "testbed": {"modes": 3, "damping_ratio": 0.01}, "plan": PLAN}
        keys = {} if vary is None else {"vary": vary}
        return prepare(study_of(flown=whole | trial, batch=True, replan=replan, **keys))

    return make


@pytest.mark.first(1)
@pytest.mark.parametrize(
    "law",
    representatives(LAWS, "proportional_integral", "output_feedback, on the equations of motion"),
)
def test_every_linear_law_flies_as_on_the_bench(
    prepared: Callable[..., PreparedStudy], law: str
) -> None:
    name = law.split(",", maxsplit=1)[0]
    ready = prepared(controllers={name: LAWS[law]}, active=name, sensors=NOISE, schedule=DISTURBED)
    require_equal(ready, [0, 5])


@pytest.mark.slow
@pytest.mark.parametrize(
    "law",
    representatives([STEADY, {}], STEADY),
    ids=["linear", "equations"],
)
def test_what_a_law_believes_of_each_bench_is_its_own(
    prepared: Callable[..., PreparedStudy], law: dict[str, Any]
) -> None:
    belief = {"model": {"damping_ratio": 0.02}}  # all else as on the bench that it meets
    keys: dict[str, Any] = {"controllers": {"output_feedback": law | belief}}
    keys |= {"active": "output_feedback"}
    require_equal(prepared(replan=True, **keys), [0, 5])
    ready = prepared(**keys)  # one plan for all: they fly beside each other
    cases = [case_of(ready.study, ready.samples, k) for k in (0, 5)]
    assert [len(some) for some, _ in BatchRunner(ready.study, ready.plans).fly(cases)] == [2]
    require_equal(ready, [0, 5])


@pytest.mark.parametrize(
    ("way", "trial"),
    [
        (
            Way.NO_PLAN,
            {
                "plan": None,
                "controllers": {"output_feedback": {"mode": "tracking_b", "observer": "steady"}},
                "active": "output_feedback",
                "sensors": {"joint_position": {"bias": 1e-4}},
            },
        ),
        (
            Way.MONITORED,
            {
                "controllers": {
                    "output_feedback": {"mode": "tracking_b", "observer": "steady", "monitor": {}}
                },
                "active": "output_feedback",
            },
        ),
    ],
)
def test_what_batches_do_not_know_is_left_to_the_bench_which_says_why(
    prepared: Callable[..., PreparedStudy], way: Way, trial: dict[str, Any]
) -> None:
    ready = prepared(vary={"testbed.damping_ratio": {"uniform": [0.0, 0.1]}}, **trial)
    cases = [case_of(ready.study, ready.samples, k) for k in range(3)]
    found = list(BatchRunner(ready.study, ready.plans).fly(cases))
    assert found == [([], [(case, way) for case in cases])]
    results: list[FlightResult] = []
    Job(ready.study, ready.plans).flyer().fly(cases[:1], results.extend)
    assert [result.way for result in results] == [way]


@pytest.mark.slow
def test_a_step_to_the_goal_is_one_plan_for_all_benches(
    prepared: Callable[..., PreparedStudy],
) -> None:
    step = {"method": "none", "goal": {"base_yaw": 0.1}, "duration": 5.0}
    stiffness = {"testbed.parameters.bending_stiffness": {"relative": {"uniform": [-0.2, 0.2]}}}
    ready = prepared(vary=stiffness, plan=step)
    assert len(ready.plans.made) == 1
    require_equal(ready, [0, 1, 2])
    intake = BatchBuilder(ready.study)
    trials = [intake.batch_trials([case_of(ready.study, ready.samples, k)])[0] for k in range(3)]
    assert len({trial.law for trial in trials if isinstance(trial, BatchTrial)}) == 1


@pytest.mark.slow
def test_steps_from_places_of_their_own_are_measured_as_on_the_bench(
    prepared: Callable[..., PreparedStudy],
) -> None:
    step = {"method": "none", "goal": {"base_yaw": 0.1, "hub_pitch": 0.0}, "duration": 5.0}
    place = {"testbed.initial.base_yaw": {"uniform": [-0.2, 0.05]}}
    soft = {"pd_feedforward": {"kp": 460.0, "kd": 100.0}}
    ready = prepared(vary=place, plan=step, controllers=soft)
    require_equal(ready, [0, 1, 2])
    first = simulate_case(ready.study, case_of(ready.study, ready.samples, 0), ready.plans)
    assert first.metrics["overshoot"] == first.metrics["overshoot.base_yaw"]
    assert (first.metrics["overshoot"] or 0.0) > 0.0
    assert first.metrics["overshoot.hub_pitch"] is None


def test_a_manoeuvre_that_never_begins_has_no_overshoot_and_does_not_settle(
    prepared: Callable[..., PreparedStudy],
) -> None:
    ready = prepared(duration=0.5, plan=PLAN | {"start": 0.51})
    require_equal(ready, [0, 1])
    alone = simulate_case(ready.study, case_of(ready.study, ready.samples, 0), ready.plans)
    assert alone.metrics["overshoot.base_yaw"] is None
    assert alone.metrics["settling_time.hub_pitch"] is None
    require_equal(prepared(duration=0.51, plan=PLAN | {"start": 0.51}), [0])


def test_a_result_does_not_depend_on_its_neighbours(prepared: Callable[..., PreparedStudy]) -> None:
    ready = prepared()
    cases = [case_of(ready.study, ready.samples, k) for k in range(12)]
    together = [r for some, _ in BatchRunner(ready.study, ready.plans).fly(cases) for r in some]
    alone = [
        next(BatchRunner(ready.study, ready.plans).fly([case]))[0][0] for case in reversed(cases)
    ]
    assert together == alone[::-1]


OTHERS: dict[str, dict[str, Any]] = {
    "floating_oscillator": {"damping_ratio": 0.02},
    "varying_oscillator": {},
    "hub_with_appendages": {"damping_ratio": 0.02},
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", representatives(OTHERS, "varying_oscillator"))
def test_any_testbed_whose_joints_come_first_flies_in_batches(
    study_of: Callable[..., Study], kind: str
) -> None:
    testbed = {"kind": kind, **OTHERS[kind]}
    (joint,) = read_testbed(testbed, "test").model().joint_names
    trial = {
        "duration": 3.0,
        "testbed": testbed,
        "plan": {"method": "reference_only", "goal": {joint: 0.1}, "start": 0.2, "duration": 2.0},
        "controllers": {"pd_feedforward": {"kp": 2.0, "kd": 2.0}},
        "schedule": [{"at": 1.0, "until": 2.0, "disturbance": {joint: 0.01}}],
        "sensors": {"joint_velocity": {"noise": 1e-3}},
    }
    kp = {"controllers.pd_feedforward.kp": {"uniform": [1.0, 3.0]}}
    ready = prepare(study_of(flown=trial, batch=True, vary=kp))
    require_equal(ready, [0, 3])


TURNING = {"motion": {"at": 0.5, "duration": 2.0, "to": 0.3, "axis": [1.0, 0.0, 0.0]}}


@pytest.mark.slow
@pytest.mark.parametrize(
    "what",
    representatives(
        ["speed limit", "driven hinge", "prescribed turn", "jumps", "new target"],
        "speed limit",
        "jumps",
    ),
)
def test_a_spacecraft_flies_in_a_batch_as_on_the_bench(
    study_of: Callable[..., Study], what: str
) -> None:
    testbed: dict[str, Any] = deepcopy(CRAFT)
    boom, joint, gains = testbed["appendages"]["boom"], "roll", {"kp": [30.0], "kd": [60.0]}
    vary = {"testbed.platform.mass": {"uniform": [100.0, 200.0]}}
    if what == "speed limit":
        testbed["wheels"]["roll"]["momentum_limit"] = 1.0
        vary["testbed.wheels.roll.momentum_limit"] = {"uniform": [0.5, 1.5]}
    elif what == "driven hinge":
        boom["hinge"] |= {"kind": "driven", "spring": 20.0}
        gains = {"kp": [30.0, 0.0], "kd": [60.0, 1.0]}
    else:
        boom["hinge"] |= TURNING
    if what == "jumps":
        boom["hinge"]["motion"] = TURNING["motion"] | {"profile": "bang_bang"}
        vary["testbed.appendages.boom.hinge.motion.at"] = {"uniform": [0.4, 0.6]}
    schedule = [{"at": 1.0, "until": 1.5, "disturbance": {joint: 0.1}}]
    if what == "new target":
        turn = {"appendage": "boom", "to": -0.2, "duration": 1.5}
        schedule.append({"at": 3.0, "retarget": turn})
        vary["schedule.1.retarget.to"] = {"uniform": [-0.3, 0.2]}
    plan: dict[str, Any] = {"method": "reference_only", "goal": {joint: 0.4}, "duration": 4.0}
    if what == "driven hinge":
        plan["method"] = "none"
    trial = {
        "duration": 6.0,
        "testbed": testbed,
        "plan": plan,
        "controllers": {"pd_feedforward": gains},
        "schedule": schedule,
        "sensors": {"joint_velocity": {"noise": 1e-4}},
    }
    ready = prepare(study_of(flown=trial, batch=True, vary=vary))
    require_equal(ready, [0, 3])


THREE_WHEELS = {
    name: {"axis": axis, "inertia": 0.05, "limit": 20.0}
    for name, axis in (
        ("roll", [1.0, 0.0, 0.0]),
        ("pitch", [0.0, 1.0, 0.0]),
        ("yaw", [0.0, 0.0, 1.0]),
    )
}


@pytest.mark.parametrize(
    "law", representatives(["pd_feedforward", "collocated_pid"], "collocated_pid")
)
def test_three_axes_fly_in_a_batch_as_on_the_bench(
    study_of: Callable[..., Study], law: str
) -> None:
    goal = np.random.default_rng(8).uniform(-1.5, 1.5, 3).tolist()  # some rotation, about no axis
    gains: dict[str, Any] = {"kp": [30.0], "kd": [60.0]}
    trial = {
        "duration": 6.0,
        "testbed": {**CRAFT, "wheels": THREE_WHEELS},
        "plan": {"method": "none", "goal": dict(zip(THREE_WHEELS, goal, strict=True))},
        "controllers": {law: gains | ({"ki": [1.0]} if law == "collocated_pid" else {})},
        "active": law,
        "schedule": [{"at": 1.0, "until": 1.5, "disturbance": {"pitch": 0.1}}],
        "sensors": {"joint_velocity": {"noise": 1e-4}, "joint_position": {"noise": 1e-4}},
    }
    vary = {
        f"controllers.{law}.kp": {"relative": {"uniform": [-0.3, 0.3]}},
        "testbed.platform.mass": {"uniform": [100.0, 200.0]},
    }
    ready = prepare(study_of(flown=trial, batch=True, vary=vary))
    require_equal(ready, [0, 1, 3])


@pytest.mark.slow
@pytest.mark.parametrize("what", representatives(["gains", "testbed"], "testbed"))
def test_a_design_that_the_bench_refuses_is_left_to_it(
    study_of: Callable[..., Study], what: str
) -> None:
    kd = {"controllers.pd_feedforward.kd.0": {"loguniform": [5.0, 9e3]}}
    inertia = {"testbed.platform.inertia.xx": {"uniform": [22.0, 60.0]}}
    roll = 60.0 if what == "gains" else 1.5e3
    trial = {
        "duration": 1.0,
        "period": 0.05,
        "testbed": {**CRAFT, "wheels": THREE_WHEELS},
        "plan": {"method": "none", "goal": {"roll": 0.1}, "duration": 0.5},
        "controllers": {"pd_feedforward": {"kp": [30.0], "kd": [roll, 60.0, 60.0]}},
    }
    vary = kd if what == "gains" else inertia
    ready = prepare(study_of(flown=trial, batch=True, vary=vary))
    cases = [case_of(ready.study, ready.samples, k) for k in range(12)]
    refused = [
        c.number for c in cases if simulate_case(ready.study, c, ready.plans).status == "failed"
    ]
    parts = list(BatchRunner(ready.study, ready.plans).fly(cases))
    assert 0 < len(refused) < len(cases)
    assert [one.case.number for _, lost in parts for one in lost] == refused
    assert {one.way for _, lost in parts for one in lost} == {Way.NOT_ALLOWED}


@pytest.mark.slow
@pytest.mark.parametrize(
    "law", representatives(["lqr", "proportional_integral"], "proportional_integral")
)
def test_a_kalman_filter_on_a_spacecraft_flies_in_a_batch_as_on_the_bench(
    study_of: Callable[..., Study], law: str
) -> None:
    trial = {
        "duration": 6.0,
        "testbed": CRAFT,
        "plan": {"method": "reference_only", "goal": {"roll": 0.2}, "duration": 4.0},
        "controllers": {law: {"filter": {"modal_noise": 1.0}}},
        "active": law,
        "schedule": [{"at": 1.0, "until": 1.5, "disturbance": {"roll": 0.1}}],
        "sensors": {"joint_velocity": {"noise": 1e-4}},
    }
    vary = {"testbed.platform.inertia.xx": {"uniform": [35.0, 45.0]}}
    ready = prepare(study_of(flown=trial, batch=True, vary=vary))
    require_equal(ready, [0, 3])


@pytest.mark.slow
def test_a_filter_by_matrices_flies_in_a_batch_as_on_the_bench(
    study_of: Callable[..., Study],
) -> None:
    trial = {
        "duration": 6.0,
        "testbed": {"kind": "floating_oscillator", "damping_ratio": 0.02},
        "plan": {"method": "none", "goal": {"mass": 0.1}},
        "controllers": {"lqr": {"filter": {"prediction": "linear", "modal_noise": 1.0}}},
        "active": "lqr",
        "sensors": {"joint_velocity": {"noise": 1e-3}},
    }
    vary = {"testbed.damping_ratio": {"uniform": [0.0, 0.1]}}
    ready = prepare(study_of(flown=trial, batch=True, vary=vary))
    require_equal(ready, [0, 3])


RETARGETING: dict[str, tuple[dict[str, Any], str]] = {
    "planned_gains": ({"tracking_time": 5.0}, "tracking_time"),
    "disturbance_accommodating": ({"weights": {"state": 10.0}}, "weights.state"),
    "modal_space": ({"weight": 0.01}, "weight"),
}


@pytest.mark.slow
@pytest.mark.parametrize("law", representatives(RETARGETING, "planned_gains"))
def test_laws_of_small_motions_fly_in_batches_each_with_its_own_gains(
    study_of: Callable[..., Study], law: str
) -> None:
    """At a limit that the load drives them to: the integrals stop there alike."""
    own, key = RETARGETING[law]
    trial = {
        "duration": 1.5,
        "period": 0.005,
        "testbed": {"kind": "varying_oscillator", "effort_limit": [1.5]},
        "plan": {"method": "retargeting", "duration": 1.5, "gains": "perturbation"},
        "controllers": {law: own},
        "active": law,
        "sensors": {"joint_velocity": {"noise": 1e-3}},
    }
    vary = {f"controllers.{law}.{key}": {"relative": {"uniform": [-0.3, 0.3]}}}
    ready = prepare(study_of(flown=trial, batch=True, vary=vary))
    require_equal(ready, [0, 1, 3])
    case = case_of(ready.study, ready.samples, 0)
    assert (simulate_case(ready.study, case, ready.plans).metrics["saturated_time"] or 0.0) > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("mode", representatives(["tracking_a", "tracking_b"], "tracking_b"))
def test_the_law_of_one_appendage_flies_in_batches(
    study_of: Callable[..., Study], mode: str
) -> None:
    testbed: dict[str, Any] = deepcopy(CRAFT)
    del testbed["wheels"]
    axes = {"roll": [1.0, 0.0, 0.0], "pitch": [0.0, 1.0, 0.0], "yaw": [0.0, 0.0, 1.0]}
    testbed["actuators"] = {
        start + name: {"kind": "torque", "direction": axis, "limit": limit, **where}
        for start, limit, where in (("", 50.0, {}), ("tip_", 5.0, {"appendage": "boom"}))
        for name, axis in axes.items()
    }
    del testbed["actuators"]["tip_yaw"]  # the boom does not twist
    law = {"mode": mode, "reaching_rate": 8.0, "appendage": {"name": "boom", "platform_gain": 20.0}}
    trial = {
        "duration": 3.0,
        "testbed": testbed,
        "plan": {"method": "reference_only", "goal": {"roll": 0.2}, "duration": 2.0},
        "controllers": {"output_feedback": law},
        "active": "output_feedback",
        "sensors": {"tip_deflection": {"noise": 1e-4}},
    }
    rate = {"controllers.output_feedback.reaching_rate": {"uniform": [5.0, 10.0]}}
    ready = prepare(study_of(flown=trial, batch=True, vary=rate))
    require_equal(ready, [0, 1, 3])


def test_testbeds_of_one_size_share_one_kernel_and_kinds_do_not() -> None:
    models = [CsaTestbed(modes=3, damping_ratio=ratio).model() for ratio in (0.02, 0.1)]
    printed = CsaTestbed(modes=3, damping_ratio=0.02, variant="printed").model()
    first, second, other = (traced_kernel(model, True) for model in (*models, printed))
    assert first is second
    assert first is not other


def test_the_bound_of_a_frequency_holds_and_is_near() -> None:
    rng = np.random.default_rng(4)
    for _ in range(20):
        given = {"modes": int(rng.integers(1, 7)), "variant": rng.choice(["printed", "complete"])}
        stiff = {"bending_stiffness": float(10.0 ** rng.uniform(2.0, 5.0))}
        testbed = read_testbed({"kind": "csa", **given, "parameters": stiff}, "test")
        assert isinstance(testbed, CsaTestbed)
        model = testbed.model()
        highest = model.linearise(np.zeros(model.coordinates)).frequencies[-1]
        assert model.highest_frequency is not None
        (bound,) = model.highest_frequency(model.packed[:, None])
        assert highest <= bound * (1.0 + 1e-9) <= 3.0 * highest


def test_sine_and_cosine_are_right_to_the_last_digit() -> None:
    angles = np.random.default_rng(2).uniform(-60.0, 60.0, 2000)
    for angle in [*angles.tolist(), 0.0, np.pi / 2, -np.pi, 1e4]:
        sine, cosine = sine_cosine(angle)
        assert abs(sine - np.sin(angle)) < 3e-16
        assert abs(cosine - np.cos(angle)) < 3e-16


def test_what_an_angle_has_turned_gives_its_sine_and_cosine() -> None:
    rng = np.random.default_rng(3)
    for start, by in zip(rng.uniform(-60.0, 60.0, 2000), rng.uniform(-0.7, 0.7, 2000), strict=True):
        sine, cosine = angle_sum(np.sin(start), np.cos(start), by)
        assert abs(sine - np.sin(start + by)) < 1e-14  # of start + by, whose last digit is 7e-15
        assert abs(cosine - np.cos(start + by)) < 1e-14
