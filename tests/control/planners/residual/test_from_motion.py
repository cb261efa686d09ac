"""A plan in flight promises what it leaves on the bench as it moves then."""

from typing import Any

import numpy as np
import pytest
from tests.control.planners.residuals import Residual, Watch
from tests.present import present

from flexslew_control.law import ActiveLaw, Reference
from flexslew_control.planners.residual.from_motion import predicted_from, state_of
from flexslew_control.plans.course import PlanSequence
from flexslew_control.plans.known_motion import ATTITUDE_ERROR, PREDICTED, KnownMotion, at_rest
from flexslew_lab.run.in_process import run_bench
from flexslew_lab.trial.sources import trial_path
from flexslew_lab.trial.trial import (
    Trial,
    load_trial,
    plan_of_trial,
    plant_of,
    set_plan,
    set_up,
    trial_of_values,
)
from flexslew_plant.bench.bench import Truth
from flexslew_plant.testbeds import Model

CSA = {"base_yaw": 0.1, "hub_pitch": 0.05}
BENCHES: dict[str, dict[str, Any]] = {
    "csa": {"testbed": {"kind": "csa", "modes": 1}, "goal": CSA, "period": 0.01},
    "oscillator": {
        "testbed": {"kind": "floating_oscillator", "damping_ratio": 1e-3},
        "goal": {"mass": 0.3},
        "period": 0.02,
    },
}
LAWS: dict[str, dict[str, dict[str, Any]]] = {
    "csa": {
        "collocated_pid": {"kp": [300.0, 300.0], "kd": [600.0, 600.0], "ki": [0.0, 0.0]},
    },
    "oscillator": {"pd_feedforward": {"kp": [0.05], "kd": [0.1]}},
}


def trial(bench: str, law: str, goal: float, start: float, **plan: Any) -> Trial:
    """Return a trial with a slew to a share of the bench's goal."""
    values = {**BENCHES[bench]}
    whole = values.pop("goal")
    section = {
        "goal": {name: goal * at for name, at in whole.items()},
        "start": start,
        **plan,
    }
    controllers = {law: LAWS[bench][law]}
    return trial_of_values(
        {**values, "duration": 62.0, "plan": section, "controllers": controllers, "active": law},
        "test",
    )


def motion_of(model: Model, truth: Truth) -> KnownMotion:
    """Return the motion of a bench as it is displayed."""
    x = np.concatenate((truth.position, truth.velocity))
    position, velocity = model.joint_state(x)
    modes, rates = model.modal_state(x)
    shown = zip(position.tolist(), velocity.tolist(), strict=True)
    joints = dict(zip(model.joint_names, shown, strict=True))
    tips = np.concatenate((model.appendages.tip @ modes, model.appendages.tip @ rates))
    return KnownMotion(truth.tick, joints, modes.copy(), rates.copy(), tips)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("bench", "law", "method"),
    [
        ("oscillator", "pd_feedforward", "reference_only"),
        ("oscillator", "pd_feedforward", "minimax_feedforward"),
        ("csa", "collocated_pid", "minimax_feedforward"),
    ],
)
def test_the_motion_in_flight_is_in_the_promise(bench: str, law: str, method: str) -> None:
    """Over ROS 2.9e-8 m was promised and .637 m flown, with the tips at .63 m at the request."""
    first = trial(bench, law, 1.0, 0.0, method="reference_only", duration=3.0)
    plan = present(plan_of_trial(first))
    start, seen_at = 9.0, float(np.random.default_rng([53, len(law)]).choice([1.5, 6.0]))
    begin = dict(zip(plan.joint_names, plan.position[-1].tolist(), strict=True))
    second = trial(bench, law, 2.0, start, method=method, duration=12.0, initial=begin)
    later = present(plan_of_trial(second))

    flown, controllers = set_up(first, "test")
    assert set_plan(controllers, law, plan) is None
    model = plant_of(first).testbed.model()
    seen, motions = Residual(later, model), list[KnownMotion]()

    def truth(truth: Truth) -> None:
        if truth.tick == round(seen_at / first.period):
            motions.append(motion_of(model, truth))
            for controller in controllers.values():
                assert controller.adopt(later) is None
        seen.truth(truth)

    run_bench(flown, controllers, Watch(truth))
    [motion] = motions
    assert not at_rest(motion, later)

    course, rest = PlanSequence(), np.zeros(model.joints)
    course.begin_with(plan)
    hold = Reference(plan.position[0], rest, rest, rest[:0])
    whole = course.before(later, motion.tick, hold)
    active = ActiveLaw(law, LAWS[bench][law])
    found = present(predicted_from(motion, later, whole, plant_of(second), active))
    assert found.summary[PREDICTED] == pytest.approx(seen.tip, rel=1e-6, abs=1e-9)
    away = [found.summary[ATTITUDE_ERROR][name] for name in model.joint_names]
    np.testing.assert_allclose(away, seen.joints, rtol=1e-6, atol=1e-9)
    if method == "minimax_feedforward":  # which leaves little from rest
        assert seen.tip > 2.0 * later.summary[PREDICTED]
        assert "the bench moves at " in found.summary["warning"]


@pytest.mark.parametrize("name", ["replan_csa", "replan_oscillator", "three_axes"])
def test_the_state_of_a_bench_has_the_joints_and_modes_that_it_displays(name: str) -> None:
    model, rng = plant_of(load_trial(trial_path(name))).testbed.model(), np.random.default_rng(53)
    rest = model.rest(dict.fromkeys(model.joint_names, 0.0))
    x = np.concatenate((rest, rng.uniform(-0.1, 0.1, model.coordinates)))
    model.modal_state(x)[0][:] = rng.uniform(-0.1, 0.1, model.modes)
    position, velocity = model.joint_state(x)
    shown = zip(position.tolist(), velocity.tolist(), strict=True)
    joints = dict(zip(model.joint_names, shown, strict=True))
    motion = KnownMotion(3, joints, *model.modal_state(x), np.zeros(0))
    state = state_of(model, motion, position)
    for of in (model.joint_state, model.modal_state):
        np.testing.assert_allclose(of(state), of(x), atol=1e-9)
    if model.coordinates == model.joints + model.modes:
        np.testing.assert_allclose(state, x, atol=1e-9)


def test_a_bench_with_a_joint_on_its_mast_is_placed_by_the_references() -> None:
    model, rng = (
        plant_of(load_trial(trial_path("scole_full"))).testbed.model(),
        np.random.default_rng(53),
    )
    modes, rates, speeds = (
        rng.uniform(-0.1, 0.1, k) for k in (model.modes, model.modes, model.joints)
    )
    joints = {name: (0.01, rate) for name, rate in zip(model.joint_names, speeds, strict=True)}
    state = state_of(
        model, KnownMotion(3, joints, modes, rates, np.zeros(0)), np.zeros(model.joints)
    )
    np.testing.assert_array_equal(np.concatenate(model.modal_state(state)), [*modes, *rates])
