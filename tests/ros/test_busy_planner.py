"""A planner that was busy itself, or that has not heard all that it must know."""

from types import SimpleNamespace
from typing import Any

import pytest

from flexslew_control.plan_service.planning import StartOfPlan
from flexslew_control.plan_service.requests import AnnouncedTestbed, PlanRequests
from flexslew_control.ros import planner_node
from flexslew_control.ros.planner_node import Planner
from flexslew_plant.bench.operation.presence import Heartbeat, Heartbeats
from flexslew_plant.own_code import NO_CODE


@pytest.mark.parametrize("busy", [0.0, 0.5, 1.5, 20.0])
def test_who_beat_before_a_long_plan_was_written_is_there_after_it(
    monkeypatch: pytest.MonkeyPatch, busy: float
) -> None:
    now = 10.0
    monkeypatch.setattr(planner_node, "monotonic", lambda: now)
    planner = object.__new__(Planner)
    planner._next_poll, planner._presence = 0.0, Heartbeats()
    monkeypatch.setattr(planner, "_next", lambda now: 0.02)
    planner._presence.receive(Heartbeat("pd_feedforward", "controller", 1, 1), now)
    planner.poll()
    now += busy
    planner.poll()
    assert not planner._presence.inactive("pd_feedforward", now)
    for _ in range(50):  # it listens, and hears nothing
        now += 0.02
        planner.poll()
    assert planner._presence.inactive("pd_feedforward", now)


@pytest.mark.parametrize("period", [0.0, 0.01])
def test_a_trajectory_may_come_before_the_testbed_of_a_bench_that_flies(period: float) -> None:
    clock: Any = SimpleNamespace(now=lambda: 100.0, later=lambda wait: wait)
    requests = PlanRequests(clock, NO_CODE, lambda start: StartOfPlan())
    requests.testbed = AnnouncedTestbed(period=period)
    assert requests.next_start() == pytest.approx(101.0 if period else 0.0)
