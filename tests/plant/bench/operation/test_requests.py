"""Requests of an operator by the name of their service."""

from inspect import signature
from pathlib import Path
from typing import Any

import pytest
import tests

from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.bench.operation.requests import Requests
from flexslew_plant.bench.operation.session import Session
from flexslew_plant.graph import topics
from flexslew_plant.testbeds.csa import CsaTestbed

SERVICES = Path(tests.__file__).parents[1] / "ros2_ws/src/flexslew_msgs/srv"
KINDS = {
    topics.OPERATE: "Operate",
    topics.STEP: "Step",
    topics.SET_RATE: "SetRate",
    topics.NOTE: "Note",
    topics.INJECT_FAULT: "InjectFault",
    topics.END_FAULT: "EndFault",
    topics.RETARGET: "Retarget",
}


def session() -> Session:
    values: dict[str, Any] = {"active": "a", "testbed": CsaTestbed(modes=1), "duration": 5.0}
    bench = Bench(BenchSettings(**values, allow_faults=True))
    return Session(bench, ("a",), 0.0, 2.0, True, list, list)


def requests() -> Requests:
    return Requests(session(), lambda: ("b", "a"))


@pytest.mark.parametrize("name", KINDS)
def test_a_service_takes_the_fields_of_its_message(name: str) -> None:
    request = (SERVICES / f"{KINDS[name]}.srv").read_text().partition("\n---")[0]
    lines = [line.partition("#")[0].split() for line in request.splitlines()]
    fields = {words[1] for words in lines if words} - {"values"}  # which become the YAML
    assert requests().services.keys() == KINDS.keys()
    assert signature(requests().services[name]).parameters.keys() == fields


def test_an_action_that_there_is_not_is_refused_with_those_that_there_are() -> None:
    reply = requests().services[topics.OPERATE](action="fly", who="me")
    assert not reply.ok
    assert all(action in reply.message for action in requests().actions)


def test_a_time_is_that_of_a_tick_and_only_known_controllers_are_silenced() -> None:
    inject = requests().services[topics.INJECT_FAULT]
    fault = "{kind: controller_silent, controller: %s}"
    assert inject(fault=fault % "b", at=0.5, who="me").tick == 50
    assert "a, b" in inject(fault=fault % "c", at=0.5, who="me").message


def test_a_start_that_waits_for_nodes_names_them() -> None:
    it = session()
    started = it.start("me")
    it.poll(100.0)
    assert "waiting for a" in Requests(it, tuple).with_missing(started).message
