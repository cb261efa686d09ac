"""Joints held against a plan: on the way, at its end, and after it."""

import numpy as np
import pytest

from flexslew_control.plan import Plan
from flexslew_control.plans.tracking import Tolerance, Tracking, TrackingCode

PLAN = Plan(
    method="joint_trajectory",
    joint_names=("base_yaw", "hub_pitch"),
    start=1.0,
    period=0.5,
    position=np.array([[0.0, 0.0], [0.5, 0.1], [1.0, 0.2]]),
    velocity=np.array([[0.0, 0.0], [1.0, 0.2], [0.0, 0.0]]),
    effort=np.zeros((2, 2)),
    state=np.zeros((3, 0)),
    duration=1.0,
)
BOTH = ("hub_pitch", "base_yaw")  # as a client may order them


def ended(
    time: float,
    off: dict[str, float],
    rate: float = 0.0,
    path: dict[str, Tolerance] | None = None,
    goal: dict[str, Tolerance] | None = None,
    replaced: bool = False,
) -> TrackingCode | None:
    """Return the code with joints so far off what the plan says."""
    tracking = Tracking(PLAN, BOTH, path or {}, goal or {}, 0.5)
    reference = PLAN.reference(round(time / PLAN.period))
    names = PLAN.joint_names
    at = {n: x + off.get(n, 0.0) for n, x in zip(names, reference.position, strict=True)}
    rates = {n: x + rate for n, x in zip(names, reference.velocity, strict=True)}
    end = tracking.end(time, tracking.at(time, at, rates), replaced)
    return None if end is None else end.code


def test_errors_are_told_in_the_order_of_the_client() -> None:
    seen = Tracking(PLAN, BOTH, {}, {}).at(
        1.5, {"base_yaw": 0.4, "hub_pitch": 0.3}, dict.fromkeys(BOTH, 0.1)
    )
    np.testing.assert_allclose(seen.desired, ([0.1, 0.5], [0.2, 1.0]))
    np.testing.assert_allclose(seen.error, ([-0.2, 0.1], [0.1, 0.9]))


@pytest.mark.parametrize("name", BOTH)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_joint_leaves_its_tolerance_on_the_way(name: str, sign: float) -> None:
    limits = {name: Tolerance(0.1, 0.3)}
    assert ended(1.5, {name: sign * 0.09}, path=limits) is None
    assert ended(1.5, {name: sign * 0.11}, path=limits) is TrackingCode.PATH_TOLERANCE_VIOLATED
    assert ended(1.5, {}, sign * 0.29, path=limits) is None
    assert ended(1.5, {}, sign * 0.31, path=limits) is TrackingCode.PATH_TOLERANCE_VIOLATED
    assert ended(0.5, {name: sign}, path=limits) is None  # before the start nothing is promised
    assert ended(2.0, {name: sign}, path=limits) is TrackingCode.SUCCESSFUL  # nor after the end
    others = {next(n for n in BOTH if n != name): Tolerance(0.1, 0.0)}
    assert ended(1.5, {name: sign}, path=others) is None


@pytest.mark.parametrize("limit", [0.0, -1.0])
def test_no_tolerance_allows_everything(limit: float) -> None:
    any_error = {"base_yaw": Tolerance(limit, limit)}
    assert ended(1.5, {"base_yaw": 9.0}, path=any_error) is None
    assert ended(2.0, {"base_yaw": 9.0}, goal=any_error) is TrackingCode.SUCCESSFUL


def test_the_goal_may_be_reached_a_little_later() -> None:
    limits = {"base_yaw": Tolerance(0.1, 0.0)}
    assert ended(1.5, {"base_yaw": 0.2}, goal=limits) is None
    assert ended(2.0, {"base_yaw": 0.2}, goal=limits) is None
    assert ended(2.4, {"base_yaw": 0.2}, goal=limits) is None
    assert ended(2.4, {"base_yaw": 0.05}, goal=limits) is TrackingCode.SUCCESSFUL
    assert ended(2.5, {"base_yaw": 0.2}, goal=limits) is TrackingCode.GOAL_TOLERANCE_VIOLATED


@pytest.mark.parametrize("time", [0.5, 1.5])
def test_a_plan_that_another_one_replaces_is_not_successful(time: float) -> None:
    assert ended(time, {}, replaced=True) is TrackingCode.INVALID_GOAL


def test_a_plan_that_another_one_follows_has_reached_its_goal_or_never_will() -> None:
    limits = {"base_yaw": Tolerance(0.1, 0.0)}
    assert ended(2.0, {"base_yaw": 0.05}, goal=limits, replaced=True) is TrackingCode.SUCCESSFUL
    late = ended(2.0, {"base_yaw": 0.2}, goal=limits, replaced=True)
    assert late is TrackingCode.GOAL_TOLERANCE_VIOLATED
