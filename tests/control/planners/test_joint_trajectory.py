"""A plan through given points: its polynomials, its feedforward, and what is refused."""

import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tests.plants import plant

from flexslew_control.plan import Plan
from flexslew_control.planners import make_plan, plan_settings
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import read_testbed

PERIOD = 0.01


def planned(points: list[dict[str, Any]], **more: Any) -> Plan:
    values = {"method": "joint_trajectory", "points": points, **more}
    return make_plan(plan_settings(values, "trial.yaml"), plant(PERIOD, (150.0, 150.0)))


def point(at: float, yaw: float, **more: float) -> dict[str, Any]:
    keys: dict[str, Any] = {key: {"base_yaw": value} for key, value in more.items()}
    return {"at": at, "position": {"base_yaw": yaw}, **keys}


@given(
    degree=st.sampled_from((1, 3, 5)),
    coefficients=st.lists(st.floats(-0.1, 0.1), min_size=6, max_size=6),
    inner=st.lists(st.integers(1, 499), max_size=6, unique=True),
)
def test_a_polynomial_of_as_many_derivatives_as_are_given_is_met_at_every_tick(
    degree: int, coefficients: list[float], inner: list[int]
) -> None:
    path = np.polynomial.Polynomial(coefficients[: degree + 1], domain=[0.0, 5.0])
    end = path.linspace(2, [0.0, 5.0])[1][1]
    keys = ("velocity", "acceleration")[: degree // 2]
    points = []
    for tick in (0, *sorted(inner), 500):
        t = PERIOD * tick
        more = {key: float(path.deriv(k + 1)(t)) for k, key in enumerate(keys)}
        points.append(point(t, float(path(t)), **more))
    points.append(point(7.0, float(end), **dict.fromkeys(keys, 0.0)))
    plan = planned(points)
    ticks = PERIOD * np.arange(501)
    np.testing.assert_allclose(plan.position[:501, 0], path(ticks), atol=1e-12)
    np.testing.assert_allclose(plan.velocity[1:500, 0], path.deriv()(ticks[1:500]), atol=1e-10)
    assert not plan.position[:, 1].any()
    assert plan.duration == 7.0


def test_without_a_point_at_its_start_it_begins_at_rest_where_the_joints_are() -> None:
    plan = planned([point(2.0, 0.5, velocity=0.0)], initial={"base_yaw": 0.1}, start=3.0)
    s = np.linspace(0.0, 1.0, 201)
    np.testing.assert_allclose(plan.position[:, 0], 0.1 + 0.4 * (3 * s**2 - 2 * s**3), atol=1e-14)
    assert plan.velocity[0, 0] == plan.velocity[-1, 0] == 0.0
    assert plan.reference(0).position[0] == 0.1
    assert plan.reference(10_000).position[0] == 0.5


def test_efforts_are_linear_between_points_and_held_at_their_mean_over_each_tick() -> None:
    plan = planned([point(1.0, 0.0, effort=10.0), point(3.0, 0.0, effort=-10.0)])
    t = PERIOD * np.arange(300)
    middle = t + 0.5 * PERIOD
    expected = np.where(t < 1.0 - 1e-9, 10.0 * middle, 10.0 - 10.0 * (middle - 1.0))
    np.testing.assert_allclose(plan.effort[:, 0], expected, atol=1e-12)
    assert plan.summary["peak_effort"] == pytest.approx([9.95, 0.0])


@given(
    later=st.lists(st.floats(0.001, 0.05), min_size=1, max_size=9),
    efforts=st.lists(st.floats(-150.0, 150.0), min_size=9, max_size=9),
)
def test_points_between_ticks_keep_their_impulse(later: list[float], efforts: list[float]) -> None:
    """The impulse until any tick is the sum of trapezoids; after the last point there is none."""
    times = np.cumsum([0.0, *later])
    values = np.array([0.0, *efforts[: len(later)]])
    plan = planned([point(t, 0.0, effort=u) for t, u in zip(times[1:], values[1:], strict=True)])
    for k in range(plan.ticks + 1):
        until = min(PERIOD * k, times[-1])
        edges = np.union1d(times[times < until], until)
        there = np.interp(edges, times, values)
        expected = 0.5 * (there[1:] + there[:-1]) @ np.diff(edges)
        assert PERIOD * plan.effort[:k, 0].sum() == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize(
    ("points", "words"),
    [
        ([], "points: [] is not allowed: at least one"),
        ([{"at": 1.0, "position": {"elbow": 1.0}}], "points.0.position: elbow is not a joint"),
        ([point(1.0, 0.1), point(1.0, 0.2)], "points.1.at: 1.0 is not allowed: later than"),
        ([point(0.0, 0.1)], "points.0.at: 0.0 is not allowed: above 0 s at the last point"),
        ([point(1.0, 0.1, velocity=0.2)], "points.0.velocity: {'base_yaw': 0.2} is not allowed"),
        ([point(1.0, 0.1, acceleration=0.0)], "points.0.velocity: {} is not allowed"),
        ([point(1.0, 0.1, effort=151.0)], "points.0.effort.base_yaw: 151.0 is not allowed"),
        (
            [point(1.0, 0.1), {"at": 2.0, "position": {"hub_pitch": 0.1}}],
            "points.1.position: ['hub_pitch'] is not allowed: name base_yaw as in the first",
        ),
        ([point(1.0, float("nan"))], "points.0.position.base_yaw: nan is not allowed"),
    ],
)
def test_points_that_cannot_be_followed_are_refused_by_their_key(
    points: list[dict[str, Any]], words: str
) -> None:
    with pytest.raises(BadInput, match=re.escape(words)) as caught:
        planned(points)
    assert "\n" not in str(caught.value)


def test_the_rates_of_a_craft_in_three_axes_are_body_rates() -> None:
    """By the rotations between ticks (SciPy); about one axis they are those of the polynomial."""
    craft = read_testbed({"kind": "spacecraft", "appendages": {}}, "here")
    bench = plant(0.01, (100.0, 100.0, 100.0), craft)
    points: list[dict[str, Any]] = [
        {"at": 10.0, "position": {"roll": 1.0, "pitch": -0.3, "yaw": 0.2}},
        {"at": 25.0, "position": {"roll": 0.2, "pitch": 1.1, "yaw": -0.4}},
    ]
    still = dict.fromkeys(("roll", "pitch", "yaw"), 0.0)
    for one in points:
        one["velocity"] = still
    plan = make_plan(plan_settings({"method": "joint_trajectory", "points": points}, "t"), bench)
    turned = Rotation.from_rotvec(np.array(plan.position))
    rates = (turned[:-2].inv() * turned[2:]).as_rotvec() / 0.02
    slopes = np.gradient(plan.position, 0.01, axis=0)[1:-1]
    assert np.abs(rates - slopes).max() > 0.02
    smooth = np.arange(1, 2500) != 1000  # at the point in between accelerations jump
    assert plan.velocity[1:-1][smooth] == pytest.approx(rates[smooth], rel=0, abs=2e-6)
    points[1]["position"] = {"roll": 0.5, "pitch": -0.15, "yaw": 0.1}
    plan = make_plan(plan_settings({"method": "joint_trajectory", "points": points}, "t"), bench)
    slopes = np.gradient(plan.position, 0.01, axis=0)[1:-1]
    assert plan.velocity[1:-1][smooth] == pytest.approx(slopes[smooth], rel=0, abs=2e-6)


@pytest.mark.parametrize("off", [0.2, -3e-6, 0.0])
def test_a_first_point_away_from_the_bench_is_warned_of_with_the_jump(off: float) -> None:
    first, last = point(0.0, off), point(1.0, 0.3)
    settings = plan_settings({"method": "joint_trajectory", "points": [first, last]}, "trial.yaml")
    plan = make_plan(settings, plant())
    warning = plan.summary.get("warning", "")
    assert (f"base_yaw by {off:.4g} rad" in warning) == bool(off)
    there = plan_settings(
        {"method": "joint_trajectory", "points": [first, last], "initial": {"base_yaw": off}},
        "trial.yaml",
    )
    assert "warning" not in make_plan(there, plant()).summary
