"""Slews about the eigenaxis: they stay on it, whatever the frame, and fly as predicted."""

from dataclasses import fields, replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.control.planners.residuals import residual_of
from tests.plants import torques
from tests.representatives import products, representatives, seeds

from flexslew_control.controllers import build_controller
from flexslew_control.law import ActiveLaw, PlantDescription
from flexslew_control.plan import Plan
from flexslew_control.planners import PLANNERS, make_plan, plan_settings
from flexslew_control.planners.residual.prediction import MIN_MONITOR_TIME
from flexslew_lab.reproduce.scole_flights import example_trial
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.settings import plain
from flexslew_plant.testbeds import read_testbed

NAMES = ("roll", "pitch", "yaw")
INERTIA = np.array([10.0, 14.0, 18.0])  # [kg m^2]
LIMIT = np.array([1.0, 0.7, 1.2])  # [N m]


def rigid(start: Vector, inertia: Vector = INERTIA, limit: Vector = LIMIT) -> PlantDescription:
    """Return a rigid craft with a torque about each axis, at an attitude."""
    testbed = read_testbed(
        {
            "kind": "spacecraft",
            "platform": {
                "mass": 50.0,
                "inertia": dict(zip(("xx", "yy", "zz"), inertia, strict=True)),
            },
            "appendages": {},
            "actuators": torques(*limit.tolist()),
            "initial": dict(zip(NAMES, start.tolist(), strict=True)),
        },
        "here",
    )
    return PlantDescription(testbed, 0.02, limit)


def planned(bench: PlantDescription, goal: Any, method: str = "time_optimal", **keys: Any) -> Plan:
    return make_plan(plan_settings({"method": method, "goal": goal, **keys}, "here"), bench)


def open_loop(plan: Plan, bench: PlantDescription) -> Matrix:
    """Return the states of the craft under the efforts of a plan alone."""
    model = bench.testbed.model()
    rest = model.rest(dict(zip(plan.joint_names, plan.position[0].tolist(), strict=True)))
    rows = [np.concatenate((rest, np.zeros(model.coordinates)))]
    for effort in plan.effort:
        rows.append(model.advance(rows[-1], effort, plan.period))
    return np.array(rows)


