"""Two programs of others answer under one name: the older one flies the bench."""

import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from flexslew_msgs.msg import Alive, Event, PlantState
from std_srvs.srv import Trigger

from flexslew_plant.graph.topics import ALIVE, EVENTS, TOPICS, TRUTH
from flexslew_plant.ros.offers import qos

from .one_by_one import PLANT, Bench, standing

NAME, PROGRAM = "any_language", "tests.ros.namesake_node"


class Watched(Bench):
    """A bench that one of two namesakes flies."""

    def __init__(self, folder: Path, domain: int) -> None:
        super().__init__(folder, domain)
        self.truth = PlantState()
        self.events: list[Any] = []
        self.beats: list[Any] = []
        self.node.create_subscription(PlantState, TRUTH, self._see, qos(TOPICS[TRUTH]))
        self.node.create_subscription(Event, EVENTS, self.events.append, qos(TOPICS[EVENTS]))
        self.node.create_subscription(Alive, ALIVE, self.beats.append, qos(TOPICS[ALIVE]))
        self.start(NAME, PROGRAM)
        self.until(lambda: NAME in self.statuses)
        self.pids["older"] = self.pids[NAME]  # which is ended, too, whatever happens
        self.start(NAME, PROGRAM, pushes="true")
        given = {"bench.active": NAME, "bench.max_missed": "1000", "rate_factor": "1.0"}
        self.start("plant", PLANT, autostart="false", **given)
        self.until(lambda: len(self.said("controller")) == 2 and self.statuses[NAME].ready)

    def said(self, role: str) -> set[int]:
        """Return the instances of a role that gave a sign of life."""
        return {b.instance for b in self.beats if b.role == role}

    def _see(self, truth: PlantState) -> None:
        self.truth = truth

    def fly(self) -> None:
        client = self.node.create_client(Trigger, "start")
        self.until(client.service_is_ready)
        done = client.call_async(Trigger.Request())
        self.until(done.done)


@pytest.fixture
def watched(tmp_path: Path) -> Iterator[Watched]:
    with standing(Watched, tmp_path) as one:
        yield one


@pytest.mark.slow
def test_the_older_one_flies_until_it_is_gone(watched: Watched) -> None:
    watched.fly()
    watched.until(lambda: watched.truth.tick > 300)
    assert not any(watched.truth.applied_effort)
    rejected = [event for event in watched.events if event.kind == "rejected"]
    assert "another process called any_language" in rejected[0].message
    watched.end("older", signal.SIGKILL)
    watched.until(lambda: any(watched.truth.applied_effort))
    watched.end("plant")
