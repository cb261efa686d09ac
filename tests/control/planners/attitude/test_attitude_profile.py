"""Profiles of attitudes and spins: smooth, flown as planned from any frame, or refused."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.control.planners.attitude.test_eigenaxis import INERTIA, open_loop, rigid
from tests.control.planners.residuals import Watch
from tests.plants import plant
from tests.representatives import products, representatives, seeds

from flexslew_control.controllers import build_controller
from flexslew_control.law import PlantDescription
from flexslew_control.plan import Plan
from flexslew_control.planners import make_plan, plan_settings
from flexslew_lab.reproduce.scole_flights import example_trial
from flexslew_lab.run.in_process import run_bench
from flexslew_plant.bench.bench import Bench, BenchSettings, Truth
from flexslew_plant.errors import BadInput, PlanFailed


def planned(bench: PlantDescription, **keys: Any) -> Plan:
    return make_plan(plan_settings({"method": "attitude_profile", **keys}, "here"), bench)


def turns(rng: np.random.Generator, angle: float = 0.6) -> list[dict[str, Any]]:
    """Return three random attitudes, each a turn from the one before, the last in motion."""
    points: list[dict[str, Any]] = [
        {
            "at": at,
            "attitude": {"axis": rng.standard_normal(3).tolist(), "angle": angle, "relative": True},
        }
        for at in (15.0, 24.0, 40.0)
    ]
    points[-1]["rate"] = (0.02 * rng.standard_normal(3)).tolist()
    return points


def path_of(plan: Plan) -> Rotation:
    return Rotation.from_rotvec(plan.position.copy())


@pytest.mark.parametrize("seed", seeds(3))
def test_a_profile_passes_its_attitudes_smoothly_and_its_efforts_alone_fly_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start = Rotation.random(rng=rng)
    bench, points = rigid(start.as_rotvec()), turns(rng)
    plan = planned(bench, points=points, duration=50.0)
    path, due = path_of(plan), start
    for point in points:
        axis = np.array(point["attitude"]["axis"])
        due = due * Rotation.from_rotvec(0.6 * axis / np.linalg.norm(axis))
        there = path[round(point["at"] / plan.period)]
        assert (there.inv() * due).magnitude() < 1e-12
    # body rates are those of the attitudes, to the second order of the period
    turned = (path[:-1].inv() * path[1:]).as_rotvec() / plan.period
    middle = 0.5 * (plan.velocity[1:] + plan.velocity[:-1])
    np.testing.assert_allclose(turned, middle, atol=3e-6)
    push = np.diff(plan.velocity, axis=0) / plan.period
    jerk = abs(push).max() / 4.0  # a jump of acceleration would be a large part of it in one tick
    assert abs(np.diff(push, axis=0)).max() < jerk * 0.1
    np.testing.assert_allclose(plan.velocity[-1], points[-1]["rate"], atol=1e-12)
    x = open_loop(plan, bench)
    assert (Rotation.from_quat(x[:, 3:7]).inv() * path).magnitude().max() < 1e-5
    assert abs(x[:, 10:13] - plan.velocity).max() < 1e-5


def test_points_of_a_constant_acceleration_about_one_axis_are_met_between_them() -> None:
    axis = np.array([1.0, 2.0, -1.0]) / np.sqrt(6.0)
    push, times = 2e-3, np.arange(1.0, 21.0)
    points: list[dict[str, Any]] = [
        {"at": t, "attitude": {"axis": axis.tolist(), "angle": 0.5 * push * t**2}} for t in times
    ]
    points[-1]["rate"] = (push * times[-1] * axis).tolist()
    plan = planned(rigid(np.zeros(3)), points=points, duration=20.0)
    t = plan.period * np.arange(plan.ticks + 1)
    # the first and the last stretch begin and end without acceleration
    inner = (t >= 2.0) & (t <= 18.0)
    np.testing.assert_allclose(plan.velocity[inner] @ axis, push * t[inner], atol=1e-12)


def test_a_spin_goes_on_about_its_axis_and_carries_the_gyroscopic_torque() -> None:
    axis, rate = np.array([1.0, 1.0, 1.0]) / np.sqrt(3.0), 0.1
    spin = {"axis": axis.tolist(), "rate": rate, "duration": 10.0}
    bench = rigid(np.array([0.3, -1.0, 2.0]))
    plan = planned(bench, spin=spin, duration=80.0)
    after = slice(round(10.0 / plan.period) + 1, None)
    np.testing.assert_allclose(
        plan.velocity[after] - rate * axis, np.zeros((plan.ticks - 500, 3)), atol=1e-12
    )
    w = rate * axis
    torque = np.cross(w, INERTIA * w)
    # what the hold let the body drift on the way, of second order in the period, goes back first
    steady = plan.effort[after][100:]
    np.testing.assert_allclose(steady, np.tile(torque, (len(steady), 1)), atol=1e-5)
    assert abs(torque).max() > 1e-2
    x = open_loop(plan, bench)
    assert (Rotation.from_quat(x[:, 3:7]).inv() * path_of(plan)).magnitude().max() < 1e-5
    assert abs(np.diff(plan.position, axis=0)).max() < 0.1  # no jump of a whole turn
    assert plan.summary["final_rate"] == pytest.approx(w.tolist())


@pytest.mark.parametrize("seed", range(2))
def test_a_profile_is_the_same_from_any_inertial_frame(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start, frame = Rotation.random(2, rng=rng)
    keys: dict[str, Any] = {"points": turns(rng), "duration": 45.0}
    one = planned(rigid(start.as_rotvec()), **keys)
    two = planned(rigid((frame * start).as_rotvec()), **keys)
    exact = 2.0 * 1e-12 * INERTIA.max() / one.period  # rates of both are met within 1e-12 rad/s
    np.testing.assert_allclose(two.effort, one.effort, atol=exact)
    np.testing.assert_allclose(two.velocity, one.velocity, atol=1e-9)
    assert ((frame * path_of(one)).inv() * path_of(two)).magnitude().max() < 1e-9


def largest_error(plan: Plan, bench: PlantDescription, law: str, values: dict[str, Any]) -> float:
    """Return the largest error of the attitude in 40 s of a flight by a law [rad]."""
    settings = BenchSettings(testbed=bench.testbed, period=bench.period, duration=40.0, active=law)
    flying, errors = Bench(settings), [0.0]

    def truth(truth: Truth) -> None:
        at = flying.model.joint_state(np.concatenate((truth.position, truth.velocity)))[0]
        off = flying.model.joint_error(at, plan.position[truth.tick])
        errors.append(float(np.linalg.norm(off)))

    it = build_controller(law, law, values, bench, "here")
    assert it.adopt(plan) is None
    run_bench(flying, {it.name: it}, Watch(truth))
    return max(errors)


# wheels leave no momentum, so the PD needs no gyroscopic torque
LAWS: dict[str, dict[str, Any]] = {"pd_feedforward": {"kp": [12.0], "kd": [60.0]}, "lqr": {}}


@pytest.mark.parametrize(("law", "ends"), products(LAWS, ["in a profile", "in a spin"]))
def test_a_craft_with_panels_and_wheels_flies_it_under_feedback(law: str, ends: str) -> None:
    testbed = example_trial("three_axes").testbed
    bench = PlantDescription(testbed, 0.05, np.array(testbed.effort_limit))
    rng = np.random.default_rng(len(law))
    keys: dict[str, Any] = {"points": turns(rng, 0.05)[:2]}
    if ends == "in a spin":
        axis = rng.standard_normal(3).tolist()
        keys |= {"spin": {"axis": axis, "rate": 0.02, "duration": 14.0}}
    plan = planned(bench, **keys, duration=40.0)
    assert largest_error(plan, bench, law, LAWS[law]) < 1e-5  # drift of the hold


@pytest.mark.parametrize("gyroscopic", representatives([False, True], True))
def test_a_rigid_craft_is_kept_on_its_spin_under_feedback(gyroscopic: bool) -> None:
    bench = rigid(np.array([1.0, 0.5, -2.0]))
    plan = planned(
        bench, spin={"axis": [1.0, -1.0, 2.0], "rate": 0.1, "duration": 15.0}, duration=40.0
    )
    values = {"kp": [3.0], "kd": [8.0], "gyroscopic": gyroscopic}
    assert largest_error(plan, bench, "pd_feedforward", values) < 1e-5


TURN = {"axis": [0.0, 0.0, 1.0], "angle": 0.5}
SPIN = {"axis": [0.0, 0.0, 1.0], "rate": 0.1, "duration": 10.0}
MOVING = {"at": 20.0, "attitude": TURN, "rate": [0.0, 0.0, 0.05]}


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({}, r"plan: points: \[\] is not allowed: give points, a spin, or both"),
        (
            {"points": [{"at": 9.0, "attitude": TURN}, {"at": 8.0, "attitude": TURN}]},
            r"points\.1\.at: 8\.0 .* later than the point before, 9 s",
        ),
        ({"points": [MOVING]}, r"duration: None .* give the time until the run's end"),
        ({"spin": SPIN, "duration": 5.0}, r"duration: 5\.0 .* at least 10 s"),
        (
            {"points": [MOVING], "spin": SPIN, "duration": 60.0},
            r"points\.0\.rate: .* zero or left out",
        ),
        ({"spin": {**SPIN, "axis": [0, 0, 0]}, "duration": 60.0}, "axis must not be zero"),
        ({"points": [{"at": 9.0, "attitude": {"angle": 1.0}}]}, "give one of quaternion"),
    ],
)
def test_what_cannot_be_followed_is_refused_with_key_and_remedy(
    keys: dict[str, Any], words: str
) -> None:
    with pytest.raises(BadInput, match=words) as caught:
        planned(rigid(np.zeros(3)), **keys)
    assert "\n" not in str(caught.value)


def test_more_torque_than_the_drives_have_is_refused_with_the_share() -> None:
    with pytest.raises(PlanFailed, match=r"yaw needs 2\.8\d times its limit, 1\.2; .* longer"):
        planned(rigid(np.zeros(3)), spin={**SPIN, "duration": 1.0}, duration=2.0)


def test_a_testbed_that_does_not_turn_in_three_axes_is_refused() -> None:
    values = {"method": "attitude_profile", "spin": SPIN, "duration": 60.0}
    with pytest.raises(BadInput, match=r"method: .attitude_profile. .* three axes"):
        make_plan(plan_settings(values, "here"), plant(0.05, (150.0, 150.0)))
