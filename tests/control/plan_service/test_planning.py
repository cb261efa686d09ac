"""Requests for plans, before any planning begins."""

import math
from collections.abc import Iterator

import pytest

from flexslew_control.law import ActiveLaw
from flexslew_control.plan import Plan
from flexslew_control.plan_service.planning import (
    PlanProcess,
    PlanRequest,
    StartOfPlan,
    plan_request,
)
from flexslew_plant.own_code import Trust
from flexslew_plant.refusal import Cause, Refusal

GOAL = "{method: none}"
OWN = "docs/examples/my_shaper.py:Shaper"


def test_a_request_that_can_be_used_is_completed_by_what_is_known_of_its_start() -> None:
    there = StartOfPlan({"base_yaw": 0.1}, ActiveLaw("lqr", {}))
    made = plan_request(GOAL, "", 0.01, [150.0], lambda start: there)
    assert made == PlanRequest({"method": "none"}, "", 0.01, (150.0,), 0.0, there)


@pytest.mark.parametrize("period", [0.0, -1.0, math.nan, math.inf])
def test_a_period_is_a_positive_number(period: float) -> None:
    made = plan_request(GOAL, "", period, [150.0])
    assert isinstance(made, Refusal)
    assert made.cause is Cause.NOT_ALLOWED
    assert "period" in str(made)


@pytest.mark.parametrize("limit", [[], [0.0], [150.0, math.nan], [math.inf]])
def test_each_effort_limit_is_a_positive_number(limit: list[float]) -> None:
    made = plan_request(GOAL, "", 0.01, limit)
    assert isinstance(made, Refusal)
    assert made.cause is Cause.NOT_ALLOWED
    assert "effort_limit" in str(made)
    assert "\n" not in str(made)


def test_what_is_no_yaml_is_refused_in_one_line() -> None:
    made = plan_request("{", "", 0.01, [150.0])
    assert isinstance(made, Refusal)
    assert made.cause is Cause.NOT_ALLOWED
    assert "request" in str(made)


def test_planning_that_nobody_has_asked_for_needs_no_process() -> None:
    planning = PlanProcess(soon=False)
    assert planning.updates() == []
    planning.close()
    planning.close()  # twice is not once too often


@pytest.fixture(scope="module")
def planning() -> Iterator[PlanProcess]:
    """The process that plans."""
    process = PlanProcess()
    yield process
    process.close()


def outcome(planning: PlanProcess, section: str, **begins: float) -> Plan | Refusal:
    """Return what comes of a request, with the reference at these positions."""
    trust = Trust(frozenset({OWN}))
    request = plan_request(
        section, "", 0.01, [150.0, 150.0], lambda start: StartOfPlan(begins), trust
    )
    assert isinstance(request, PlanRequest)
    planning.ask(request)
    while True:
        for news in planning.updates(wait=60.0):
            if isinstance(news, Plan | Refusal):
                return news


@pytest.mark.slow
def test_a_joint_that_turns_is_asked_for_in_no_unit_of_one_that_slides(
    planning: PlanProcess,
) -> None:
    refused = outcome(planning, "{method: none, goal: {hub_pitch: 30 cm}}")
    assert isinstance(refused, Refusal)
    assert str(refused).startswith("plan: goal.hub_pitch: '30 cm' is not allowed")
    plan = outcome(planning, "{method: none, goal: {hub_pitch: 30 deg}}")
    assert isinstance(plan, Plan)
    assert plan.position[-1, 1] == pytest.approx(math.pi / 6.0)


@pytest.mark.parametrize("method", ["none", OWN, "reference_only"])
def test_a_plan_in_flight_begins_where_the_reference_is(planning: PlanProcess, method: str) -> None:
    """Sections of the first two have no `initial`; a joint that the goal leaves out stays."""
    section = f"{{method: '{method}', goal: {{base_yaw: 0.8}}, start: 30.0, duration: 20.0}}"
    plan = outcome(planning, section, base_yaw=0.7, hub_pitch=-0.2)
    assert isinstance(plan, Plan), plan
    assert plan.position[-1] == pytest.approx([0.8, -0.2])
    if method != "none":
        assert plan.position[0] == pytest.approx([0.7, -0.2])


def test_a_start_with_a_unit_begins_where_the_reference_is_then() -> None:
    def beginning(start: float) -> StartOfPlan:
        return StartOfPlan({"base_yaw": start})

    for start in ("6 s", "0.1 min", 6):
        made = plan_request({"method": "none", "start": start}, "", 0.01, [150.0], beginning)
        assert isinstance(made, PlanRequest)
        assert made.beginning.rest is not None
        assert made.beginning.rest["base_yaw"] == made.start == pytest.approx(6.0)
    for wrong in ("6 m", "soon", None, math.nan):
        made = plan_request({"method": "none", "start": wrong}, "", 0.01, [150.0])
        assert isinstance(made, Refusal)
        assert str(made).startswith("start: ")
