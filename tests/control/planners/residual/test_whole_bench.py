"""Plans of spacecraft say what they leave on the whole bench: predicted is flown, or it is told."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from tests.control.planners.residuals import residual_of
from tests.plants import AXES, plant, torques
from tests.representatives import products

from flexslew_control.controllers import build_controller
from flexslew_control.law import ActiveLaw, PlantDescription
from flexslew_control.plan import Plan
from flexslew_control.planners import make_plan, plan_settings
from flexslew_control.planners.slew import Feedback
from flexslew_lab.reproduce.scole_flights import example_trial
from flexslew_lab.trial.trial import feedback_of, plant_of
from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import Testbed, read_testbed

METHODS: dict[str, dict[str, Any]] = {
    "optimized_feedforward": {"duration": 30.0, "functions": 40},
    "robust_feedforward": {"duration": 30.0, "functions": 40},
    "input_shaping": {"duration": 30.0},
    "start_coast_stop": {"duration": 40.0, "pulse_frequency": 1.0},
    "reference_only": {"duration": 30.0},
    "time_optimal": {},
    "minimax_feedforward": {
        "duration": 30.0,
        "pieces": 12,
        "ensemble": {"draw": "corners"},
        "max_steps": 3,
    },
}
NOTHING = 1e-5  # [m]


class Asked(NamedTuple):
    """A bench, its gains and a goal."""

    plant: PlantDescription
    gains: Feedback
    goal: dict[str, float]


def flown(plan: Plan, asked: Asked, law: ActiveLaw | None = None) -> float:
    """Return the residual of a flight on the bench under a law, else under joint feedback [m]."""
    here = asked.plant
    duration = float(np.ceil(plan.end + 40.0))
    bench = Bench(BenchSettings(testbed=here.testbed, period=here.period, duration=duration))
    gains = {"kp": asked.gains.kp, "kd": asked.gains.kd}
    name, own = law or ("pd_feedforward", gains)
    controller = build_controller("pd_feedforward", name, dict(own), here, "here")
    return residual_of(plan, bench, {"pd_feedforward": controller}).tip


def craft(rng: np.random.Generator) -> Testbed:
    """Return a hub with one to three booms, unequal and askew, that is turned about all axes."""
    booms = {}
    for k in range(int(rng.integers(1, 4))):
        along = rng.standard_normal(3)
        along /= np.linalg.norm(along)
        across = np.cross(along, rng.standard_normal(3))
        booms[f"boom_{k}"] = {
            "hinge": {"place": (0.6 * along).tolist()},
            "shape": {
                "kind": "beam",
                "method": "closed_form",
                "length": float(rng.uniform(1.5, 4.0)),
                "linear_density": float(rng.uniform(0.3, 1.0)),
                "bending_stiffness": float(rng.uniform(60.0, 300.0)),
                "along": along.tolist(),
                "across": (across / np.linalg.norm(across)).tolist(),
                "modes_across": int(rng.integers(1, 3)),
                "modes_third": 1,
            },
            "damping": {"ratio": float(rng.choice([0.0, 0.005]))},
        }
    inertia = {key: float(rng.uniform(40.0, 80.0)) for key in ("xx", "yy", "zz")}
    return read_testbed(
        {
            "kind": "spacecraft",
            "platform": {"mass": 150.0, "inertia": inertia},
            "appendages": booms,
            "actuators": torques(4.0),
        },
        "test",
    )


def wish(seed: int) -> Asked:
    """Return a random craft with a random goal."""
    rng = np.random.default_rng([28, seed])
    testbed = craft(rng)
    bench = PlantDescription(testbed, 0.05, np.full(3, 4.0))
    goal = {str(rng.choice(list(AXES))): float(rng.uniform(-0.8, 0.8))}
    return Asked(bench, Feedback(kp=(20.0,), kd=(80.0,)), goal)


@pytest.mark.slow
@pytest.mark.first(3)
@pytest.mark.parametrize(("method", "seed"), products(METHODS, [0, 2]))
def test_a_plan_flies_as_promised_or_warns(method: str, seed: int) -> None:
    asked = wish(seed)
    values = {"method": method, "goal": asked.goal, **METHODS[method]}
    plan = make_plan(plan_settings(values, "test"), asked.plant, asked.gains)
    left, summary = flown(plan, asked), plan.summary
    assert left == pytest.approx(summary["predicted_residual_tip_deflection"], rel=1e-3, abs=1e-8)
    on_model = summary["residual_tip_deflection_on_model"]
    if left > 1.1 * on_model + NOTHING:
        assert f"leaves {left:.2g}"[:9] in summary["warning"]
    assert "the other axes rigid" in summary["believes"]


@pytest.mark.slow
def test_the_remedy_of_the_warning_leaves_what_it_says() -> None:
    trial = example_trial("own_spacecraft")
    values = {"method": "time_optimal", "goal": {"roll": 0.3}}
    plan = make_plan(plan_settings(values, "test"), plant_of(trial), feedback_of(trial))
    modes, said = plan.summary["warning"].split("; ")[-1].split("modes: ")[1].split("} leaves ")
    better = {**values, "model": {"modes": int(modes)}}
    again = make_plan(plan_settings(better, "test"), plant_of(trial), feedback_of(trial))
    left = again.summary["predicted_residual_tip_deflection"]
    assert left == pytest.approx(float(said.removesuffix(" m")), rel=0.01)
    assert left < NOTHING < plan.summary["predicted_residual_tip_deflection"]
    assert "warning" not in again.summary
    relevant = {**values, "model": {"modes": "relevant"}}
    chosen = make_plan(plan_settings(relevant, "test"), plant_of(trial), feedback_of(trial))
    np.testing.assert_array_equal(chosen.effort, again.effort)


EACH = [[20.0 * (i == j) for i in range(3)] + [80.0 * (i == j) for i in range(3)] for j in range(3)]
LAWS: dict[str, dict[str, Any]] = {
    "lqr": {},
    "collocated_pid": {"kp": [20.0], "ki": [1.0], "kd": [80.0]},
    "linear": {"system": {"d": EACH}},
}


@pytest.mark.slow
@pytest.mark.parametrize(("law", "method"), products(LAWS, ["input_shaping", "time_optimal"]))
def test_a_plan_that_any_law_flies_leaves_what_it_promises_or_warns(method: str, law: str) -> None:
    asked = wish(2)
    values = {"method": method, "goal": asked.goal, **METHODS[method]}
    charge = ActiveLaw(law, LAWS[law])
    plan = make_plan(plan_settings(values, "test"), asked.plant, None, law=charge)
    left, summary = flown(plan, asked, charge), plan.summary
    assert left == pytest.approx(summary["predicted_residual_tip_deflection"], rel=1e-3, abs=1e-8)
    if left > 1.1 * summary["residual_tip_deflection_on_model"] + NOTHING:
        assert f"leaves {left:.2g}"[:9] in summary["warning"]


@pytest.mark.slow
def test_a_testbed_of_joints_is_flown_by_the_law_in_charge_too() -> None:
    asked = Asked(plant(), Feedback(), {"base_yaw": 0.5})
    values = {"method": "reference_only", "goal": asked.goal, "model": {"modes": 3}}
    for law, own in (("lqr", {}), ("pd_feedforward", {"kp": [100.0], "kd": [400.0]})):
        charge = ActiveLaw(law, own)
        plan = make_plan(plan_settings(values, "test"), asked.plant, None, law=charge)
        left, summary = flown(plan, asked, charge), plan.summary
        assert left == pytest.approx(summary["predicted_residual_tip_deflection"], rel=1e-6)
        by_joints = summary["residual_tip_deflection_by_joint_feedback"]
        assert by_joints != pytest.approx(left, rel=0.01)
        if left > 1.1 * by_joints + NOTHING:
            assert f"flown by {law} it leaves {left:.3g} m" in summary["warning"]


def test_a_plan_of_a_spacecraft_that_nobody_is_known_to_fly_says_so() -> None:
    asked = wish(0)
    values = {"method": "input_shaping", "goal": asked.goal, "duration": 30.0}
    plan = make_plan(plan_settings(values, "test"), asked.plant)
    assert "not flown on the whole bench" in plan.summary["warning"]


@pytest.mark.slow
@pytest.mark.parametrize("of", ["joints", "spacecraft"])
@pytest.mark.parametrize("method", ["input_shaping", "reference_only"])
def test_a_plan_without_a_prediction_is_the_same_and_is_not_flown(
    method: str, of: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = Asked(plant(), Feedback(), {"base_yaw": 0.5}) if of == "joints" else wish(2)
    section = plan_settings({"method": method, "goal": asked.goal, "duration": 20.0}, "test")
    law = ActiveLaw("lqr", {})
    told = make_plan(section, asked.plant, law=law)
    monkeypatch.delattr("flexslew_control.planners.slewing.simulate_on_bench")
    with pytest.raises(NameError):
        make_plan(section, asked.plant, law=law)
    bare = make_plan(section, asked.plant, law=law, predict=False)
    np.testing.assert_array_equal(bare.effort, told.effort)
    np.testing.assert_array_equal(bare.position, told.position)


@pytest.mark.parametrize("modes", [-1, 1.5, "many"])
def test_a_number_of_modes_that_is_none_is_refused(modes: Any) -> None:
    asked = wish(0)
    values = {"method": "time_optimal", "goal": asked.goal, "model": {"modes": modes}}
    with pytest.raises(BadInput, match=r"modes: .* is not allowed"):
        make_plan(plan_settings(values, "test"), asked.plant, asked.gains)