@pytest.mark.parametrize("seed", range(4))
def test_the_craft_turns_about_the_eigenaxis_from_any_attitude_to_any_other(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start, goal = Rotation.random(2, rng)
    bench = rigid(start.as_rotvec())
    plan = planned(bench, {"quaternion": goal.as_quat().tolist()})
    assert plan.summary["angle"] == pytest.approx((start.inv() * goal).magnitude())
    assert plan.summary["angle"] <= np.pi
    x = open_loop(plan, bench)
    turned = (start.inv() * Rotation.from_quat(x[:, 3:7])).as_rotvec()
    axis = np.array(plan.summary["eigenaxis"])
    across = turned - np.outer(turned @ axis, axis)
    assert np.linalg.norm(across, axis=1).max() < 1e-6
    assert (Rotation.from_quat(x[-1, 3:7]).inv() * goal).magnitude() < 1e-6
    assert abs(x[-1, 10:13]).max() < 1e-7
    assert (abs(plan.effort) <= LIMIT).all()
    assert abs(plan.effort / LIMIT).max() > 0.75  # not slower than it need be


def skewed() -> PlantDescription:
    """Return a rigid craft with three wheels that are not at right angles."""
    axes = {"roll": [1.0, 0.0, 0.0], "pitch": [0.6, 0.8, 0.0], "yaw": [0.0, 0.6, 0.8]}
    wheels = {n: {"axis": axis, "inertia": 0.05, "limit": 1.0} for n, axis in axes.items()}
    inertia = dict(zip(("xx", "yy", "zz"), INERTIA, strict=True))
    platform = {"mass": 50.0, "inertia": inertia}
    testbed = read_testbed(
        {"kind": "spacecraft", "platform": platform, "actuators": {}, "wheels": wheels}, "here"
    )
    return PlantDescription(testbed, 0.02, np.ones(3))


@pytest.mark.parametrize("bench", [rigid(np.array([0.0, 0.0, 1.0])), skewed()], ids=["off", "skew"])
@pytest.mark.parametrize("joint", ["roll", "pitch"])
def test_one_joint_that_is_not_turned_alone_is_turned_about_the_eigenaxis(
    bench: PlantDescription, joint: str
) -> None:
    model = bench.testbed.model()
    assert model.attitude is not None
    plan = planned(bench, {joint: 0.8})
    first = plan.position[0]
    last = np.where(np.array(plan.joint_names) == joint, 0.8, first)
    goal = Rotation.from_quat(model.attitude.orientation(last))
    x = open_loop(plan, bench)
    assert (Rotation.from_quat(x[-1, 3:7]).inv() * goal).magnitude() < 1e-6
    assert abs(x[-1, model.positions :][3:6]).max() < 1e-7


@pytest.mark.parametrize("start", [0.0, 0.9])
@pytest.mark.parametrize("goal", [{"yaw": 0.8}, {"axis": [1.0, 2.0, -0.5], "angle": 1.2}])
def test_what_reads_the_place_of_a_point_goes_with_the_turn(goal: Any, start: float) -> None:
    craft: Any = rigid(np.array([start, 0.0, 0.0])).testbed
    push = {"kind": "force", "direction": [0.0, 1.0, 0.0], "place": [0.7, 0.1, 0.2], "limit": 5.0}
    actuators: Any = {**plain(craft.actuators), "push": push}
    bench = PlantDescription(replace(craft, actuators=actuators), 0.02, np.append(LIMIT, 5.0))
    bench = replace(bench, testbed=read_testbed(plain(bench.testbed), "here"))
    law = ActiveLaw("pd_feedforward", {"kp": [5.0], "kd": [10.0]})
    values = {"method": "input_shaping", "goal": goal, "duration": 30.0}
    plan = make_plan(plan_settings(values, "here"), bench, law=law)
    left = plan.summary["predicted_residual_attitude_error"]
    assert max(left.values()) < 1e-4


def test_a_joint_that_is_turned_alone_may_turn_more_than_half_round() -> None:
    plan = planned(rigid(np.array([0.0, 0.0, 1.0])), {"yaw": 6.0})
    assert "eigenaxis" not in plan.summary
    np.testing.assert_allclose(np.ptp(plan.position, axis=0), [0.0, 0.0, 5.0], atol=1e-12)


def test_a_whole_turn_in_several_joints_is_no_goal() -> None:
    around = {"roll": 4.0, "pitch": float(np.sqrt(4.0 * np.pi**2 - 16.0))}
    with pytest.raises(BadInput, match="goal: another attitude: whole turns away"):
        planned(rigid(np.zeros(3)), around)


def test_the_efforts_carry_the_gyroscopic_torque() -> None:
    bench = rigid(np.zeros(3))
    plan = planned(bench, {"axis": [1.0, 1.0, 1.0], "angle": 1.0}, "input_shaping", duration=12.0)
    axis = np.ones(3) / np.sqrt(3.0)
    rate = plan.velocity @ axis
    push = np.diff(rate) / plan.period
    turn = INERTIA * axis
    middle = 0.5 * (rate[1:] + rate[:-1])
    expected = np.outer(push, turn) + np.outer(middle**2, np.cross(axis, turn))
    # the hold is of second order in the period
    np.testing.assert_allclose(plan.effort, expected, atol=3e-4 * abs(expected).max())
    assert abs(np.outer(middle**2, np.cross(axis, turn))).max() > 1e-2 * abs(expected).max()


@pytest.mark.parametrize("seed", range(2))
def test_a_plan_is_the_same_from_any_inertial_frame(seed: int) -> None:
    start, goal, frame = Rotation.random(3, np.random.default_rng(seed))
    one = planned(rigid(start.as_rotvec()), {"quaternion": goal.as_quat().tolist()})
    two = planned(
        rigid((frame * start).as_rotvec()), {"quaternion": (frame * goal).as_quat().tolist()}
    )
    np.testing.assert_allclose(two.effort, one.effort, atol=1e-9)
    np.testing.assert_allclose(two.velocity, one.velocity, atol=1e-9)
    path = frame * Rotation.from_rotvec(one.position.copy())
    assert (path.inv() * Rotation.from_rotvec(two.position.copy())).magnitude().max() < 1e-9
    assert abs(np.diff(two.position, axis=0)).max() < 0.1  # no jump of a whole turn


def test_a_sphere_turns_half_round_about_the_eigenaxis_in_twice_the_root_of_pi() -> None:
    sphere = rigid(np.zeros(3), np.ones(3), np.ones(3))
    plan = planned(sphere, {"axis": [0.0, 0.0, 1.0], "angle": np.pi})
    assert plan.duration == pytest.approx(2.0 * np.sqrt(np.pi), abs=1e-6)  # 3.5449


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(20))
def test_flexible_slews_of_30_degrees_about_any_axis_fly_as_predicted(seed: int) -> None:
    wheels = {
        name: {"axis": axis, "inertia": 0.02, "limit": 0.5, "momentum_limit": 10.0}
        for name, axis in zip(NAMES, np.eye(3).tolist(), strict=True)
    }
    testbed = example_trial("own_spacecraft", {"testbed": {"wheels": wheels}}).testbed
    bench = PlantDescription(testbed, 0.1, np.array(testbed.effort_limit))
    gains = {"kp": [12.0], "kd": [60.0]}
    axis = np.random.default_rng(seed).standard_normal(3).tolist()
    values = {
        "method": "input_shaping",
        "duration": 28.0,
        "goal": {"axis": axis, "angle": "30 deg"},
    }
    plan = make_plan(plan_settings(values, "here"), bench, law=ActiveLaw("pd_feedforward", gains))
    duration = float(np.ceil(plan.end + MIN_MONITOR_TIME))
    flying = Bench(BenchSettings(testbed=testbed, period=bench.period, duration=duration))
    it = build_controller("pd_feedforward", "pd_feedforward", gains, bench, "here")
    left = residual_of(plan, flying, {it.name: it})
    predicted = plan.summary["predicted_residual_attitude_error"]
    assert left.tip == pytest.approx(plan.summary["predicted_residual_tip_deflection"], abs=1e-8)
    np.testing.assert_allclose(left.joints, [predicted[name] for name in NAMES], atol=1e-8)
    assert left.tip < 1e-5
    assert left.joints.max() < 1e-5


