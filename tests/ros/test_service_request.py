"""Plain values as requests: rclpy would pass on what has another type."""

from math import inf, nan
from typing import Any

import pytest
from flexslew_msgs import action, srv

from flexslew_lab.ros.service_request import request_of
from flexslew_plant.errors import BadInput


def test_values_of_their_types_become_a_request() -> None:
    values = {"controller": "lqr", "at": 12.5, "strict": True, "max_effort_step": 1, "who": "ann"}
    request = request_of(srv.SwitchController.Request, values)
    assert (request.controller, request.strict, request.max_effort_step) == ("lqr", True, 1.0)
    assert (request.at.sec, request.at.nanosec) == (12, 500_000_000)
    assert request.timeout == 0.0
    assert request_of(srv.Step.Request, {"ticks": 7.0}).ticks == 7
    goal = request_of(action.PlanSlew.Goal, {"effort_limit": [150, 20.0], "request": "{}"})
    assert list(goal.effort_limit) == [150.0, 20.0]
    for limit, words in (([1.0, "x"], "effort_limit.1: 'x' is not"), (5.0, "effort_limit: 5.0")):
        with pytest.raises(BadInput, match=words):
            request_of(action.PlanSlew.Goal, {"effort_limit": limit})


@pytest.mark.parametrize(
    ("kind", "values"),
    [(srv.Step, {"ticks": value}) for value in (-1, 1.5, 2**32, True, "7", None, nan, inf, [1])]
    + [(srv.Note, {"text": value}) for value in (1, None, b"x", "a\0b", ["a"])]
    + [(srv.SwitchController, {"at": value}) for value in (-1.0, nan, inf, 1e9, "now", False)]
    + [(srv.SwitchController, {"strict": value}) for value in (1, "yes", None)]
    + [(srv.SetRate, {"rate_factor": value}) for value in ("1", None, True)]
    + [(srv.Note, {"texts": "x"}), (srv.EndFault, {"number": -1})],
)
def test_anything_else_is_refused_with_its_field(kind: Any, values: dict[str, Any]) -> None:
    with pytest.raises(BadInput, match=next(iter(values))):
        request_of(kind.Request, values)
