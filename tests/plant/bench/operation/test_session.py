"""A run against a wall clock that the test moves."""

from math import inf
from typing import Any

import numpy as np
import pytest

from flexslew_plant.bench.bench import Bench, BenchSettings, SwitchRequest, Truth
from flexslew_plant.bench.operation.presence import HEARTBEAT_PERIOD, Heartbeat
from flexslew_plant.bench.operation.run_state import PAUSED
from flexslew_plant.bench.operation.session import Session
from flexslew_plant.events import Event
from flexslew_plant.measurement import EffortCommand, Measurement
from flexslew_plant.refusal import Cause
from flexslew_plant.testbeds.csa import CsaTestbed

ZERO = np.zeros(2)


class Lab:
    """A session, controllers that answer at once or not at all, and the time."""

    def __init__(self, rate: float = 0.0, controllers: Any = ("a", "b"), **settings: Any) -> None:
        values: dict[str, Any] = {"active": "a", "testbed": CsaTestbed(modes=1)} | settings
        self.now = 100.0
        self.dead: set[Any] = set()
        self.stopped: set[Any] = set()
        self.waiting: list[EffortCommand] = []
        self.measurements: list[Any] = []
        self.truth_log: list[Any] = []
        self.events: list[Any] = []
        bench = Bench(BenchSettings(**values))
        self.it = Session(bench, (), rate, 2.0, True, lambda: [], self.received)
        self.names, self.next_beat = controllers, 0.0
        for name in controllers:
            self.it.reasons[name] = None

    def received(self) -> Any:
        waiting, self.waiting = self.waiting, []
        return waiting

    def heartbeat(self) -> None:
        if self.now >= self.next_beat:
            self.next_beat = self.now + HEARTBEAT_PERIOD
            for number, name in enumerate(self.names):
                if name not in self.dead:
                    role = "recorder" if name == "recorder" else "controller"
                    self.it.heartbeats.receive(Heartbeat(name, role, number, number), self.now)

    def poll(self) -> None:
        """Let the session work once and the time pass until it wants to work again."""
        self.heartbeat()
        for command in self.received():
            self.it.take(command, self.now)
        wait = self.it.poll(self.now)
        self.send()
        self.now += max(min(wait, 0.05, 1e-3 if self.waiting else 1.0), 1e-4)

    def send(self) -> None:
        """Take what the session says; questions are answered by those who live."""
        while self.it.outgoing:
            record = self.it.outgoing.popleft()
            if isinstance(record, Measurement):
                self.measurements.append(record)
                if record.controller and record.controller not in self.dead | self.stopped:
                    self.waiting.append(
                        EffortCommand(record.tick, record.epoch, record.controller, ZERO)
                    )
            else:
                (self.truth_log if isinstance(record, Truth) else self.events).append(record)

    def die(self, name: Any) -> None:
        """Let a second pass in which it is not heard; the bench waits for an answer meanwhile."""
        self.dead.add(name)
        self.stopped |= {*self.names}
        end = self.now + 1.0
        while self.now < end:
            self.poll()
        self.stopped.clear()

    def until(self, tick: Any) -> Any:
        for _ in range(100_000):
            if self.it.bench.tick >= tick:
                return self
            self.poll()
        raise AssertionError(f"stuck at tick {self.it.bench.tick}")

    def kinds(self, *requested: Any) -> list[Any]:
        return [e.kind for e in self.events if isinstance(e, Event) and e.kind in requested]


def test_it_runs_to_the_end_asks_every_tick_and_says_how_long_it_took() -> None:
    lab = Lab(rate=1.0, duration=0.5).until(50)
    assert [q.tick for q in lab.measurements] == list(range(50))
    assert [t.tick for t in lab.truth_log] == list(range(51))
    assert lab.kinds("missed", "late") == []
    (done,) = [e for e in lab.events if e.kind == "finished"]
    assert done.data["wall_time"] == pytest.approx(0.5, abs=0.01)


