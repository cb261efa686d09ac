"""How long a node stays for those who have not acknowledged what it has said."""

from itertools import count
from types import SimpleNamespace
from typing import Any

import pytest

from flexslew_plant.bench.operation.presence import Heartbeat, Heartbeats
from flexslew_plant.ros import departure
from flexslew_plant.ros.graph import UNKNOWN_NODE

TOPIC = "/truth"


@pytest.mark.parametrize(
    ("listeners", "beating", "longest"),
    [
        (["echo"], [], departure.ABORT_TIMEOUT),  # somebody's tool, that was stopped
        (["echo", "recorder"], ["recorder"], departure.CLOSE_TIMEOUT),  # who may be behind
        ([UNKNOWN_NODE, "recorder"], ["recorder"], departure.ABORT_TIMEOUT),  # that has left
        (["recorder"], ["recorder"], departure.CLOSE_TIMEOUT),
    ],
)
def test_a_listener_without_a_heartbeat_is_waited_for_a_few_seconds(
    listeners: list[str], beating: list[str], longest: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    times = count(step=0.1)
    monkeypatch.setattr(departure, "monotonic", lambda: next(times))
    monkeypatch.setattr(departure, "listeners_of", lambda node, publisher: {*listeners})
    monkeypatch.setattr(departure, "missing_listeners", lambda node, publishers, names: [])
    presence, told = Heartbeats(), list[str]()
    publisher = SimpleNamespace(topic_name=TOPIC, wait_for_all_acked=lambda patience: False)
    logger = SimpleNamespace(warning=told.append)
    node: Any = SimpleNamespace(
        publishers=[publisher], services=[], get_logger=lambda: logger, count_clients=len
    )

    def serve() -> None:
        for number, name in enumerate(beating):
            presence.receive(Heartbeat(name, "recorder", number, 0), next(times))

    alive: Any = SimpleNamespace(heartbeats=presence)
    departure.wait_for_listeners(node, alive, serve, departure.CLOSE_TIMEOUT)
    who = ", ".join(listeners)
    assert told == [
        f"awaiting acknowledgement: {TOPIC}; received by {who}",
        f"exiting, unacknowledged: {TOPIC}",
    ]
    assert longest < next(times) < longest + 10.0
