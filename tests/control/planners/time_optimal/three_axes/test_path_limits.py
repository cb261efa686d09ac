"""Fastest reorientations round cones and below a rate, against closed form and transcription."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.control.planners.time_optimal.three_axes.reorientations import (
    ASKEW,
    NAMES,
    SPHERE,
    UNIT,
    Keep,
    Triple,
    beside,
    craft,
    through,
    transcribed,
)
from tests.plants import torques
from tests.representatives import representatives, seeds

from flexslew_control.law import ActiveLaw, PlantDescription
from flexslew_control.plan import Plan
from flexslew_control.planners import make_plan, plan_settings
from flexslew_control.planners.time_optimal.three_axes.path_limits import PathLimits
from flexslew_control.planners.time_optimal.three_axes.reorientation import Reorientation
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.contract import Cone

LAW = ActiveLaw("pd_feedforward", {"kp": [1.0], "kd": [2.0]})


def slew(bench: PlantDescription, turn: Any, **keys: Any) -> Plan:
    values = {"method": "time_optimal", "drives": "all", **keys}
    values["goal"] = dict(zip(NAMES, turn, strict=True))
    return make_plan(plan_settings(values, "here"), bench, law=LAW)


def closest(plan: Plan, direction: Vector) -> float:
    """Return the smallest angle between the body's z axis and a direction at the ticks [rad]."""
    look = Rotation.from_rotvec(plan.position.copy()).apply([0.0, 0.0, 1.0])
    return float(np.arccos(look @ direction).min())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("aside", "half"), representatives([(0.0, 0.45), (-0.1, 0.35)], (-0.1, 0.35))
)
def test_it_goes_round_a_cone_hardly_later_than_a_transcription(aside: float, half: float) -> None:
    inertia, limit, turn = ASKEW
    middle = Rotation.from_rotvec(0.5 * np.array(turn)).apply([0.0, 0.0, 1.0])
    direction = middle + aside * np.cross(turn, middle)
    direction /= np.linalg.norm(direction)
    keep_out = {"sun": {"direction": direction.tolist(), "half_angle": half}}
    plan = slew(craft(inertia, limit, keep_out=keep_out), turn)
    assert closest(plan, direction) >= half - 1e-9
    assert plan.summary["path_limits"] == ["keep_out sun"]
    assert plan.duration > plan.summary["rigid_duration"] - 1e-6
    found = transcribed(*ASKEW, plan, Keep(np.array([0.0, 0.0, 1.0]), direction, half))
    assert plan.duration <= 1.02 * found
    assert max(plan.summary["predicted_residual_attitude_error"].values()) < 1e-5