def test_a_dead_controller_is_not_ready_within_a_second_and_a_switch_to_it_is_refused() -> None:
    lab = Lab(rate=1.0).until(10)
    lab.dead.add("b")
    died = lab.now
    lab.until(110)
    (event,) = [e for e in lab.events if e.kind == "not_ready"]
    assert event.tick <= 110
    assert event.data["controller"] == "b"
    assert lab.now - died < 1.1
    refused = lab.it.switch(SwitchRequest("b", lab.it.bench.tick + 5), lab.now)
    assert refused.cause is Cause.NO_HEARTBEAT
    assert str(refused) == "b is not ready: its heartbeat is lost"
    lab.dead.clear()
    lab.until(170)
    assert lab.it.switch(SwitchRequest("b", lab.it.bench.tick + 5), lab.now) is None
    assert lab.kinds("not_ready", "ready") == ["not_ready", "ready"]


def test_one_that_is_started_again_is_ready_when_it_says_so_itself() -> None:
    lab = Lab(rate=1.0).until(10)
    it, (first, second) = lab.it, (1, 7)
    it.receive("b", True, "", first)
    assert it.reason("b", lab.now) is None
    lab.dead.add("b")
    lab.until(110)
    it.heartbeats.receive(Heartbeat("b", "controller", second, second), lab.now)
    assert str(it.reason("b", lab.now)) == "it has just come"
    it.receive("b", True, "", second)
    assert it.reason("b", lab.now) is None


@pytest.mark.parametrize("rate", [0.0, 1.0])
def test_who_has_just_become_ready_takes_over(rate: float) -> None:
    lab = Lab(rate).until(10)
    it = lab.it
    it.receive("b", False, "no testbed announced yet", 1)
    while not lab.kinds("not_ready"):
        lab.poll()
    it.receive("b", True, "", 1)
    assert it.switch(SwitchRequest("b", it.bench.tick + 1), lab.now) is None
    lab.until(it.bench.tick + 3)
    assert lab.kinds("switched", "switch_dropped") == ["switched"]
    assert it.bench.drive.active == "b"


@pytest.mark.parametrize("rate", [0.0, 1.0])
@pytest.mark.parametrize("older", [True, False])
@pytest.mark.parametrize("told", [True, False])
def test_of_two_with_one_name_the_answers_of_the_older_count(
    rate: float, older: bool, told: bool
) -> None:
    lab = Lab(rate, controllers=("b", "a")).until(3)
    mine = lab.it.heartbeats.alive(lab.now)["a"].instance
    lab.it.heartbeats.receive(Heartbeat("a", "controller", 77, -1 if older else 99), lab.now)
    for _ in range(5):
        lab.poll()
    lab.stopped.add("a")
    while lab.it.bench.answered or lab.waiting:
        lab.poll()
    asked, bench = lab.it.bench.question, lab.it.bench
    before = sum(bench.drive.rejected.values())
    answer = EffortCommand(asked.tick, asked.epoch, "a", ZERO + 1.0)
    lab.it.take(answer._replace(instance=77 if told else 0), lab.now)
    taken = bench.answered or bench.tick > asked.tick
    rejected = sum(bench.drive.rejected.values()) - before
    assert (taken, rejected) == ((True, 0) if older or not told else (False, 1))
    if not taken:
        lab.it.take(answer._replace(instance=mine), lab.now)
        assert bench.answered or bench.tick > asked.tick
        lab.send()
        assert [e.what.reason for e in lab.events if e.kind == "rejected"] == ["sender"]


def test_a_switch_to_one_that_died_in_between_is_dropped_and_nothing_is_missed() -> None:
    lab = Lab(rate=1.0).until(10)
    assert lab.it.switch(SwitchRequest("b", 200), lab.now) is None
    lab.dead.add("b")
    lab.until(220)
    assert lab.kinds("switch_dropped", "missed", "fallback") == ["switch_dropped"]
    (result,) = lab.it.bench.switch_results
    assert not result.ok


