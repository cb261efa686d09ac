"""Least vibration round cones and below rates: kept by all members and flown as planned."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.control.planners.minimax.test_minimax_three_axes import (
    GAINS,
    LAW,
    LIMIT,
    PERIOD,
    QUICK,
    bench_with,
    derivatives_and_flights,
    flown_members,
)
from tests.plants import AXES
from tests.representatives import representatives

from flexslew_control.law import PlantDescription
from flexslew_control.plan import Plan
from flexslew_control.planners import make_plan, plan_settings
from flexslew_control.planners.minimax import minimax_feedforward, search
from flexslew_control.planners.minimax.between_ticks import passed
from flexslew_control.planners.minimax.members import members_of
from flexslew_control.planners.minimax.minimax_feedforward import question_of
from flexslew_control.planners.minimax.nonlinear_path import channels
from flexslew_control.planners.minimax.question import Question
from flexslew_control.planners.minimax.search import smooth
from flexslew_control.planners.slew import slew_of
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput, PlanFailed

ERRORS = (0.0, -0.2, -0.1, 0.1, 0.2)  # of the stiffness: members of all plans here
WATCHED = 200  # ticks after the end


def question(plant: PlantDescription, goal: Any, **more: Any) -> Question:
    settings: Any = plan_settings({**QUICK, "goal": goal, **more}, "here")
    return question_of(settings, slew_of(settings, plant, GAINS))


def turn_past(seed: int, cones: int) -> tuple[PlantDescription, dict[str, float]]:
    """Return a random turn, and a craft with cones near the middle of its boresights' ways."""
    rng = np.random.default_rng([50, seed])
    axis, angle, keep_out = rng.standard_normal(3), float(rng.uniform(0.5, 1.2)), {}
    axis /= np.linalg.norm(axis)
    for k in range(cones):
        boresight = np.cross(axis, rng.standard_normal(3))
        boresight /= np.linalg.norm(boresight)
        middle = Rotation.from_rotvec(0.5 * angle * axis).apply(boresight)
        keep_out[f"cone_{k}"] = {
            "boresight": boresight.tolist(),
            "direction": (middle + rng.uniform(-0.1, 0.1) * axis).tolist(),
            "half_angle": angle * float(rng.uniform(0.15, 0.3)),
        }
    return bench_with(keep_out=keep_out), dict(zip(AXES, (angle * axis).tolist(), strict=True))


class Flight(NamedTuple):
    """A member from the start to some time after the end, at every half tick."""

    position: Matrix  # of the joints
    rate: Matrix
    tip: Vector  # largest |tip|


def flown(plan: Plan, plant: PlantDescription, error: float) -> Flight:
    """Return the flight of a member under feedback joint by joint, held over every tick."""
    model = plant.testbed.scaled(stiffness=1.0 + error).model()
    rest = model.rest(dict(zip(model.joint_names, plan.position[0].tolist(), strict=True)))
    x, rows = np.concatenate((rest, np.zeros(model.coordinates))), []
    still = np.zeros((WATCHED, 3))
    efforts = np.vstack((plan.effort, still))
    references = np.vstack((plan.position[:-1], still + plan.position[-1]))
    rates = np.vstack((plan.velocity[:-1], still))
    kp, kd = GAINS.kp[0], GAINS.kd[0]
    for effort, reference, velocity in zip(efforts, references, rates, strict=True):
        position, rate = model.joint_state(x)
        held = effort + kp * model.joint_error(position, reference) + kd * (velocity - rate)
        held = np.clip(held, -LIMIT, LIMIT)
        for y in (x, model.advance(x, held, 0.5 * PERIOD)):
            tip = np.abs(model.appendages.tip @ model.modal_state(y)[0]).max()
            rows.append((*model.joint_state(y), tip))
        x = model.advance(x, held, PERIOD)
    position, rate, tips = (np.array(part) for part in zip(*rows, strict=True))
    return Flight(position, rate, tips)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "cones", "duration", "keys"),
    representatives(
        [  # durations are 1.25 to 1.5 times what a rigid craft takes
            (1, 2, 15.3, {}),
            (3, 1, 12.8, {"exact_nominal": True}),
            (2, 1, 22.9, {"rate_limit": 0.075}),
            (6, 0, 16.0, {"rate_limit": {"roll": 0.06, "pitch": 0.05}}),
        ],
        (3, 1, 12.8, {"exact_nominal": True}),
    ),
)
def test_every_member_keeps_to_cones_and_rates_and_leaves_what_was_promised(
    seed: int, cones: int, duration: float, keys: Any
) -> None:
    plant, goal = turn_past(seed, cones)
    values = {**QUICK, **keys, "goal": goal, "duration": duration}
    asked = question(plant, goal, duration=duration, **keys)
    plan = make_plan(plan_settings(values, "here"), plant, GAINS, law=LAW)
    start = smooth(asked, asked.grid())
    assert passed(flown_members(asked), start) > 0.1  # the eigenaxis does not keep to them
    last, limit = len(plan.effort), keys.get("rate_limit")
    for error in ERRORS:
        flight = flown(plan, plant, error)
        attitude = Rotation.from_rotvec(flight.position).as_quat()
        sky: Any = plant.testbed
        for cone in sky.sky().cones:
            assert cone.margin(attitude).min() >= 0.0
        for name, most in limit.items() if isinstance(limit, dict) else ():
            assert np.abs(flight.rate[:, [*AXES].index(name)]).max() <= most
        if isinstance(limit, float):
            assert 0.9 * limit < np.linalg.norm(flight.rate, axis=1).max() <= limit
        # at the ticks; the search takes 1e-5 m as nothing
        assert flight.tip[2 * last :: 2].max() <= plan.summary["worst_residual"] + 1e-5
        if error == 0.0:
            away = flight.position[: 2 * last : 2] - plan.position[:-1]
            assert np.abs(away).max() < 1e-5


