"""A controller that is killed and started again, with other plans and settings than before: the
run from its log builds it anew where the live one began."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.flight.test_random_schedules import TEXT, TUNED, recorded
from tests.wire_bench import WireBench

from flexslew_control.message_fields import plan_fields
from flexslew_control.plan import Plan
from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.messages.cdr import encode
from flexslew_lab.log.recording.bag_writer import BagWriter
from flexslew_lab.replay.check import check
from flexslew_lab.replay.resim import resim
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.arrays import Vector
from flexslew_plant.bench.records import SwitchRequest
from flexslew_plant.bench.wire import stamp_of

HERE = np.array([0.02, -0.01])  # where the bench of TEXT begins
NAMES = "pd_feedforward", "proportional_integral", "lqr"


def plan(start: float, turn: float, begin: Vector = HERE) -> Plan:
    """Return a plan that turns both joints from where it begins in 0.5 s."""
    position = begin + np.outer(np.linspace(0.0, turn, 51), np.ones(2))
    still, none = np.zeros_like(position), np.zeros((51, 0))
    names = "base_yaw", "hub_pitch"
    return Plan("none", names, start, 0.01, position, still, still[1:], none, 0.5)


class Told:
    """What the log of a bench over ROS holds besides: plans, and who says that it follows which."""

    def __init__(self, bench: WireBench, writer: BagWriter) -> None:
        self.bench, self._writer = bench, writer
        self._published: list[tuple[Plan, bool]] = []  # and whether in flight

    def plan(self, published: Plan, *names: str) -> None:
        self._put("/plan", **plan_fields(published, None))
        self._published.append((published, self.bench.bench.time > 0.0))
        for name in names:
            self._follow(name, *self._published[-1])

    def start(self, name: str, heard: str = "each") -> None:
        """Start a controller again: it hears every plan that there was.

        A recorder has heard the status of it with each, with the last, or none before the next.
        """
        self.bench.start(name)
        for published in self._published:
            self._follow(name, *published, told=heard == "each")
        if heard == "last":
            self.status(name)

    def _follow(self, name: str, published: Plan, of_flight: bool, told: bool = True) -> None:
        assert self.bench.hosts[name].adopt(published, of_flight) is None
        if told:
            self.status(name)

    def status(self, name: str) -> None:
        host = self.bench.hosts[name]
        self._put(
            "/controller_status",
            controller=name,
            law=name,
            ready=True,
            reason="",
            last_tick=host.last_tick,
            epoch=host.epoch,
            plan_hash=host.plan_hash,
            settings="{}",
            plan_number=host.plan_count,
            plan_epoch=host.plan_from[0],
            plan_tick=host.plan_from[1],
        )

    def _put(self, topic: str, **message: Any) -> None:
        now = self.bench.bench.time
        kind = TOPICS[topic].type
        message = {"stamp": stamp_of(now), **message}
        self._writer.write(topic, kind, encode(kind, message), round(now * 1e9))


def test_one_that_takes_a_newer_plan_before_its_first_question_follows_it_from_there_on(
    tmp_path: Path,
) -> None:
    bench, writer = recorded(tmp_path / "bag", parse_trial(TEXT, "test"))
    with writer:
        told = Told(bench, writer)
        told.plan(plan(0.1, 0.05), *NAMES)
        bench.session.switch(SwitchRequest("lqr", 20), bench.now)
        bench.session.switch(SwitchRequest("pd_feedforward", 110), bench.now)
        bench.fly(120)
        told.status("lqr")
        newer = plan(1.5, -0.03, HERE + 0.05)
        told.plan(newer, "pd_feedforward", "proportional_integral")
        bench.fly(130)
        told.start("lqr")  # and is killed before it hears a question
        told.start("lqr")
        bench.fly(170)
        bench.session.switch(SwitchRequest("lqr", 180), bench.now)
        bench.fly(250)
    assert [event.data["fresh"] for event in bench.of_kind("began")] == [True]
    assert len(bench.of_kind("switched")) == 3
    assert resim(tmp_path / "bag").identical
    assert check(tmp_path / "bag", "lqr").ok


def test_one_that_starts_again_after_a_reset_has_forgotten_how_it_was_tuned(
    tmp_path: Path,
) -> None:
    bench, writer = recorded(tmp_path / "bag", parse_trial(TEXT, "test"))
    with writer:
        told = Told(bench, writer)
        told.plan(plan(0.1, 0.05), *NAMES)
        bench.fly(10)
        assert bench.hosts["lqr"].tune(TUNED["lqr"]).ok
        bench.session.switch(SwitchRequest("lqr", 20), bench.now)
        bench.fly(60)
        told.status("lqr")
        bench.session.reset()
        bench.fly(1)  # the last question of before is heard
        told.start("lqr")
        assert bench.session.start().ok
        bench.session.switch(SwitchRequest("lqr", 15), bench.now)
        bench.fly(80)
    assert [(e.epoch, e.tick) for e in bench.of_kind("began")] == [(1, 0)]
    assert len(bench.of_kind("switched")) == 2
    assert resim(tmp_path / "bag").identical


@pytest.mark.parametrize("heard", ["each", "last", "later", "none"])
@pytest.mark.parametrize("begun", [False, True])
def test_one_that_is_started_in_flight_follows_all_plans_of_it_and_after_a_reset_the_first(
    tmp_path: Path, begun: bool, heard: str
) -> None:
    """It is in charge before the later plan has begun, or after."""
    bench, writer = recorded(tmp_path / "bag", parse_trial(TEXT, "test"))
    first, later = plan(0.1, 0.05), plan(1.5, -0.03, HERE + 0.05)
    with writer:
        told = Told(bench, writer)
        told.plan(first, *NAMES)
        bench.session.switch(SwitchRequest("pd_feedforward", 20), bench.now)
        bench.fly(30)
        told.plan(later, *NAMES)
        bench.fly(170 if begun else 40)  # the first plan is flown until 0.6 s
        told.start("lqr", heard)
        came = bench.bench.tick
        bench.session.switch(SwitchRequest("lqr", came + 5), bench.now)
        bench.fly(came + 15)
        if heard == "later":
            told.status("lqr")
        lqr = bench.hosts["lqr"].controller
        assert lqr is not None
        for tick in (came + 10, 148, 175):
            followed = (later if tick >= 150 else first).reference(tick).position
            np.testing.assert_array_equal(lqr.reference(tick).position, followed)
        bench.session.reset()
        told.status("lqr")
        assert bench.session.start().ok
        bench.session.switch(SwitchRequest("lqr", 15), bench.now)
        bench.fly(80)
        np.testing.assert_array_equal(lqr.reference(40).position, first.reference(40).position)
        assert lqr.plan == first
    assert resim(tmp_path / "bag").identical


@pytest.mark.parametrize("heard", ["at once", "later"])
def test_one_that_hears_no_plan_since_the_planner_is_gone_flies_none(
    tmp_path: Path, heard: str
) -> None:
    """A recorder hears what it says of itself before its first question, or after."""
    bench, writer = recorded(tmp_path / "bag", parse_trial(TEXT, "test"))
    with writer:
        told = Told(bench, writer)
        told.plan(plan(0.1, 0.05), *NAMES)
        bench.session.switch(SwitchRequest("pd_feedforward", 20), bench.now)
        bench.fly(30)
        bench.start("lqr")
        if heard == "at once":
            told.status("lqr")
        bench.fly(35)
        told.status("lqr")
        bench.session.switch(SwitchRequest("lqr", 40), bench.now)
        bench.fly(80)
    lqr = bench.hosts["lqr"].controller
    assert lqr is not None
    assert lqr.plan is None
    assert resim(tmp_path / "bag").identical
    assert check(tmp_path / "bag", "lqr").ok