def test_as_fast_as_it_goes_one_that_is_due_and_held_up_is_waited_for() -> None:
    lab = Lab().until(10)
    assert lab.it.switch(SwitchRequest("b", 200), lab.now) is None
    lab.die("b")
    lab.until(199)
    for _ in range(20):
        lab.poll()
    assert lab.it.bench.tick == 199
    lab.dead.clear()
    lab.until(220)
    assert lab.kinds("switched", "switch_dropped") == ["switched"]
    lab.it.switch(SwitchRequest("a", 300), lab.now)
    lab.die("a")
    lab.until(320)  # but not for ever
    assert lab.kinds("switched", "switch_dropped") == ["switched", "switch_dropped"]


@pytest.mark.parametrize(
    ("long_before", "back_after", "taken_over"),
    [(0.0, 1.5, ["fallback"]), (0.0, inf, ["brake"]), (3.0, inf, ["brake"])],
)
def test_as_fast_as_it_goes_a_fallback_that_was_held_up_with_the_one_in_charge_is_waited_for(
    long_before: float, back_after: float, taken_over: list[str]
) -> None:
    lab = Lab(fallback=("b",), max_missed=3).until(10)
    lab.dead.add("b")
    died = lab.now
    while lab.now < died + long_before:
        lab.poll()
    lab.dead.add("a")
    while not lab.it.bench.drive.one_miss_left:  # nobody answers within 2 s
        lab.poll()
    due = lab.now
    while lab.it.bench.drive.active == "a":
        if lab.now - due > back_after:
            lab.dead.discard("b")
            lab.stopped.discard("b")
        lab.poll()
    assert lab.kinds("fallback", "brake") == taken_over
    waited = lab.now - due
    assert waited < back_after + 0.5
    assert waited < 0.5 if long_before else waited > min(back_after, 2.0)  # the answer's timeout


@pytest.mark.parametrize("rate", [1.0, 10.0])
def test_paced_no_fallback_is_waited_for(rate: float) -> None:
    lab = Lab(rate=rate, fallback=("b",), max_missed=round(200 * rate)).until(10)
    lab.dead |= {"a", "b"}
    died = lab.now
    while lab.it.bench.drive.active == "a":
        lab.poll()
    assert lab.kinds("fallback", "brake") == ["brake"]
    assert lab.now - died < 2.0 + 1.0


@pytest.mark.parametrize("stall", [0.1, 1.0, 30.0])
@pytest.mark.parametrize("rate", [0.0, 1.0, 10.0])
def test_a_stall_of_the_plant_misses_nothing(stall: float, rate: float) -> None:
    lab = Lab(rate=rate, max_missed=3).until(20)
    lab.stopped.add("a")
    lab.poll()
    question = lab.it.bench.question
    lab.waiting = [EffortCommand(question.tick, question.epoch, "a", ZERO)]  # came meanwhile
    lab.now += stall
    lab.stopped.clear()
    lab.until(100)
    assert lab.kinds("missed", "brake", "not_ready") == []
    late = [e for e in lab.events if e.kind == "late"]
    assert bool(late) == (rate > 0.0)
    if late:
        assert late[0].data["late"] == pytest.approx(stall, rel=0.1)


def test_after_a_stall_the_controller_has_a_full_period_even_if_it_was_held_up_too() -> None:
    lab = Lab(rate=1.0).until(20)
    lab.stopped.add("a")
    lab.poll()
    lab.now += 5.0
    assert lab.it.poll(lab.now) > 0.0  # it has not been judged
    assert lab.it.bench.drive.missed == 0


@pytest.mark.parametrize("stall", [0.02, 0.1, 0.2])
@pytest.mark.parametrize("rate", [1.0, 10.0, 100.0])
def test_a_controller_that_a_busy_machine_held_up_keeps_the_bench(
    stall: float, rate: float
) -> None:
    lab = Lab(rate=rate, max_missed=4).until(20)
    lab.stopped.add("a")
    end = lab.now + stall
    while lab.now < end:
        lab.poll()
    lab.stopped.clear()
    question = lab.it.bench.question
    lab.waiting = [EffortCommand(question.tick, question.epoch, "a", ZERO)]
    lab.until(200)
    assert len(lab.kinds("missed")) <= 3
    assert lab.kinds("brake", "fallback", "not_ready") == []