FURTHER = [  # inertia, limits, turn, boresight, direction and half angle of the cone
    ((6.3, 8.6, 14.1), (1.04, 0.5, 0.88), (-2.87, -0.33, -1.23), (0.2, -0.4, -0.3),
     (-0.2, -0.62, 0.75), 0.6),
    ((19.3, 9.3, 14.7), (1.17, 0.72, 0.4), (2.51, 0.88, -0.82), (0.5, 1.9, -0.3),
     (0.64, 0.52, 0.58), 0.6),
    ((10.5, 6.3, 7.9), (0.64, 1.34, 0.54), (-0.45, -2.07, 2.03), (0.8, 1.1, 0.3),
     (-0.61, 0.79, -0.05), 0.5),
    ((17.2, 10.1, 13.2), (0.54, 1.5, 0.59), (-0.39, -2.42, 0.51), (0.0, 0.0, 1.0),
     (-0.96, 0.0, 0.27), 0.53),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("case", representatives(FURTHER, FURTHER[0], single=True))
def test_on_neither_side_of_a_cone_is_a_transcription_much_faster(case: Any) -> None:
    """The transcription starts from smooth slews past either side."""
    inertia, limit, turn, look, axis, half = case
    boresight = np.array(look) / np.linalg.norm(look)
    direction = np.array(axis) / np.linalg.norm(axis)
    keep_out = {"sun": {"boresight": boresight.tolist(), "direction": direction.tolist(),
                        "half_angle": half}}  # fmt: skip
    plan = slew(craft(inertia, limit, keep_out=keep_out), turn)
    assert plan.summary["path_limits"] == ["keep_out sun"]
    looks = Rotation.from_rotvec(plan.position.copy()).apply(boresight)
    assert np.arccos(looks @ direction).min() >= half - 1e-9
    keep = Keep(boresight, direction, half)
    for side in (1.0, -1.0):
        guess = through(beside(keep, turn, side), turn, 1.2 * plan.duration)
        assert plan.duration <= 1.02 * transcribed(inertia, limit, turn, guess, keep)


@pytest.mark.slow
def test_below_a_rate_it_coasts() -> None:
    turn: Triple = (0.0, 1.5, 0.0)
    plan = slew(craft(SPHERE, UNIT), turn, rate_limit=0.5)
    assert np.linalg.norm(plan.velocity, axis=1).max() <= 0.5
    # about one axis: to the limit with 1 rad/s^2, along, and back
    assert plan.duration == pytest.approx(1.5 / 0.5 + 0.5 / 1.0, rel=2e-3)
    assert plan.duration <= 1.02 * transcribed(SPHERE, UNIT, turn, plan, rate_limit=0.5)


@pytest.mark.slow
def test_a_limit_that_the_fastest_slew_keeps_anyway_changes_nothing() -> None:
    far = {"sun": {"direction": [0.0, 0.0, -1.0], "half_angle": 0.2}}
    free = slew(craft(SPHERE, UNIT), (0.0, 1.5, 0.0))
    kept = slew(craft(SPHERE, UNIT, keep_out=far), (0.0, 1.5, 0.0), rate_limit=3.0)
    np.testing.assert_array_equal(kept.position, free.position)
    assert kept.summary["path_limits"] == []


@pytest.mark.slow
def test_a_flexible_craft_goes_round_a_cone_with_its_modes_at_rest() -> None:
    direction = Rotation.from_rotvec([0.0, 0.35, 0.0]).apply([0.0, 0.0, 1.0])
    boom = {"shape": {"kind": "beam", "method": "closed_form", "length": 3.0,
                      "linear_density": 0.5, "bending_stiffness": 80.0, "modes_across": 1,
                      "modes_third": 1}, "damping": {"ratio": 0.005}}  # fmt: skip
    values = {
        "kind": "spacecraft", "appendages": {"boom": boom},
        "platform": {"mass": 150.0, "inertia": {"xx": 40.0, "yy": 60.0, "zz": 50.0}},
        "actuators": torques(1.5),
        "keep_out": {"sun": {"direction": direction.tolist(), "half_angle": 0.2}},
    }  # fmt: skip
    bench = PlantDescription(read_testbed(values, "here"), 0.05, np.full(3, 1.5))
    law = ActiveLaw("pd_feedforward", {"kp": [20.0], "kd": [60.0]})
    goal = {"method": "time_optimal", "drives": "all", "goal": {"pitch": 0.7}, "reserve": 0.2}
    plan = make_plan(plan_settings(goal, "here"), bench, law=law)
    assert closest(plan, direction) >= 0.2 - 1e-9
    assert plan.summary["predicted_residual_tip_deflection"] < 1e-5
    assert max(plan.summary["predicted_residual_attitude_error"].values()) < 1e-5


@pytest.mark.parametrize("seed", seeds(3))
def test_the_slopes_of_the_limits_are_those_of_differences(seed: int) -> None:
    rng = np.random.default_rng(seed)
    boresight, axis = (v / np.linalg.norm(v) for v in rng.standard_normal((2, 3)))
    limits = PathLimits((Cone("sun", boresight, axis, 0.4),), 0.3, 0.01)
    model = craft(SPHERE, UNIT).testbed.model()
    turn = Rotation.random(random_state=seed)
    x = np.concatenate((rng.standard_normal(3), turn.as_quat(), rng.standard_normal(6)))
    [row] = limits.excess(model, x[None])
    look = turn.apply(boresight)
    assert row[0] == pytest.approx(0.41 - np.arccos(look @ axis), abs=1e-9)
    assert row[1] == pytest.approx(np.linalg.norm(x[10:]) - 0.99 * 0.3)
    step = 1e-4 * rng.standard_normal(x.size)
    step[3:7] -= (step[3:7] @ x[3:7]) * x[3:7]
    ahead = limits.excess(model, (x + step)[None])[0]
    both = limits.slopes(model, np.array([x + 3.0 * step, x]), np.arange(x.size))
    np.testing.assert_allclose(ahead - row, both[1] @ step, atol=1e-6)
    [alone] = limits.slopes(model, (x + 3.0 * step)[None], np.arange(x.size))
    np.testing.assert_allclose(both[0], alone, atol=1e-9)


def test_the_slopes_along_a_flight_are_those_of_flights() -> None:
    rng, axis = np.random.default_rng(3), np.array([0.0, 0.6, 0.8])
    limits = PathLimits((Cone("sun", np.array([0.0, 0.0, 1.0]), axis, 0.4),), 0.8)
    model, turn = craft(SPHERE, UNIT).testbed.model(), np.array([0.0, 1.5, 0.0])
    body = Reorientation(model, np.zeros(3), turn, np.ones(3), limits=limits)
    efforts, held = rng.uniform(-1.0, 1.0, (6, 3)), np.full(6, 0.5)
    along, step = body.ended(efforts, held).along, 1e-5 * rng.standard_normal((6, 3))
    assert len(along.excess) > 6  # of both limits, at some of the ends of the pieces
    ahead, back = (body.ended(efforts + sign * step, held).along.excess for sign in (1.0, -1.0))
    told = np.tensordot(along.by_effort, step)
    np.testing.assert_allclose(0.5 * (ahead - back), told, atol=1e-4 * abs(told).max())


def test_ends_inside_of_a_cone_and_limits_of_others_are_refused() -> None:
    for direction, words in (([0.0, 0.0, 1.0], "start"), ([1.0, 0.0, 0.07], "goal")):
        keep_out = {"sun": {"direction": direction, "half_angle": 0.3}}
        with pytest.raises(PlanFailed, match=f"the {words} looks into keep_out sun, by"):
            slew(craft(SPHERE, UNIT, keep_out=keep_out), (0.0, 1.5, 0.0))
    with pytest.raises(BadInput, match="rate_limit"):
        slew(craft(SPHERE, UNIT), (0.0, 1.5, 0.0), drives="moving", rate_limit=0.2)
