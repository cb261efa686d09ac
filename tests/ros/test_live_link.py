"""What a console knows of the ticks: through the recorder, and without it."""

import os
import signal
from collections.abc import Callable
from pathlib import Path
from threading import Event, Thread
from time import monotonic, sleep
from typing import Any

import numpy as np
import pytest
import rclpy
from flexslew_msgs import msg
from flexslew_msgs.srv import SetRate
from rclpy.node import Node

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.ros import live_link
from flexslew_lab.ros.live_link import LiveLink
from flexslew_lab.run.domain import locked_domain
from flexslew_lab.run.processes import NodeProcess, parameter_file
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.run.supervisor import Supervisor
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.events import OperatorNote
from flexslew_plant.events.event import event_of
from flexslew_plant.graph.topics import (
    CONTROLLER_STATUS,
    EVENTS,
    RECORDED,
    TESTBED,
    TOPICS,
    TRUTH,
)
from flexslew_plant.ros.messages import event_message
from flexslew_plant.ros.offers import publisher, qos

from .bystander import beside
from .flight import LONG, Flight, fork_server, slew

PATIENCE = 60.0  # with a bench on a busy machine [wall s]


class Watcher:
    """Watches a bench until it ends, as a console does.

    Args:
        domain: of the bench.
        meet: called once, as soon as ticks were heard.
    """

    def __init__(self, domain: int, meet: Callable[[], None] = lambda: None) -> None:
        self.time, self.position = np.zeros(0), np.zeros((0, 0))
        self.listened: list[str] = []  # in turn
        self._thread = Thread(target=self._watch, args=(domain, meet))
        self._thread.start()

    def _watch(self, domain: int, meet: Callable[[], None]) -> None:
        rclpy.init(domain_id=domain)
        node = Node("console")
        link, met, there = LiveLink(node, "", ""), False, False
        end = monotonic() + PATIENCE
        while monotonic() < end:
            link.poll(monotonic())
            track = link.view.truth
            if len(track.time) > len(self.time):
                self.time, self.position = track.time.copy(), track.column("position").copy()
                to = RECORDED if RECORDED in link._listener.subscriptions else TRUTH
                self.listened += [to] if to not in self.listened else []
                if not met:
                    meet()
                    met = True
            there, before = node.count_publishers(f"/{TRUTH}") > 0, there
            if before and not there:
                end = min(end, monotonic() + 1.0)  # for the recorder's last words
            sleep(0.02)
        link.close()
        node.destroy_node()
        rclpy.shutdown()

    def seen(self) -> tuple[Vector, Matrix]:
        """Return times and positions, once all is over."""
        self._thread.join()
        return self.time, self.position


def flown(bag: Path) -> tuple[Vector, Matrix]:
    columns = BagReader(bag).columns("/truth", {"tick", "position"})
    return columns["tick"] * 0.01, columns["position"]


def assert_flown(seen: tuple[Vector, Matrix], truth: tuple[Vector, Matrix]) -> None:
    """Check that all that was seen was flown, to the bit."""
    at = np.searchsorted(truth[0], seen[0] - 0.005)
    assert np.allclose(seen[0], truth[0][at])
    assert np.array_equal(seen[1], truth[1][at])


@pytest.mark.slow
@pytest.mark.parametrize("rate", [0.0, pytest.param(8.0, marks=pytest.mark.ros)])
def test_through_the_recorder_no_tick_is_missing(
    tmp_path: Path, rate: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        live_link, "_RECORDER_TIMEOUT", PATIENCE
    )  # until they have met, busy as they are
    watchers: list[Watcher] = []
    met = Event()

    def watch(pids: dict[str, int], domain: int) -> None:
        watchers.append(Watcher(domain, met.set))
        assert met.wait(PATIENCE)
        with beside(domain) as bench:
            assert bench.ask(SetRate, "set_rate", rate_factor=rate).ok

    trial = slew(30.0, 1.0, extra="max_missed: 100000")
    flight = Flight(trial, tmp_path / "run", 0, watch)
    seen = watchers[0].seen()
    assert watchers[0].listened == [RECORDED]
    assert len(flown(flight.bag)[0]) == 3001
    assert np.allclose(np.diff(seen[0]), 0.01)
    assert seen[0][-1] == pytest.approx(30.0)
    assert_flown(seen, flown(flight.bag))