def test_a_joint_that_does_not_turn_the_craft_does_not_go_along() -> None:
    push = {"kind": "force", "direction": [1.0, 0.0, 0.0], "limit": 1.0}
    pushed = {**torques(1.0), "x": push}
    testbed = read_testbed({"kind": "spacecraft", "appendages": {}, "actuators": pushed}, "here")
    bench = PlantDescription(testbed, 0.02, np.full(4, 100.0))
    with pytest.raises(BadInput, match="one axis at a time"):
        planned(bench, {"roll": 0.1, "x": 1.0})


def test_a_period_that_is_long_for_the_modes_is_refused_with_the_remedy() -> None:
    testbed = example_trial("observatory", {}).testbed
    law = ActiveLaw("pd_feedforward", {"kp": [12.0], "allocation": {"kind": "thrusters"}})
    goal = {"axis": [1.0, 2.0, 0.5], "angle": 0.5}
    settings = plan_settings({"method": "input_shaping", "duration": 120.0, "goal": goal}, "here")
    limit = np.array(testbed.effort_limit)
    assert make_plan(settings, PlantDescription(testbed, 0.2, limit), law=law).effort.any()
    with pytest.raises(PlanFailed, match=r"over a period of 0\.25 s .* use a shorter period"):
        make_plan(settings, PlantDescription(testbed, 0.25, limit), law=law)


ONE: dict[str, Any] = {"pitch": 0.4}
THREE: dict[str, Any] = {"axis": [1.0, -2.0, 0.5], "angle": 1.0}
# what a section is asked for besides, where its defaults are of another testbed
ASKED: dict[str, Any] = {
    "attitude_profile": {"points": [{"at": 40.0, "attitude": {"axis": [0, 1, 0], "angle": 0.4}}]},
    "joint_trajectory": {"points": [{"at": 40.0, "position": {"pitch": 0.4}}]},
    "minimax_feedforward": {"duration": 40.0},
    "optimized_feedforward": {"duration": 40.0, "feedback": {"kp": [1.0], "kd": [5.0]}},
    "start_coast_stop": {"duration": 40.0},
}
FLOWN = {  # by efforts alone: what they leave, [rad] and [rad/s]
    "attitude_profile": 1e-6,
    "input_shaping": 1e-6,
    "minimax_feedforward": 1e-6,
    "optimized_feedforward": 1e-6,
    "robust_feedforward": 2e-5,  # a feedforward that is not exact, but weighed
    "start_coast_stop": 1e-6,
    "time_optimal": 1e-6,
}
REFUSED: dict[tuple[str, str], str] = {
    ("excitation", "one axis"): "band: is missing: the model has no modes",
    ("excitation", "three axes"): "band: is missing: the model has no modes",
    ("retargeting", "one axis"): "no hinge turns",
    ("retargeting", "three axes"): "no hinge turns",
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "axes"),
    representatives(
        product(PLANNERS, ["one axis", "three axes"]), *product(PLANNERS, ["three axes"])
    ),
)
def test_every_planner_turns_a_rigid_craft_or_refuses_it_in_one_line(
    method: str, axes: str
) -> None:
    bench = rigid(np.array([0.0, 0.3, 0.0]))
    known = {one.name for one in fields(PLANNERS[method].settings)}
    goal = {"goal": ONE if axes == "one axis" else THREE} if "goal" in known else {}
    values = {"method": method, **goal, **ASKED.get(method, {})}
    if (method, axes) in REFUSED:
        with pytest.raises((BadInput, PlanFailed), match=REFUSED[method, axes]) as caught:
            make_plan(plan_settings(values, "here"), bench)
        assert "\n" not in str(caught.value)
        return
    plan = make_plan(plan_settings(values, "here"), bench)
    assert (abs(plan.effort) <= LIMIT + 1e-12).all()  # rounding of the hold
    if method in FLOWN:
        end = open_loop(plan, bench)[-1]
        aim = Rotation.from_rotvec(plan.position[-1].copy())
        assert (Rotation.from_quat(end[3:7]).inv() * aim).magnitude() < FLOWN[method]
        assert abs(end[10:13]).max() < FLOWN[method]


@pytest.mark.parametrize(
    ("shaper", "feedforward"),
    products(["clamped", "system", "none"], ["elastic", "rigid", "zero_order"]),
)
def test_pulses_of_a_rigid_craft_have_nothing_to_shape(shaper: str, feedforward: str) -> None:
    bench = rigid(np.zeros(len(NAMES)))
    keys = {"duration": 40.0, "shaper": shaper, "feedforward": feedforward}
    plan = planned(bench, ONE, "start_coast_stop", **keys)
    assert plan.summary["shaper_delay"] == 0.0
    unshaped = planned(bench, ONE, "start_coast_stop", **{**keys, "shaper": "none"})
    np.testing.assert_array_equal(plan.effort, unshaped.effort)
