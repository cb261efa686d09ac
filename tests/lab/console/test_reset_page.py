"""A page over a bench that was reset, alive or as a log."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexslew_lab.console.page import Page
from flexslew_lab.console.replay import Replay
from flexslew_lab.console.view import BenchView
from flexslew_lab.log.messages.cdr import encode
from flexslew_lab.log.recording.bag_observer import BagObserver
from flexslew_lab.log.recording.bag_writer import BagWriter
from flexslew_lab.run.in_process import run_bench
from flexslew_lab.trial.trial import bench_settings, build_controllers, parse_trial, trial_text
from flexslew_plant.bench.bench import Bench
from flexslew_plant.graph import topics
from flexslew_plant.graph.topics import TOPICS

RESET = 150  # tick at which the bench goes back to 0 [-]
TRIAL = "{name: twice, duration: 3.0, testbed: {initial: {hub_pitch: 0.1}}, display_rate: 0.0}"


class Twice(Bench):
    """A bench that somebody resets once."""

    observer: Any
    controllers: Any

    def advance(self) -> None:
        super().advance()
        if self.tick == RESET and self.epoch == 0:
            self.observer.question(self.question)  # the tick had begun
            self.observer.truth(self.truth())
            for controller in self.controllers.values():
                controller.observe(self.question)
            self.reset()
            self.observer._writer.before = RESET * 10_000_000


class GoesOn(BagWriter):
    """A bag whose times go on after a reset, as a recorder has them."""

    before = 0  # of the epochs that are over [ns]

    def write(self, topic: str, type_name: str, data: bytes, stamp: int) -> None:
        super().write(topic, type_name, data, stamp + self.before)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the log of 1.5 s, a reset, and 3 s."""
    folder, trial = tmp_path_factory.mktemp("twice") / "bag", parse_trial(TRIAL, "test")
    bench = Twice(bench_settings(trial))
    bench.controllers = controllers = build_controllers(trial, "test")
    with GoesOn(folder, {"trial": trial_text(trial)}) as writer:
        bench.observer = observer = BagObserver(writer)
        observer.notify(trial, bench, None, controllers)
        run_bench(bench, controllers, observer)
    return folder


def test_the_slider_stands_where_the_log_is_and_leads_there_again(
    bag: Path, tmp_path: Path
) -> None:
    log = Replay(bag)
    page = Page(log, "127.0.0.1", 0, lambda words: None, log, tmp_path / "layouts.json")
    try:
        gui = page.server.gui
        slider = next(e for e in gui.all() if e.label == "Time [s]")
        for asked, simulated in ((1.0, 1.0), (2.5, 1.0), (4.5, 3.0)):
            slider.value = asked
            for changed in slider.changed:
                changed(1)
            page._context.work()
            assert log.view.time == pytest.approx(simulated, abs=0.011)
            assert slider.value == pytest.approx(asked, abs=0.011)
        log.poll(0.0)
        assert (log.view.now.tick, log.view.now.last_tick) == (300, 0)  # of two epochs, none
    finally:
        page.close()


def test_a_log_without_a_reset_tells_the_last_tick(bag: Path, tmp_path: Path) -> None:
    trial = parse_trial(TRIAL, "test")
    bench, controllers = Bench(bench_settings(trial)), build_controllers(trial, "test")
    with BagWriter(tmp_path / "bag", {"trial": trial_text(trial)}) as writer:
        (observer := BagObserver(writer)).notify(trial, bench, None, controllers)
        run_bench(bench, controllers, observer)
    log = Replay(tmp_path / "bag")
    log.poll(0.0)
    assert (log.view.time, log.view.now.last_tick) == (0.0, 300)


def test_after_a_reset_the_testbed_stands_where_it_began() -> None:
    view = BenchView()

    def take(topic: str, **fields: Any) -> None:
        view.take(topic, TOPICS[topic].type, [encode(TOPICS[topic].type, fields)])

    def truth(epoch: int, tick: int, place: float) -> None:
        stamp = {"sec": 0, "nanosec": tick * 10_000_000}
        take(topics.TRUTH, header={"stamp": stamp}, tick=tick, epoch=epoch,
             position=[place], velocity=[0.0])  # fmt: skip

    truth(0, 70, 0.7)
    np.testing.assert_array_equal(view.position, [0.7])
    take(topics.BENCH_STATE, state="paused", tick=0, epoch=1)
    assert view.position.size == 0
    truth(0, 71, 0.8)  # was under way
    assert (view.position.size, view.time) == (0, 0.0)
    truth(1, 0, 0.1)
    np.testing.assert_array_equal(view.position, [0.1])