@pytest.mark.slow
def test_without_anything_to_spare_the_cones_are_kept_out_of_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What the search misses on the way is found between the ticks, and it goes on tighter."""
    shares: list[float] = []

    def recorded(*args: Any) -> float:
        shares.append(passed(*args))
        return shares[-1]

    monkeypatch.setattr(minimax_feedforward, "PATH_MARGIN", 0.0)
    monkeypatch.setattr(search, "passed", recorded)
    plant, goal = turn_past(1, 2)
    values = {**QUICK, "goal": goal, "duration": 15.3}
    plan = make_plan(plan_settings(values, "here"), plant, GAINS, law=LAW)
    assert shares[0] > 0.0 >= shares[-1]
    sky: Any = plant.testbed
    for error in ERRORS:
        attitude = Rotation.from_rotvec(flown(plan, plant, error).position).as_quat()
        for cone in sky.sky().cones:
            assert cone.margin(attitude).min() >= 0.0


def test_what_is_passed_is_seen_at_the_depth_of_the_eigenaxis() -> None:
    direction = [float(np.sin(0.5)), 0.0, float(np.cos(0.5))]
    plant = bench_with(keep_out={"sun": {"direction": direction, "half_angle": 0.2}})
    asked = question(plant, {"pitch": 1.0}, duration=20.0, ensemble={"vary": {}})
    # the boresight goes through the axis of the cone, between two of the points looked at
    weights = smooth(asked, asked.grid())
    assert passed(flown_members(asked), weights) == pytest.approx(1.0, abs=0.02)
    aside = bench_with(keep_out={"sun": {"direction": [0.0, 1.0, 0.0], "half_angle": 0.2}})
    asked = question(aside, {"pitch": 1.0}, duration=20.0, ensemble={"vary": {}})
    most = passed(flown_members(asked), weights)
    assert most == pytest.approx(1.0 - 0.5 * np.pi / 0.2, abs=1e-3)  # a right angle away


@pytest.mark.slow
def test_the_derivatives_of_cones_and_rates_are_those_of_flights() -> None:
    keep_out = {
        "sun": {"direction": [0.3, 0.2, 0.9], "half_angle": 0.2},
        "moon": {"boresight": [1.0, 0.5, 0.0], "direction": [0.0, 1.0, 0.4], "half_angle": 0.3},
    }
    goal = {"roll": 1.3, "pitch": 0.5, "yaw": -1.0}
    asked = question(bench_with(keep_out=keep_out), goal, duration=12.0, pieces=6, rate_limit=0.3)
    motion, member = asked.motion, members_of(asked.ensemble, asked.slew)[1].model
    others = len(member.appendages.names) + 3 * len(AXES)
    limited = range(others, others + 3)
    found, beside = derivatives_and_flights(asked, member, limited)
    for k in (0, 7, asked.grid().size - 1):
        ahead, behind = beside(k, 1e-4)
        by = (channels(motion, member, ahead) - channels(motion, member, behind)) / 2e-4
        for channel in limited:
            # beside an angle of zero the angle bends by 1/angle: none here comes near it
            slopes = found.slopes[channel][1:, k]  # at rest the length of the rate has none
            np.testing.assert_allclose(slopes, by[1:, channel], atol=1e-6)


@pytest.mark.slow
def test_the_shortest_turn_within_a_bound_goes_round_a_cone_below_a_rate() -> None:
    plant, goal = turn_past(0, 1)
    more: dict[str, Any] = {"ensemble": {"vary": {}}, "pieces": 8}
    more["rate_limit"] = dict.fromkeys(AXES, 0.1)
    values = {**QUICK, **more, "goal": goal, "duration": 17.7, "residual_bound": 0.01}
    plan = make_plan(plan_settings(values, "here"), plant, GAINS, law=LAW)
    assert plan.summary["worst_residual"] <= 0.01
    assert 12.0 < plan.duration < 17.2  # a rigid craft takes 12.7 s below any rate
    flight = flown(plan, plant, 0.0)
    sky: Any = plant.testbed
    attitude = Rotation.from_rotvec(flight.position).as_quat()
    assert sky.sky().cones[0].margin(attitude).min() >= 0.0
    assert np.abs(flight.rate).max() <= 0.1


@pytest.mark.parametrize(
    ("direction", "words"),
    [
        ([0.0, 0.0, 1.0], "plan: initial: the start looks into keep_out sun, by 0.3 rad"),
        ([1.0, 0.0, 0.07], "plan: goal: the goal looks into keep_out sun, by"),
    ],
)
def test_ends_inside_of_a_cone_are_refused(direction: Any, words: str) -> None:
    plant = bench_with(keep_out={"sun": {"direction": direction, "half_angle": 0.3}})
    with pytest.raises(PlanFailed, match=words):
        question(plant, {"pitch": 1.5}, duration=30.0)


def test_a_length_of_the_rate_is_of_turns_in_three_axes() -> None:
    values = {**QUICK, "drives": "moving", "goal": {"pitch": 0.5}, "rate_limit": 0.1}
    with pytest.raises(BadInput, match="turns in three axes with drives: all"):
        make_plan(plan_settings(values, "here"), bench_with(keep_out={}), GAINS, law=LAW)