@pytest.mark.ros
def test_without_the_recorder_the_ticks_themselves_are_heard(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    watchers: list[Watcher] = []
    met, positions = Event(), dict[int, Vector]()  # by tick

    def note(truth: msg.PlantState) -> None:
        positions[truth.tick] = np.array(truth.position)

    def act(pids: dict[str, int], domain: int) -> None:
        watchers.append(Watcher(domain, met.set))
        assert met.wait(PATIENCE)
        monkeypatch.setattr(live_link, "_RECORDER_TIMEOUT", 1.0)
        os.kill(pids["recorder"], signal.SIGKILL)
        with beside(domain) as bench:
            bench.node.create_subscription(msg.PlantState, TRUTH, note, qos(TOPICS[TRUTH]))
            bench.until(lambda: bool(positions) and watchers[0].listened == [RECORDED, TRUTH])
            bench.pass_by(200)
        raise KeyboardInterrupt

    monkeypatch.setattr(live_link, "_RECORDER_TIMEOUT", PATIENCE)
    trial = slew(LONG, 1.0, extra="max_missed: 100000")
    flight = Flight(trial, tmp_path / "run", 0, act)
    assert flight.outcome.exit_code == 130
    time, place = watchers[0].seen()
    both = [(k, tick) for k, tick in enumerate(np.rint(time / 0.01).tolist()) if tick in positions]
    assert len(both) > 100
    for k, tick in both:
        np.testing.assert_array_equal(place[k], positions[tick])


@pytest.mark.ros
def test_a_bag_that_is_played_is_watched_without_a_recorder(tmp_path: Path) -> None:
    run_trial(slew(duration=60.0), "test", tmp_path / "run", in_process=True, report=False)
    play: dict[str, Any] = {"bag": str(tmp_path / "run" / "bag"), "rate": 6.0}
    processes = [NodeProcess("plant", "flexslew_lab", "play", play)]
    parameters = tmp_path / "parameters.yaml"
    parameters.write_text(parameter_file(processes))
    with locked_domain() as domain:
        player = Supervisor(
            processes, parameters, tmp_path / "nodes.log", domain, lambda tick, last: None,
            fork_server(),
        )  # fmt: skip
        watcher = Watcher(domain)
        assert player.run().exit_code == 0
        seen = watcher.seen()
    assert watcher.listened == [TRUTH]
    assert len(seen[0]) > 1000
    assert_flown(seen, flown(tmp_path / "run" / "bag"))


def test_controllers_and_events_of_a_bench_that_is_gone_are_not_those_of_the_next() -> None:
    with locked_domain() as domain:
        rclpy.init(domain_id=domain)
        watcher = Node("console")
        link = LiveLink(watcher, "", "")

        def until(done: Callable[[], bool], later: float = 0.0) -> None:
            end = monotonic() + PATIENCE
            while not done():
                assert monotonic() < end
                link.poll(monotonic() + later)
                sleep(0.01)

        def events() -> list[str]:
            return [event.message for event in link.view.events]

        def bench(*controllers: str) -> list[Node]:
            nodes = [Node("plant"), *map(Node, controllers)]
            fields = {"kind": "csa", "joint_names": ["a"], "joint_units": ["rad"], "period": 0.01}
            publisher(nodes[0], TESTBED).publish(msg.Testbed(effort_limit=[1.0], **fields))
            said = event_of(
                OperatorNote(f"here is {controllers[-1]}", "somebody"), 0, 0.0, 0, "plant"
            )
            publisher(nodes[0], EVENTS).publish(event_message(said))
            for node in nodes[1:]:
                status = msg.ControllerStatus(controller=node.get_name(), law="lqr", ready=True)
                publisher(node, CONTROLLER_STATUS).publish(status)
            return nodes

        try:
            first = bench("early", "both")
            until(lambda: {*link.view.controllers} == {"early", "both"} and len(events()) == 1)
            heard, early = link.view.received, events()
            for node in first:
                node.destroy_node()
            second = bench("both", "late")
            until(lambda: "late" in link.view.controllers)
            until(lambda: {*link.view.controllers} == {"both", "late"}, later=30.0)
            until(lambda: link.view.received > heard + 1)  # forgotten, and another one heard
            assert len(events()) == 1
            assert events() != early
            for node in second:
                node.destroy_node()
        finally:
            link.close()
            watcher.destroy_node()
            rclpy.shutdown()
