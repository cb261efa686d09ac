"""The page shows the state of the bench as it is: the brake, no controller, repeated requests."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from tests.fake_bench import FakeLink
from tests.hands import Hands

from flexslew_lab.console.link import RequestResult, Then
from flexslew_lab.console.page import Page
from flexslew_lab.console.panels.run import trial_name
from flexslew_lab.console.view import BenchView
from flexslew_lab.log.messages.cdr import encode
from flexslew_plant.events import (
    BrakeLatched,
    BrakeReleased,
    BrakeRequested,
    SwitchCompleted,
    SwitchRequested,
)
from flexslew_plant.events.event import Fact, event_of
from flexslew_plant.graph import topics
from flexslew_plant.graph.topics import TOPICS

BANNER = "No controller is active; choose one:"


class StubbornLink(FakeLink):
    """A bench that refuses as a real one does what it does already."""

    refusal = ""

    def ask(self, service: str, values: Mapping[str, Any], then: Then) -> None:
        self.request.append((service, dict(values)))
        then(RequestResult(not self.refusal, self.refusal or "answered"))


class Bench(Hands):
    """A page, and the messages of its bench."""

    link: StubbornLink

    def state(self, **fields: Any) -> None:
        now = self.link.view.now
        message = {"state": now.state, "tick": now.tick, "active": now.active, "epoch": now.epoch,
                   "brake_latched": now.brake_latched, **fields}  # fmt: skip
        self._take(topics.BENCH_STATE, message)

    def event(self, what: Fact, tick: int) -> None:
        event = event_of(what, tick, tick * 0.01, 0, "plant")
        self._take(topics.EVENTS, event_fields(event))

    def refuse(self, words: str) -> None:
        self.link.refusal = words

    def _take(self, topic: str, fields: dict[str, Any]) -> None:
        kind = TOPICS[topic].type
        self.link.view.take(topic, kind, [encode(kind, fields)])
        self.refresh()


def event_fields(event: Any) -> dict[str, Any]:
    return {"tick": event.tick, "level": 0, "kind": event.kind, "source": event.source,
            "message": event.message, "data": json.dumps(event.data)}  # fmt: skip


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    link = StubbornLink()
    page = Page(link, "127.0.0.1", 0, lambda words: None, layouts=tmp_path / "layouts.json")
    found = Bench(page, link)
    found.state(state="paused", tick=120, active="pd")
    yield found
    page.close()


def test_a_brake_on_a_paused_bench_says_when_it_latches_and_can_be_released_at_once(
    bench: Bench,
) -> None:
    assert not bench.seen("Release the brake")
    bench.event(BrakeRequested(True, 121, "ann"), 120)
    assert "latches at tick 121" in bench.texts()
    assert "not latched" not in bench.texts()
    assert bench.seen("Release the brake")
    bench.state(state="running")
    bench.event(BrakeLatched("pd"), 121)
    bench.state(tick=121, active="", brake_latched=True)
    assert "latches at" not in bench.texts()
    assert bench.seen("Release the brake")


def test_a_release_on_a_paused_bench_says_when_and_lets_the_next_controller_be_chosen(
    bench: Bench,
) -> None:
    bench.state(active="", brake_latched=True)
    assert not bench.seen("pd")
    bench.event(BrakeRequested(False, 121, "ann"), 120)
    assert "released at tick 121. Choose the next controller:" in bench.texts()
    assert bench.seen("pd")
    assert not bench.seen("Release the brake")
    bench.event(SwitchRequested("pd", 121, False, 1.0, "ann"), 120)
    assert "pd takes over at tick 121" in bench.texts()
    assert not bench.seen("pd")


def test_after_the_release_a_banner_offers_the_controllers_that_are_ready(bench: Bench) -> None:
    view = bench.link.view
    view.controllers["lost"] = view.controllers["pd"]._replace(name="lost", ready=False)
    bench.state(state="running", active="", brake_latched=True)
    bench.click("Release the brake")
    bench.event(BrakeRequested(False, 121, "ann"), 120)
    bench.event(BrakeReleased(), 121)
    bench.state(tick=121, brake_latched=False)
    assert BANNER in bench.texts()
    assert (bench.seen("pd"), bench.seen("lost")) == (True, False)
    [(service, values)] = bench.click("pd")
    assert (service, values["controller"], values["at"]) == ("switch_controller", "pd", 0.0)
    bench.event(SwitchCompleted("", "pd", 0.1), 122)
    bench.state(tick=122, active="pd")
    assert BANNER not in bench.texts()
    assert not bench.seen("pd")


@pytest.mark.parametrize("state", ["not found", "finished"])
def test_a_bench_that_takes_no_controller_asks_for_none(bench: Bench, state: str) -> None:
    bench.state(state=state, active="")
    assert BANNER not in bench.texts()


@pytest.mark.parametrize(
    ("state", "words"),
    [("paused", "After a start ticks pass under the brake"), ("running", "ticks pass under the")],
)
def test_a_start_under_the_brake_says_so(bench: Bench, state: str, words: str) -> None:
    bench.state(state=state, active="", brake_latched=True)
    assert words in bench.texts()
    bench.state(active="pd", brake_latched=False)
    assert words not in bench.texts()


@pytest.mark.parametrize(
    ("button", "fields"),
    [
        ("Brake (space bar)", {"active": "", "brake_latched": True}),
        ("Release the brake", {}),
        ("Switch to pd", {"active": "pd"}),
    ],
)
def test_a_request_for_what_is_so_already_succeeds_silently(
    bench: Bench, button: str, fields: dict[str, Any]
) -> None:
    bench.refuse("it is so already")
    bench.state(**fields)
    assert bench.click(button)  # the bench is asked all the same
    assert "it is so already" not in bench.texts()


def test_a_running_bench_shows_pause_and_a_paused_one_start(bench: Bench) -> None:
    other = {"Start": "Pause", "Pause": "Start"}
    for state, label, action in (("paused", "Start", "start"), ("running", "Pause", "pause"),
                                 ("waiting", "Pause", "pause")):  # fmt: skip
        bench.state(state=state)
        assert bench.seen(label)
        assert not bench.seen(other[label])
        [(_, values)] = bench.click(label)
        assert values["action"] == action


def test_a_second_click_on_pause_does_not_start_the_bench_again(bench: Bench) -> None:
    bench.state(state="running")
    pause = bench.elements("Pause")[0]
    bench.state(state="paused")  # between the clicks
    bench.link.request.clear()
    for on_click in pause.on_click:
        on_click(3)
    bench.page._context.work()
    assert [values["action"] for _, values in bench.link.request] == ["pause"]


def test_two_pages_that_start_at_once_both_succeed(bench: Bench) -> None:
    bench.refuse("already running")
    start = bench.elements("Start")[0]
    bench.link.view.now = bench.link.view.now._replace(state="running")  # not shown yet
    for told in start.on_click:
        told(3)
    bench.page._context.work()
    assert bench.link.request[0][1]["action"] == "start"
    bench.refresh()
    assert "already running" not in bench.texts()


def test_a_bench_that_waits_says_for_what(bench: Bench) -> None:
    bench.state(state="waiting", waiting_for=["recorder"])
    assert "Waiting for recorder." in bench.texts()
    bench.state(state="running", waiting_for=[])
    assert "Waiting for" not in bench.texts()


def test_a_card_says_why_a_controller_cannot_take_over(bench: Bench) -> None:
    view = bench.link.view
    lost = view.controllers["pd"]._replace(name="lost", ready=False, reason="no plan <yet>")
    view.controllers["lost"] = lost
    bench.refresh()
    assert "not ready: no plan &lt;yet&gt;" in bench.texts()
    assert not bench.elements("Switch to lost")[0].enabled
    assert not bench.seen("Switch to pd")  # it is active
    bench.click("Tune lost")
    assert bench.seen("Apply the gains")
    assert bench.elements("Tuned controller")[0].value == "lost"
    bench.click("Close")
    assert not bench.seen("Apply the gains")


def test_settings_that_are_not_those_of_the_law_are_shown_all_the_same(bench: Bench) -> None:
    view = bench.link.view
    view.controllers["odd"] = view.controllers["pd"]._replace(name="odd", law="lqr")
    bench.refresh()
    bench.click("Tune odd")
    assert bench.elements("kp")[0].value == "[460.0, 460.0]"


def test_each_fault_has_a_button_that_ends_it(bench: Bench) -> None:
    assert "no disturbance and no fault" in bench.texts()
    bench.state(fault_numbers=[4, 7], faults=["gain of a", "bias of b"])
    [(service, values)] = bench.click("End 7")
    assert (service, values["number"]) == ("end_fault", 7)
    bench.state(fault_numbers=[4], faults=["gain of a"])
    assert (bench.seen("End 4"), bench.seen("End 7")) == (True, False)


@pytest.mark.parametrize(
    ("command", "folder", "name"),
    [
        ("./flexslew trial swap_demo --set=seed=2", "", "swap_demo"),
        ("./flexslew trial 'my trials/first one.yaml'", "", "first one"),
        ("./flexslew resim runs/m1-20260101-120000", "runs/m1-20260101-120000", "m1"),
        ("", "", ""),
    ],
)
def test_the_header_names_the_trial(command: str, folder: str, name: str) -> None:
    link = FakeLink(folder)
    link.command = command
    assert trial_name(link) == name


def test_the_keys_of_the_page_are_different(bench: Bench) -> None:
    keys = [e.key for e in bench.gui.all() if e.key and e.visible]
    assert len({*keys}) == len(keys) > 8


def test_a_request_that_fails_says_why_until_the_state_changes(bench: Bench) -> None:
    bench.refuse("call reset first")
    bench.click("Start")
    assert 'role="alert"' in bench.texts()
    bench.state(tick=120)
    assert "call reset first" in bench.texts()
    bench.state(state="running")
    assert "call reset first" not in bench.texts()


def test_an_answer_leaves_when_another_controller_is_active(bench: Bench) -> None:
    bench.state(active="lqr")
    bench.click("Switch to pd")
    assert "answered" in bench.texts()  # the state comes a little later
    bench.state(active="pd")
    assert "answered" in bench.texts()
    bench.state(active="lqr_2")
    assert "answered" not in bench.texts()


def test_an_answer_leaves_with_a_reset(bench: Bench) -> None:
    bench.click("Disturb")
    assert "answered" in bench.texts()
    bench.state(epoch=1, tick=0)
    assert "answered" not in bench.texts()


def test_an_error_beside_a_field_leaves_when_the_field_is_changed(bench: Bench) -> None:
    bench.set("goal of a", "0.5")
    bench.click("Plan")
    assert "start: is missing" in bench.texts()
    bench.change("start", "2.0")
    assert "start: is missing" not in bench.texts()


def test_the_brake_of_an_earlier_run_is_forgotten() -> None:
    view = BenchView()
    view.brake_request = BrakeRequested(True, 5, "ann")
    view.clear()
    assert not view.brake_on_next
