"""A linear plant in a trial: flown, planned, analysed, identified, studied and flown again."""

from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
from scipy.linalg import expm
from tests.linear_plants import CD_PLAYER, SPACE_STATION, drawn_plant, modal_plant

from flexslew_control.analysis.model_file import save_model
from flexslew_lab import front as fs
from flexslew_lab.analysis.trial_models import model_of, point_of
from flexslew_lab.notebook import fly, trial
from flexslew_lab.replay.resim import resim
from flexslew_plant.errors import PlanFailed

PLANT = modal_plant(
    [0.0, 2.0, 5.0, 9.0],
    [[0.1], [0.08], [-0.05], [0.03]],
    0.01,
    [[0.1, 0.0], [0.08, 1.0], [-0.05, -0.8], [0.03, 0.5]],
)
SYSTEM = control.ss(
    *PLANT, 0, inputs=["effort:hub"], outputs=["position:hub", "tip:boom"]
)  # fmt: skip
GAINS = {"kp": 40.0, "kd": 90.0}


def keys(system: Any = SYSTEM, **more: Any) -> dict[str, Any]:
    return {
        "name": "linear_plant",
        "duration": 20.0,
        "testbed": {"kind": "linear", "system": system},
        "plan": {"method": "reference_only", "goal": {"hub": 0.3}, "duration": 10.0},
        "controllers": {"pd_feedforward": GAINS},
        **more,
    }


def closed_loop(flight: Any, period: float, law: Any) -> tuple[Any, Any]:
    """Return joint and tip of the plant with a law (position, rate, reference, its rate) -> u."""
    a, b, c = PLANT
    whole = expm(np.block([[a, b], [np.zeros((1, 9))]]) * period)
    x, read = np.zeros(8), []
    for r, rate in zip(flight["reference.hub"], flight["reference_rate.hub"], strict=True):
        read.append(c @ x)
        effort = np.clip(law(c[0] @ x, c[0] @ a @ x, r, rate), -10.0, 10.0)
        x = whole[:8, :8] @ x + whole[:8, 8] * effort
    return tuple(np.array(read).T)


def pd(position: float, rate: float, reference: float, reference_rate: float) -> float:
    return 40.0 * (reference - position) + 90.0 * (reference_rate - rate)


@pytest.mark.parametrize("sampled", [0.0, 0.01, 0.05])
def test_a_loop_closed_by_pd_flies_as_its_matrices_do(sampled: float) -> None:
    system = control.sample_system(SYSTEM, sampled, "zoh") if sampled else SYSTEM
    if sampled:
        system.set_inputs(["effort:hub"])
        system.set_outputs(["position:hub", "tip:boom"])
    flight = fly(trial(keys(system)))
    hub, tip = closed_loop(flight, 0.01, pd)
    np.testing.assert_allclose(flight["position.hub"], hub, atol=1e-9)
    np.testing.assert_allclose(flight["tip.boom"], tip, atol=1e-9)


def test_a_loop_closed_by_a_linear_law_flies_as_its_matrices_do() -> None:
    law = {"linear": {"system": {"d": [[40.0, 90.0]]}}}
    flight = fly(trial(keys(controllers=law, active="linear")))
    np.testing.assert_allclose(flight["position.hub"], closed_loop(flight, 0.01, pd)[0], atol=1e-9)


def test_efforts_of_a_plan_alone_move_it_as_python_control_says() -> None:
    """Open loop: gains too small to matter, and the recorded efforts through forced_response."""
    values = keys(controllers={"pd_feedforward": {"kp": 1e-9, "kd": 1e-9}},
                  plan={"method": "input_shaping", "goal": {"hub": 0.3}})  # fmt: skip
    flight = fly(trial(values))
    efforts = flight["effort.hub"][1:]  # of the tick that ends with each row
    found = control.forced_response(
        control.sample_system(SYSTEM, 0.01, "zoh"), U=np.append(efforts, 0.0)[None]
    )
    np.testing.assert_allclose(flight["position.hub"], found.outputs[0], atol=1e-9)
    assert flight["position.hub"][-1] == pytest.approx(0.3, abs=1e-3)