@pytest.mark.parametrize("rate", [1.0, 10.0])
def test_paced_a_dead_controller_loses_the_bench_within_half_a_second(rate: float) -> None:
    lab = Lab(rate=rate, max_missed=4, fallback=("b",)).until(20)
    lab.dead.add("a")
    died = lab.now
    while not lab.kinds("fallback"):
        lab.poll()
    assert lab.now - died < 0.5
    assert len(lab.kinds("missed")) == 4
    tick = lab.it.bench.tick
    assert lab.until(tick + 20).kinds("fallback", "brake") == ["fallback"]


def test_the_recorder_s_death_is_an_event_within_two_seconds_and_nobody_waits_for_it() -> None:
    lab = Lab(controllers=("a", "recorder")).until(10)
    lab.it.node_progress.received("recorder", 0, 0)
    lab.dead.add("recorder")
    died = lab.now
    lab.until(3000)
    (event,) = [e for e in lab.events if e.kind == "recorder_lost"]
    assert "recorder" in event.message
    assert lab.now - died < 2.0 + 2.0 + 3000 * 1e-3  # held back for once, then no more
    lab.dead.clear()
    lab.now += 1.0
    lab.until(3010)
    assert lab.kinds("recorder_lost", "recorder_back") == ["recorder_lost", "recorder_back"]


def test_as_fast_as_it_goes_a_starved_recorder_is_waited_for_and_not_for_ever() -> None:
    lab = Lab(controllers=("a", "recorder")).until(10)
    for seen in (10, 70):
        lab.it.node_progress.received("recorder", seen, 0, recorder=True)
        lab.dead.add("recorder")  # not a beat
        end = lab.now + 1.9
        while lab.now < end:
            lab.poll()
        assert lab.it.bench.tick == seen + 100
    assert lab.kinds("recorder_lost") == ["recorder_lost"]
    lab.until(1000)


@pytest.mark.parametrize("rate", [1.0, 20.0])
def test_paced_the_plant_falls_behind_its_schedule_before_the_log_has_a_gap(rate: float) -> None:
    lab = Lab(rate, controllers=("a", "recorder")).until(10)
    lab.it.node_progress.received("recorder", 10, 0, recorder=True)
    lab.it.node_progress.received("a", 10, 0)  # nobody else is waited for
    lab.until(1010)
    held = lab.now
    lab.dead.add("recorder")  # starved: not a beat either
    while lab.now < held + 1.9:
        lab.poll()
    assert lab.it.bench.tick == 1010
    lab.it.node_progress.received("recorder", 900, 0, recorder=True)
    lab.until(1900)
    assert lab.kinds("late") == ["late"]
    assert lab.it.bench.drive.missed == 0
    lab.until(3000)  # not for ever


@pytest.mark.parametrize(("rate", "within"), [(0.0, 100), (20.0, 1000)])
def test_a_recorder_is_waited_for_before_its_first_status(rate: float, within: int) -> None:
    lab = Lab(rate, controllers=("a", "recorder")).until(10)
    end = lab.now + 1.9
    while lab.now < end:
        lab.poll()
    assert lab.it.bench.tick <= within + 10


def test_a_recorder_that_has_ended_holds_nobody_back() -> None:
    lab = Lab(20.0, controllers=("a", "recorder")).until(10)
    lab.dead.add("recorder")
    lab.until(900)
    lab.it.heartbeats.ended(Heartbeat("recorder", "recorder", 1, 1))
    lab.it.node_progress.clear("recorder")
    lab.until(5000)
    assert lab.kinds("late") == []


def test_as_fast_as_it_goes_one_that_has_just_fallen_silent_may_be_switched_in() -> None:
    lab = Lab().until(10)
    lab.die("b")
    assert lab.it.reason("b", lab.now).cause is Cause.NO_HEARTBEAT
    assert lab.it.switch(SwitchRequest("b", lab.it.bench.tick + 5), lab.now) is None
    lab.dead.clear()
    lab.until(100)
    assert lab.kinds("switched", "switch_dropped") == ["switched"]
    lab.dead.add("a")
    end = lab.now + 3.0
    while lab.now < end:
        lab.poll()
    wish = SwitchRequest("a", lab.it.bench.tick + 5)
    assert lab.it.switch(wish, lab.now).cause is Cause.NO_HEARTBEAT


