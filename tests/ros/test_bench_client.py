"""Whoever asks for a plan hears what comes of it, once, whatever becomes of the planner."""

from types import SimpleNamespace
from typing import Any

from flexslew_lab.ros.bench_client import BenchClient
from flexslew_plant.graph import topics


class Planner:
    """A planner that takes a goal, and answers it when it is told to."""

    def __init__(self) -> None:
        self.there = self.accepted = True
        self._told: list[Any] = []

    def server_is_ready(self) -> bool:
        return self.there

    def send_goal_async(self, goal: Any, feedback_callback: Any) -> Any:
        return SimpleNamespace(add_done_callback=self._told.append)

    def get_result_async(self) -> Any:
        return SimpleNamespace(add_done_callback=self._told.append)

    def goes_on(self, result: Any) -> None:
        self._told.pop()(SimpleNamespace(result=lambda: result))


def asked(planner: Planner) -> tuple[BenchClient, list[Any]]:
    client, told = object.__new__(BenchClient), list[Any]()
    client._pending, client._plan_requests, client._goal = [], [], None
    client._plan_clients = {topics.PLAN_SLEW: planner}
    client.plan(topics.PLAN_SLEW, Any, told.append, lambda result, plan: told.append(result))
    client.poll(0.0)
    assert not told
    return client, told


def test_a_planner_that_dies_while_it_plans_is_told_once() -> None:
    for accepted in (False, True):
        planner = Planner()
        client, told = asked(planner)
        if accepted:
            planner.goes_on(planner)
        planner.there = False
        for now in (1.0, 2.0):
            client.poll(now)
        (result,) = told
        assert not result.ok
        assert result.message == "the planner has left the graph; ask again"


def test_a_planner_that_answers_is_told_once_even_if_it_leaves_then() -> None:
    planner = Planner()
    client, told = asked(planner)
    planner.goes_on(SimpleNamespace(accepted=False))
    planner.there = False
    client.poll(1.0)
    assert [result.message for result in told] == ["the planner does not take the request"]