@pytest.mark.parametrize(
    ("size", "period"), [(SPACE_STATION, 0.01), pytest.param(CD_PLAYER, 0.001)]
)
def test_public_sizes_fly_through_a_law(size: Any, period: float) -> None:
    plant = drawn_plant(*size)
    joints = tuple(f"joint_{k + 1}" for k in range(size[1]))
    plan = {"method": "reference_only", "goal": dict.fromkeys(joints, 1e-3), "duration": 0.4,
            "model": {"kept_modes": 3}}  # fmt: skip
    values = {"name": "size", "duration": 0.5, "period": period, "testbed": plant.keys(size[1]),
              "plan": plan, "controllers": {"pd_feedforward": {"kp": 1.0, "kd": 0.5}}}  # fmt: skip
    flight = fly(trial(values))
    f, g = plant.held(period)
    x = np.zeros(len(plant.a))
    for k in range(len(flight["position.joint_1"])):
        read, rate = plant.c @ x, plant.c @ plant.a @ x
        found = [flight[f"position.{joint}"][k] for joint in joints]
        np.testing.assert_allclose(found, read, atol=1e-11)
        errors = [flight[f"reference.{joint}"][k] for joint in joints] - read
        rates = [flight[f"reference_rate.{joint}"][k] for joint in joints] - rate
        x = f @ x + g @ np.clip(errors + 0.5 * rates, -10.0, 10.0)


def test_an_exported_testbed_flies_as_the_testbed_itself(tmp_path: Path) -> None:
    given = {"kind": "hub_with_appendages", "damping_ratio": 0.01, "effort_limit": [10.0]}
    values = keys(testbed=given)
    save_model(model_of(point_of(trial(values), None, {}), False), tmp_path / "hub.mat")
    again = keys(
        testbed={"kind": "linear", "file": str(tmp_path / "hub.mat"), "effort_limit": [10.0]}
    )
    first, second = fly(trial(values)), fly(trial(again))
    size = abs(first["tip.appendage"]).max()
    # the hub's equations are not linear: the spin softens its appendages by rate^2
    np.testing.assert_allclose(second["position.hub"], first["position.hub"], atol=1e-4)
    np.testing.assert_allclose(second["tip.appendage"], first["tip.appendage"], atol=0.02 * size)
    linear = keys(testbed={"kind": "linear"})
    save_model(model_of(point_of(trial(linear), None, {}), False), tmp_path / "same.npz")
    same = keys(
        testbed={"kind": "linear", "file": str(tmp_path / "same.npz"), "effort_limit": [10.0]}
    )
    for name in ("position.hub", "tip.boom"):
        np.testing.assert_allclose(fly(trial(same))[name], fly(trial(linear))[name], atol=1e-10)


@pytest.mark.parametrize(
    "method",
    [
        {"method": "input_shaping", "goal": {"hub": 0.3}},
        {
            "method": "optimized_feedforward",
            "goal": {"hub": 0.3},
            "duration": 12.0,
            "functions": 18,
        },
        {"method": "reference_only", "goal": {"hub": 0.3}, "duration": 12.0},
    ],
    ids=lambda method: method["method"],
)
def test_a_plan_predicts_the_residual_that_is_flown(method: dict[str, Any]) -> None:
    values = trial(keys(plan=method, duration=30.0))
    expected = fs.plan(values).summary["predicted_residual_tip_deflection"]
    found = fly(values).metrics["residual_tip_deflection"]
    assert found == pytest.approx(expected, rel=0.05, abs=1e-7)