def test_what_an_operator_does_is_an_event_with_its_tick_and_who_asked() -> None:
    lab = Lab(rate=1.0, allow_faults=True).until(10)
    it = lab.it
    assert it.note(" the beam rings ", "ann").message == f"noted at tick {it.bench.tick}"
    it.set_rate(2.0, lab.now, "bob")
    it.brake(True, "ann")
    lab.until(12)
    it.brake(False, "ann")
    it.pause(lab.now, "bob")
    it.step(3, "ann")
    lab.until(15)
    it.reset("ann")
    it.start("bob")
    lab.until(2)
    told = {e.kind: (e.epoch, e.data["who"]) for e in lab.events if "who" in e.data}
    assert told == {
        "note": (0, "ann"), "rate": (0, "bob"), "brake_requested": (0, "ann"),
        "paused": (0, "bob"), "step": (0, "ann"), "resumed": (0, "ann"), "reset": (1, "ann"),
        "started": (1, "bob"),
    }  # fmt: skip
    assert [e.message for e in lab.events if e.kind == "note"] == ["the beam rings"]


@pytest.mark.parametrize("rate", [-1.0, float("nan"), float("inf")])
def test_a_rate_that_is_none_is_refused(rate: Any) -> None:
    lab = Lab()
    reply = lab.it.set_rate(rate, lab.now)
    assert not reply.ok
    assert "rate_factor" in reply.message
    assert not lab.it.tick_timer.paced


def test_an_empty_remark_is_refused() -> None:
    assert not Lab().it.note("  ").ok


def test_a_remark_is_as_long_as_a_log_can_hold_or_refused() -> None:
    lab = Lab()
    assert lab.it.note("x" * (1 << 16)).ok
    assert lab.it.note("x" * (1 + (1 << 16))).message == (
        "text: has 65,537 characters; at most 65,536 are allowed"
    )


def test_the_rate_changes_in_flight_without_a_miss() -> None:
    lab = Lab(rate=1.0).until(20)
    for rate in (10.0, 0.1, 0.0, 1.0):
        lab.it.set_rate(rate, lab.now)
        at = lab.now
        lab.until(lab.it.bench.tick + 20)
        if rate:
            assert lab.now - at == pytest.approx(20 * 0.01 / rate, rel=0.15)
    assert lab.kinds("missed", "late") == []


def test_repeated_questions_make_no_rejections_in_a_healthy_run() -> None:
    lab = Lab().until(10)
    lab.stopped.add("a")
    for _ in range(20):
        lab.poll()
    asked = [q for q in lab.measurements if q.tick == lab.it.bench.tick]
    assert len(asked) > 2
    lab.stopped.clear()
    for question in asked:  # every repetition is answered, the later ones too late
        command = EffortCommand(question.tick, question.epoch, "a", ZERO)
        lab.it.take(command, lab.now)
        lab.send()
    lab.until(30)
    assert lab.kinds("rejected", "missed") == []


@pytest.mark.parametrize("rate", [0.0, 1.0])
def test_a_newcomer_after_the_brake_that_never_answers_leaves_the_bench_to_the_brake(
    rate: float,
) -> None:
    lab = Lab(rate=rate, fallback=("a",)).until(10)
    for on in (True, False):
        assert lab.it.brake(on).ok
        lab.until(lab.it.bench.tick + 5)
    lab.stopped.add("b")
    assert lab.it.switch(SwitchRequest("b", lab.it.bench.tick + 2), lab.now) is None
    lab.until(lab.it.bench.tick + 20)
    (took_over,) = [e for e in lab.events if e.kind in ("fallback", "brake")]
    assert took_over.kind == "brake"
    assert [e.data["controller"] for e in lab.events if e.kind == "missed"] == ["b"] * 5
    assert all(e.data["controller"] for e in lab.events if e.kind == "not_ready")  # not the brake
    assert lab.it.bench.drive.active == ""


