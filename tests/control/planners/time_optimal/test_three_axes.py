"""The fastest reorientations: known values, a transcription by CasADi, Pontryagin's condition."""

from functools import lru_cache, partial
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from flexslew_control.law import ActiveLaw, PlantDescription
from flexslew_control.plan import Plan
from flexslew_control.planners import make_plan, plan_settings
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.testbeds import read_testbed

NAMES = ("roll", "pitch", "yaw")
SPHERE, UNIT = (1.0, 1.0, 1.0), (1.0, 1.0, 1.0)
HALF_ROUND = (0.0, 0.0, np.pi)
ASKEW = (10.0, 14.0, 18.0), (1.0, 0.7, 1.2), (0.9, 1.4, -0.5)
PERIOD = 0.02  # [s]
Triple = tuple[float, float, float]


def craft(inertia: Triple, limit: Triple, start: Vector | None = None) -> PlantDescription:
    """Return a rigid craft with a torque about each axis."""
    torques = {
        name: {"kind": "torque", "direction": axis.tolist(), "limit": most}
        for name, axis, most in zip(NAMES, np.eye(3), limit, strict=True)
    }
    at = np.zeros(3) if start is None else start
    testbed = read_testbed(
        {
            "kind": "spacecraft",
            "platform": {"inertia": dict(zip(("xx", "yy", "zz"), inertia, strict=True))},
            "appendages": {},
            "actuators": torques,
            "initial": dict(zip(NAMES, at.tolist(), strict=True)),
        },
        "here",
    )
    return PlantDescription(testbed, PERIOD, np.array(limit))


@lru_cache
def planned(inertia: Triple, limit: Triple, turn: Triple, **keys: Any) -> Plan:
    """Return the fastest slew by a rotation vector."""
    values = {"method": "time_optimal", "drives": "all", **keys}
    values["goal"] = dict(zip(NAMES, turn, strict=True))
    law = ActiveLaw("pd_feedforward", {"kp": [1.0], "kd": [2.0]})
    return make_plan(plan_settings(values, "here"), craft(inertia, limit), law=law)


def transcribed(inertia: Triple, limit: Triple, turn: Triple, guess: Plan) -> float:
    """Return the least duration of efforts on 120 pieces, by IPOPT from another slew's [s]."""
    q, w, u, h = ca.SX.sym("q", 4), ca.SX.sym("w", 3), ca.SX.sym("u", 3), ca.SX.sym("h")
    x, moment = ca.vertcat(q, w), ca.DM(inertia)
    turned = 0.5 * ca.vertcat(q[3] * w + ca.cross(q[:3], w), -ca.dot(q[:3], w))
    pushed = (ca.DM(limit) * u - ca.cross(w, moment * w)) / moment
    rate = ca.Function("rate", [x, u], [ca.vertcat(turned, pushed)])
    k1 = rate(x, u)
    k2 = rate(x + h / 2.0 * k1, u)
    k3 = rate(x + h / 2.0 * k2, u)
    k4 = rate(x + h * k3, u)
    step = ca.Function("step", [x, u, h], [x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)])
    pieces, problem = 120, ca.Opti()
    states, shares = problem.variable(7, pieces + 1), problem.variable(3, pieces)
    duration = problem.variable()
    held = ca.repmat(duration / pieces, 1, pieces)
    problem.subject_to(states[:, 1:] == step.map(pieces)(states[:, :-1], shares, held))
    problem.subject_to(problem.bounded(-1.0, shares, 1.0))
    problem.subject_to(states[:, 0] == ca.DM([0, 0, 0, 1, 0, 0, 0]))
    goal = Rotation.from_rotvec(turn).as_quat()
    problem.subject_to(states[:3, -1] == ca.DM(goal[:3]))
    problem.subject_to(states[4:, -1] == 0.0)
    problem.subject_to(duration >= 0.1)
    problem.minimize(duration)
    share = np.linspace(0.0, 1.0, pieces + 1)
    ticks = np.minimum((share * (len(guess.position) - 1)).astype(int), len(guess.effort) - 1)
    attitude = Rotation.from_rotvec(guess.position[ticks]).as_quat()
    attitude *= np.sign(attitude[:, 3:] + 1e-300)
    problem.set_initial(states, np.hstack((attitude, guess.velocity[ticks])).T)
    problem.set_initial(shares, (guess.effort[ticks[:-1]] / np.array(limit)).T)
    problem.set_initial(duration, guess.duration)
    problem.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})
    return float(problem.solve().value(duration))


def test_a_sphere_turns_half_round_as_fast_as_bilimoria_and_wie_found() -> None:
    plan = planned(SPHERE, UNIT, HALF_ROUND)
    assert plan.duration == pytest.approx(3.2432, abs=1e-3)
    assert plan.summary["eigenaxis_duration"] == pytest.approx(2.0 * np.sqrt(np.pi))
    assert plan.summary["switches"] == 5
    assert plan.summary["optimal"]


@pytest.mark.parametrize("case", [(SPHERE, UNIT, HALF_ROUND), ASKEW])
def test_a_transcription_finds_nothing_faster(case: tuple[Triple, Triple, Triple]) -> None:
    plan = planned(*case)
    assert "Pontryagin's condition holds" in plan.summary["optimality"]
    found = transcribed(*case, plan)
    # what 120 pieces cost, of second order in their length
    assert plan.duration <= found + 1e-7
    assert found == pytest.approx(plan.duration, rel=5e-4)


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
