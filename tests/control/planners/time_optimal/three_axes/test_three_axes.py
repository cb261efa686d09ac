"""The fastest reorientations: known values, a transcription by CasADi, Pontryagin's condition."""

from functools import partial

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from tests.control.planners.time_optimal.three_axes.reorientations import (
    ASKEW,
    HALF_ROUND,
    PERIOD,
    SPHERE,
    UNIT,
    Triple,
    craft,
    planned,
    transcribed,
)
from tests.representatives import representatives

from flexslew_control.law import PlantDescription
from flexslew_control.plan import Plan
from flexslew_control.planners import make_plan, plan_settings
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.testbeds import read_testbed


def test_a_sphere_turns_half_round_as_fast_as_bilimoria_and_wie_found() -> None:
    plan = planned(SPHERE, UNIT, HALF_ROUND)
    assert plan.duration == pytest.approx(3.2432, abs=1e-3)
    assert plan.summary["eigenaxis_duration"] == pytest.approx(2.0 * np.sqrt(np.pi))
    assert plan.summary["switches"] == 5
    assert plan.summary["optimal"]


FURTHER = [
    ((6.0, 11.0, 15.0), (0.5, 1.5, 1.0), (2.2, -1.1, 0.6)),
    ((20.0, 5.0, 18.0), (1.0, 0.3, 0.8), (-0.4, 0.9, 2.6)),
    ((9.0, 13.0, 5.0), (1.3, 0.6, 0.4), (0.3, -2.4, -0.9)),
]


@pytest.mark.slow
@pytest.mark.parametrize("case", representatives(FURTHER, FURTHER[0], single=True))
def test_no_further_case_is_later_than_a_transcription(case: tuple[Triple, Triple, Triple]) -> None:
    plan = planned(*case)
    assert plan.duration <= (1.0 + 1e-4) * transcribed(*case, plan)


@pytest.mark.slow
@pytest.mark.parametrize(
    "case", representatives([(SPHERE, UNIT, HALF_ROUND), ASKEW], ASKEW, single=True)
)
def test_a_transcription_finds_nothing_faster(case: tuple[Triple, Triple, Triple]) -> None:
    plan = planned(*case)
    assert "Pontryagin's condition holds" in plan.summary["optimality"]
    found = transcribed(*case, plan)
    # what 120 pieces cost, of second order in their length
    assert plan.duration <= found + 1e-7
    assert found == pytest.approx(plan.duration, rel=5e-4)


@pytest.mark.slow
def test_another_integrator_flies_the_arcs_to_the_goal() -> None:
    inertia, limit, turn = ASKEW
    plan, moment = planned(*ASKEW), np.array(inertia)
    knots = PERIOD * np.arange(len(plan.effort) + 1)
    x = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])

    def rate(t: float, x: Vector, u: Vector) -> Vector:
        v, w = x[:3], x[4:]
        turned = 0.5 * np.append(x[3] * w + np.cross(v, w), -v @ w)
        return np.concatenate((turned, (u - np.cross(w, moment * w)) / moment))

    for k, u in enumerate(plan.effort):
        held = partial(rate, u=u)
        x = solve_ivp(held, knots[k : k + 2].tolist(), x, rtol=1e-10, atol=1e-12).y[:, -1]
    goal = Rotation.from_rotvec(turn)
    assert (Rotation.from_quat(x[:4]).inv() * goal).magnitude() < 1e-7
    assert abs(x[4:]).max() < 1e-7
    assert (abs(plan.effort) <= np.array(limit) * (1.0 + 1e-12)).all()


def test_the_bench_flies_it_as_predicted() -> None:
    summary = planned(*ASKEW).summary
    assert max(summary["predicted_residual_attitude_error"].values()) < 1e-5
    assert "warning" not in summary


@pytest.mark.slow
def test_time_goes_with_the_root_of_inertia_over_torque_and_no_frame_matters() -> None:
    inertia, limit, turn = ASKEW
    frame = Rotation.random(random_state=1)
    (a, b, c), (d, e, f) = inertia, limit
    heavy, weak = (4.0 * a, 4.0 * b, 4.0 * c), (0.25 * d, 0.25 * e, 0.25 * f)
    bench = craft(heavy, weak, frame.as_rotvec())
    goal = {"axis": turn, "angle": float(np.linalg.norm(turn)), "relative": True}
    values = {"method": "time_optimal", "drives": "all", "goal": goal}
    plan = make_plan(plan_settings(values, "here"), bench)
    assert plan.duration == pytest.approx(4.0 * planned(*ASKEW).duration, rel=1e-6)


def test_what_cannot_be_turned_by_all_drives_is_refused() -> None:
    with pytest.raises(BadInput, match="not made robust"):
        planned(SPHERE, UNIT, HALF_ROUND, robust=True)
    with pytest.raises(BadInput, match="is there already"):
        planned(SPHERE, UNIT, (0.0, 0.0, 0.0))
    with pytest.raises(PlanFailed, match=r"takes 3\.2431 s, 3 s allowed"):
        planned(SPHERE, UNIT, HALF_ROUND, longest=3.0)


@pytest.mark.slow
def test_a_craft_that_one_drive_makes_tumble_is_turned_or_refused() -> None:
    """Its roll has 270 times the acceleration of its yaw: efforts at random spin it up."""
    platform = {"mass": 100.0, "inertia": {"xx": 9.5, "yy": 161.5, "zz": 162.5}}
    wheels = {
        name: {"axis": axis, "inertia": 0.01, "limit": limit}
        for name, axis, limit in (
            ("roll", [1.0, 0.0, 0.0], 4.02),
            ("pitch", [0.0, 1.0, 0.0], 0.24),
            ("yaw", [0.0, 0.0, 1.0], 0.15),
        )
    }
    keys = {"appendages": {}, "actuators": {}, "platform": platform, "wheels": wheels}
    testbed = read_testbed({"kind": "spacecraft", **keys}, "here")
    plant = PlantDescription(testbed, 0.1, np.array(testbed.effort_limit))

    def plan(drives: str, axis: list[float], angle: float) -> Plan:
        goal = {"axis": axis, "angle": angle}
        asked = plan_settings({"method": "time_optimal", "drives": drives, "goal": goal}, "here")
        return make_plan(asked, plant, predict=False)

    about_eigenaxis = plan("moving", [1.0, 1.0, 1.0], 1.0)
    assert plan("all", [1.0, 1.0, 1.0], 1.0).duration < about_eigenaxis.duration
    with pytest.raises(PlanFailed, match="none of 12 starts led to a slew"):
        plan("all", [0.0, 1.0, 1.0], 1.5)