@pytest.mark.parametrize(("rate", "steps"), [(1.0, 0), (1.0, 3), (0.0, 3)])
def test_a_question_that_was_answered_before_a_rest_or_in_it_is_not_asked_again_after_it(
    rate: float, steps: int
) -> None:
    lab = Lab(rate=rate).until(50)
    it = lab.it
    if steps:  # its answer comes when the bench rests
        assert it.pause(lab.now).ok
        assert it.step(steps).ok
        while it.run.state != PAUSED:
            lab.poll()
    else:
        while not it.bench.answered:
            lab.poll()
        assert it.pause(lab.now).ok
    for _ in range(3):
        lab.poll()
    assert it.bench.answered
    assert it.start().ok
    lab.until(60)
    asked = [question.tick for question in lab.measurements]
    assert asked == sorted({*asked})  # who has come since would take the first for its own


@pytest.mark.parametrize("rate", [0.0, 10.0])
def test_a_controller_that_is_started_again_on_a_paused_bench_goes_on_with_it(rate: float) -> None:
    lab = Lab(rate=rate).until(1500)
    it = lab.it
    for name in ("a", "b"):
        it.node_progress.received(name, 1500, 0)
    assert it.pause(lab.now).ok
    lab.poll()
    for name in ("a", "b"):  # a new process has seen nothing, and the bench is far beyond
        it.node_progress.received(name, 0, 0)
    assert it.switch(SwitchRequest("b", it.bench.tick + 2), lab.now) is None
    assert it.start().ok
    lab.poll()
    assert it.run.running
    assert it.waiting_for == []
    for name in ("a", "b"):
        it.node_progress.received(name, it.bench.tick, 0)
    lab.until(1600)
    assert lab.kinds("switched", "switch_dropped", "missed") == ["switched"]
    it.node_progress.received("a", 200, 0)  # one that is slow, and has questions to work off
    assert it.pause(lab.now).ok
    assert it.reason("a", lab.now).cause is Cause.BEHIND


@pytest.mark.parametrize("rate", [0.0, 1.0])
@pytest.mark.parametrize("way", ["switch", "brake", "neither"])
@pytest.mark.parametrize(
    ("rest", "why"),
    [
        ("pause", "its heartbeat is lost"),
        ("pause", "no plan yet"),
        ("reset", "its heartbeat is lost"),
    ],
)
def test_who_cannot_go_on_after_a_rest_is_not_waited_for_where_it_is_relieved_at_once(
    rest: str, why: str, way: str, rate: float
) -> None:
    lab = Lab(rate=rate, duration=1.0).until(10)
    assert lab.it.pause(lab.now).ok
    if rest == "reset":
        assert lab.it.reset().ok
    if why == "no plan yet":
        lab.it.receive("a", False, why)
        lab.stopped.add("a")
    else:
        lab.dead.add("a")
    for _ in range(60):  # three seconds
        lab.poll()
    if way == "switch":
        assert lab.it.switch(SwitchRequest("b", lab.it.bench.tick + 1), lab.now) is None
    elif way == "brake":
        assert lab.it.brake(True).ok
    assert lab.it.start().ok
    for _ in range(100):
        lab.poll()
    if way == "neither":
        assert lab.it.waiting_for == [f"a ({why})"]
        return
    lab.until(60)
    assert lab.it.bench.drive.active == ("b" if way == "switch" else "")
    assert len(lab.kinds("missed")) <= 1
    assert lab.kinds("fallback", "brake") == []


def test_a_plant_with_its_own_clock_neither_rests_nor_changes_its_rate(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Bench, "own_clock", True)
    lab = Lab(duration=1.0)
    lab.until(5)
    session = lab.it
    for reply in (session.pause(lab.now), session.step(3), session.set_rate(2.0, lab.now)):
        assert "the plant has a clock of its own" in reply.message
        assert not reply.ok
    lab.dead |= {"a", "b"}
    now = lab.now
    lab.until(9)  # tick 5 may be answered already
    assert lab.now - now < 4 * 0.02  # each missed after a period
    assert session.bench.drive.missed >= 3
