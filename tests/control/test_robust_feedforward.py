from functools import lru_cache

import numpy as np
import pytest

from flexslew_control.basis import Basis
from flexslew_control.manoeuvre import Manoeuvre, TerminalMap, substeps_for
from flexslew_control.planners import make_plan, plan_settings
from flexslew_control.robust_feedforward import RobustFeedforward, ensemble
from flexslew_plant.csa import CsaTestbed
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.settings import validated
from flexslew_plant.testbeds import build_model, with_stiffness

GAINS = np.full(2, 460.0), np.full(2, 920.0)
ERRORS = (-0.2, -0.1, 0.0, 0.1, 0.2)
PLAIN_WORST = 0.641  # largest residual of the plain M1 plan at -20 % EI [m] (csa_testbed)


@lru_cache
def plan(limit=150.0, method="robust_feedforward", **more):
    settings = plan_settings({"method": method, **more}, "trial.yaml")
    return make_plan(settings, 0.05, (limit, limit))


def residual_tip(flown, error, modes=1):
    """Return the largest tip deflection in 75 s after the slew [m], on the complete model."""
    model = with_stiffness(build_model(CsaTestbed(modes=modes)), 1.0 + error)
    slew = Manoeuvre(
        model, *GAINS, np.zeros(2), np.array([1.0, 0.5]), flown.duration, flown.request["reference"]
    )
    edges = np.arange(0.0, flown.duration + 75.0, 0.05)
    held = np.zeros((len(edges) - 1, 2))
    held[: flown.ticks] = flown.effort
    path = slew.fly(edges, np.repeat(held, 12, axis=0))
    return float(np.abs(path[edges >= flown.duration, 2 : 2 + modes].sum(axis=1)).max())


def test_five_more_seconds_beat_the_plain_plan_three_times_within_the_torque_limit():
    robust, plain = plan(), plan(method="optimized_feedforward", rho=4e-10)
    worst = max(residual_tip(robust, error) for error in np.linspace(-0.2, 0.2, 9))
    assert max(residual_tip(plain, error) for error in (-0.2, 0.2)) > PLAIN_WORST - 0.02
    assert worst < PLAIN_WORST / 3.0
    assert np.max(robust.summary["worst_peak_effort"]) < 150.0


def test_it_holds_with_modes_that_the_planner_does_not_know():
    assert max(residual_tip(plan(), error, modes=3) for error in (-0.2, 0.2)) < PLAIN_WORST / 3.0


def test_the_joints_are_near_the_goal_at_the_end():
    assert np.abs(plan().state[-1, :2] - [1.0, 0.5]).max() < 0.006


def test_the_summary_tells_the_residual_of_every_member():
    found = plan().summary
    assert [member["stiffness_error"] for member in found["members"]] == list(ERRORS)
    for member in found["members"]:
        flown = residual_tip(plan(), member["stiffness_error"])
        assert member["residual"] == pytest.approx(flown, rel=0.02)
    assert found["worst_residual"] == max(member["residual"] for member in found["members"])


def test_dearer_torque_leaves_more_and_more_time_leaves_less():
    dear, cheap = plan(rho=4e-6), plan(limit=500.0, rho=1e-8)
    longer = plan(duration=40.0)
    worst = [p.summary["worst_residual"] for p in (dear, plan(), cheap)]
    assert worst == sorted(worst, reverse=True)
    assert longer.summary["worst_residual"] < 0.5 * plan().summary["worst_residual"]
    assert np.max(longer.summary["worst_peak_effort"]) < np.max(plan().summary["worst_peak_effort"])


def test_the_weights_are_stationary():
    settings = RobustFeedforward(tolerance=1e-9)
    found = make_plan(settings, 0.05, (150.0, 150.0))
    best = found.summary["objective"]
    rng = np.random.default_rng(3)
    members, basis = ensemble(settings), Basis("hat", 11, 30.0)
    u = np.array(found.summary["weights"]).ravel()

    def objective(weights):
        substeps = max(substeps_for(m.manoeuvre, basis) for m in members)
        maps = [TerminalMap(m.manoeuvre, basis, substeps) for m in members]
        left = [
            np.sum((m.weight @ at.terminal_error(weights)) ** 2)
            for m, at in zip(members, maps, strict=True)
        ]
        return sum(left) / len(members) + settings.rho * weights @ weights

    assert objective(u) == pytest.approx(best, rel=1e-9)
    for _ in range(5):
        assert objective(u + 0.5 * rng.standard_normal(u.size)) > best


def test_the_weight_is_the_mean_vibration_after_the_end():
    member = ensemble(RobustFeedforward())[2]
    slew = member.manoeuvre
    y = 1e-4 * np.array([1.0, -2.0, 30.0, 0.5, 0.2, 10.0])
    a = slew.model.linearise(np.append(slew.goal, 0.0)).with_feedback(slew.kp, slew.kd).state_matrix
    values, vectors = np.linalg.eig(a)
    t = np.linspace(0.0, slew.duration, 20001)
    path = ((vectors * np.linalg.solve(vectors, y)) @ np.exp(np.outer(values, t))).real
    mean = 25.0 * (path[:2] ** 2).sum(axis=0).mean() + (path[2] ** 2).mean()
    assert np.sum((member.weight @ y) ** 2) == pytest.approx(mean, rel=1e-3)


def test_every_pair_of_errors_is_a_member():
    settings = RobustFeedforward(stiffness_errors=(-0.1, 0.1), payload_errors=(0.0, 0.3))
    members = ensemble(settings)
    pairs = [(m.stiffness_error, m.payload_error) for m in members]
    assert pairs == [(-0.1, 0.0), (0.1, 0.0), (-0.1, 0.3), (0.1, 0.3)]
    inertia = [m.manoeuvre.model.mass_matrix(np.zeros(3))[0, 0] for m in members]
    assert inertia[2] - inertia[0] == pytest.approx(0.3 * 2000.0)


def test_one_exact_member_is_left_at_rest_like_the_plain_plan():
    alone = plan(stiffness_errors=(0.0,), rho=4e-12, duration=25.0)
    assert residual_tip(alone, 0.0) < 0.01


def test_what_cannot_be_is_said_in_one_line():
    with pytest.raises(PlanFailed, match=r"needs \d+\.?\d* N m on base_yaw \(EI .* limit is 40"):
        plan(limit=40.0)
    with pytest.raises(PlanFailed, match="did not converge after 1 updates"):
        plan(max_iterations=1)
    for wrong in ({"stiffness_errors": []}, {"stiffness_errors": [-1.0]}, {"rho": 0.0}):
        with pytest.raises(BadInput, match=next(iter(wrong))):
            validated(RobustFeedforward, wrong, "trial.yaml")