def test_margins_are_those_of_python_control() -> None:
    found = fs.analyse(trial(keys()))
    sampled = control.sample_system(SYSTEM, 0.01, "zoh")
    a, c = PLANT.a, PLANT.c
    law = control.ss(
        sampled.A, sampled.B, (40.0 * c[0] + 90.0 * c[0] @ a)[None], 0.0, 0.01
    )  # fmt: skip
    margin = found.efforts[0]
    loop = law(np.exp(0.01j * margin.phase_frequency))
    assert abs(loop) == pytest.approx(1.0, rel=1e-6)
    assert np.pi - abs(np.angle(loop)) == pytest.approx(margin.phase, rel=1e-6)
    # of a grid of frequencies, which passes crossovers by
    _, phase, _, _, crossing, _ = control.stability_margins(law, method="frd")
    assert margin.phase_frequency == pytest.approx(crossing, rel=1e-2)
    assert margin.phase == pytest.approx(np.deg2rad(phase), rel=1e-2)


def test_a_log_flies_again_without_the_file_to_the_same_bits(tmp_path: Path) -> None:
    file = tmp_path / "plant.npz"
    np.savez(file, A=PLANT.a, B=PLANT.b, C=PLANT.c, inputs=["effort.hub"],
             outputs=["position.hub", "tip.boom"])  # fmt: skip
    values = keys(testbed={"kind": "linear", "file": str(file)}, duration=2.0)
    fly(trial(values), tmp_path / "run")
    file.unlink()
    assert resim(tmp_path / "run" / "bag").identical


def test_efforts_beside_the_joints_are_flown_and_not_planned_for() -> None:
    rng = np.random.default_rng(2)
    plant = drawn_plant(6, 2, (1.0, 9.0))
    beside = plant._replace(b=plant.b + 0.1 * rng.standard_normal(plant.b.shape) * (plant.b != 0.0))
    values = keys(
        testbed=beside.keys(2), plan={"method": "input_shaping", "goal": {"joint_1": 0.1}}
    )
    with pytest.raises(PlanFailed, match="efforts in the joints, and here they act elsewhere, too"):
        fs.plan(trial(values))


def test_a_study_of_its_stiffness_flies_in_batches_what_the_bench_flies(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    import pyarrow.parquet as pq

    plan = {"method": "input_shaping", "goal": {"hub": 0.3}}
    found = fs.study(
        {
            "study": "stiffness",
            "trial": keys(plan=plan, duration=30.0),
            "sampling": {"method": "grid", "n": 3},
            "vary": {"testbed.stiffness": {"uniform": [0.5, 2.0]}},
            "replan": False,
            "keep": {"bags": "none"},
        },
        tmp_path / "study",
    )
    assert found["trials"] == 3
    assert found["failed"] == 0
    table = pq.read_table(tmp_path / "study/table.parquet").to_pydict()
    factors = next(v for k, v in table.items() if k.endswith("testbed.stiffness"))
    residuals = table["residual_tip_deflection"]
    made = fs.plan(trial(keys(plan=plan, duration=30.0)))
    for factor, residual in zip(factors, residuals, strict=True):
        stiff = {"kind": "linear", "system": SYSTEM, "stiffness": factor}
        flight = fly(trial(keys(testbed=stiff, duration=30.0), plan=made))
        assert flight.metrics["residual_tip_deflection"] == pytest.approx(residual, rel=1e-6)


def test_a_shaken_plant_gives_its_modes_and_inertia_back(tmp_path: Path) -> None:
    values = keys(
        plan={"method": "excitation", "band": [0.5, 12.0], "largest_excursion": [0.05],
              "duration": 300.0},
        duration=305.0,
        sensors={"joint_position": {"noise": 1e-5}, "joint_velocity": {"noise": 1e-5},
                 "tip_deflection": {"noise": 1e-5}},
    )  # fmt: skip
    fly(trial(values), tmp_path / "shaken")
    found = fs.identify(tmp_path / "shaken")
    modes = found.model.modes
    assert [mode.frequency.value for mode in modes] == pytest.approx([2.0, 5.0, 9.0], rel=1e-3)
    assert [mode.damping_ratio.value for mode in modes] == pytest.approx([0.01] * 3, rel=0.02)
