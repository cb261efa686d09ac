"""The console over a bench in its own process: what its page requests, and what the log holds."""

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from threading import Thread
from time import monotonic, sleep
from typing import Any

import pytest
from tests.lab.test_front import ELSEWHERE
from tests.page_client import PageClient
from tests.ros.console_page import console

from flexslew_lab.cli.console import console as command
from flexslew_lab.console.in_process.link import InProcessLink
from flexslew_lab.console.link import RequestResult
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.replay.resim import resim
from flexslew_lab.run.run_trial import Result, run_trial
from flexslew_lab.trial.trial import Trial, parse_trial
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics

WALL = 60.0  # for one thing to happen on a busy machine [wall s]
TRIAL = """
name: operated
duration: {duration}
allow_faults: true
rate_factor: {rate}
plan:
  method: reference_only
  model: {{variant: complete, modes: 1}}
  goal: {{base_yaw: 0.1, hub_pitch: 0.05}}
  duration: 2.0
controllers:
  pd_feedforward: {{kp: [460.0, 460.0], kd: [920.0, 920.0]}}
  lqr: {{}}
active: pd_feedforward
"""


class Operator:
    """Requests, and waits for what comes of them."""

    def __init__(self, link: InProcessLink) -> None:
        self.link, self.results = link, list[Result]()

    def until(self, condition: Callable[[], Any]) -> None:
        end = monotonic() + WALL
        while not condition():
            assert monotonic() < end, self.link.view.now
            self.link.poll(monotonic())
            sleep(0.005)

    def ask(self, service: str, **values: Any) -> RequestResult:
        answers: list[RequestResult] = []
        self.link.ask(service, values, answers.append)
        self.until(lambda: answers)
        return answers[0]

    def act(self, action: str) -> RequestResult:
        return self.ask(topics.OPERATE, action=action, who="me")

    def switch(self, controller: str) -> RequestResult:
        step = {"strict": False, "max_effort_step": 0.0, "timeout": 10.0}
        return self.ask(topics.SWITCH_CONTROLLER, controller=controller, at=0.0, who="me", **step)

    def draft(self, request: str, cancel: bool = False) -> tuple[RequestResult, Any]:
        answers: list[tuple[RequestResult, Any]] = []
        self.link.draft(request, "me", lambda news: None, lambda *answer: answers.append(answer))
        if cancel:
            self.link.cancel()
        self.until(lambda: answers)
        return answers[0]

    def at(self, state: str) -> None:
        self.until(lambda: self.link.view.now.state == state)


@contextmanager
def operated(
    folder: Path, rate: float = 0.0, duration: float = 6.0, given: Trial | None = None
) -> Iterator[Operator]:
    """Yield the operator of a bench that is flown in a thread."""
    trial = given or parse_trial(TRIAL.format(rate=rate, duration=duration), "test")
    link = InProcessLink(str(folder), "")
    operator = Operator(link)

    def fly() -> None:
        operator.results.append(run_trial(trial, "test", folder, link.fly, report=False))

    thread = Thread(target=fly)
    thread.start()
    try:
        operator.at("paused")
        yield operator
    finally:
        if thread.is_alive() and link.view.now.state != "finished":
            operator.ask(topics.SET_RATE, rate_factor=0.0, who="me")
            link.ask(topics.OPERATE, {"action": "start", "who": "me"}, lambda result: None)
        end = monotonic() + WALL
        while thread.is_alive() and monotonic() < end:
            link.poll(monotonic())
            sleep(0.005)
        thread.join(1.0)


@pytest.mark.parametrize("rate", [0.0, 20.0])
def test_an_operated_flight_that_nobody_touches_is_the_plain_flight(
    tmp_path: Path, rate: float
) -> None:
    with operated(tmp_path / "run", rate) as operator:
        assert operator.act("start") == RequestResult(True, "starting at tick 0", 0)
        operator.at("finished")
        view = operator.link.view
        assert view.truth.time.size == 601
        assert [event.kind for event in view.events][-1] == "finished"
        refused = operator.act("start")
    trial = replace(parse_trial(TRIAL.format(rate=0.0, duration=6.0), "test"), rate_factor=rate)
    plain = run_trial(trial, "test", tmp_path / "plain", True, report=False)
    (result,) = operator.results
    assert result.metrics["trajectory_hash"] == plain.metrics["trajectory_hash"]
    assert result.exit_code == 0
    assert refused.message == "the run is over"
    assert resim(tmp_path / "run" / "bag").identical


def test_every_request_of_the_page_is_in_the_log_and_flies_again(tmp_path: Path) -> None:
    with operated(tmp_path / "run", duration=30.0) as operator:
        at = {"at": 0.0, "who": "me"}
        assert operator.ask(topics.STEP, ticks=100, who="me").tick == 100
        operator.until(lambda: operator.link.view.now.tick == 100)
        assert operator.ask("pd_feedforward/tune", settings="{kp: [500.0, 500.0]}", **at).ok
        assert operator.ask(topics.STEP, ticks=100, who="me").ok
        operator.until(lambda: operator.link.view.now.tick == 200)
        fault = "{fault: {kind: actuator_stuck, joint: hub_pitch}}"
        assert operator.ask(topics.INJECT_FAULT, fault=fault, **at).ok
        operator.link.ask(topics.STEP, {"ticks": 400, "who": "me"}, lambda result: None)
        assert operator.switch("lqr").ok
        operator.until(lambda: operator.link.view.now.tick == 600)
        assert operator.link.view.now.active == "lqr"
        ((number, _),) = operator.link.view.now.faults
        assert operator.ask(topics.END_FAULT, number=number, who="me").ok
        assert operator.ask(topics.NOTE, text="a remark", who="me").ok
        assert operator.act("brake").ok
        assert operator.ask(topics.STEP, ticks=50, who="me").ok
        operator.until(lambda: operator.link.view.now.tick == 650)
        assert operator.link.view.now.brake_latched
        assert operator.act("release_brake").ok
        operator.link.ask(topics.STEP, {"ticks": 50, "who": "me"}, lambda result: None)
        assert operator.switch("pd_feedforward").ok
        operator.until(lambda: operator.link.view.now.tick == 700)
        assert operator.act("reset").ok
        operator.until(lambda: operator.link.view.now.epoch == 1)
        assert operator.act("start").ok
        operator.at("finished")
    bag = tmp_path / "run" / "bag"
    kinds = [event.kind for event in BagReader(bag).overview.events]
    wanted = ("tuned", "injected", "switch", "fault_ended", "note", "brake", "reset")
    missing = [word for word in wanted if not any(word in kind for kind in kinds)]
    assert not missing, kinds
    again = resim(bag)
    assert again.identical, again.first_difference


def test_what_cannot_be_is_refused_in_words_and_changes_nothing(tmp_path: Path) -> None:
    with operated(tmp_path / "run") as operator:
        at = {"at": 0.0, "who": "me"}
        refused = {
            "action: 'fly'": operator.act("fly"),
            "not running": operator.act("pause"),
            "no service": operator.ask("nobody/tune", settings="{kp: 1}", **at),
            "unknown controller": operator.switch("nobody"),
            "kp": operator.ask("pd_feedforward/tune", settings="{kp: [-1.0]}", **at),
            "YAML keys": operator.ask("pd_feedforward/tune", settings="[1]", **at),
            "rate_factor": operator.ask(topics.SET_RATE, rate_factor=-1.0, who="me"),
            "nose": operator.ask(topics.INJECT_FAULT, fault="{fault: {kind: nose}}", **at),
            "draft": operator.ask(topics.DECIDE_PLAN, action="adopt", who="me"),
        }
        for words, result in refused.items():
            assert not result.ok, words
            assert words in result.message
        operator.act("start")
        operator.at("finished")
    plain = run_trial(
        parse_trial(TRIAL.format(rate=0.0, duration=6.0), "test"),
        "test", tmp_path / "plain", True, report=False,
    )  # fmt: skip
    assert operator.results[0].metrics["trajectory_hash"] == plain.metrics["trajectory_hash"]


@pytest.mark.slow
def test_a_plan_is_drafted_canceled_dropped_and_adopted_in_flight(tmp_path: Path) -> None:
    request = (
        "{method: reference_only, model: {variant: complete, modes: 1}, "
        "goal: {base_yaw: 0.15, hub_pitch: 0.1}, duration: 4.0, start: %s}"
    )
    with operated(tmp_path / "run", duration=20.0) as operator:
        assert operator.ask(topics.STEP, ticks=300, who="me").ok
        operator.until(lambda: operator.link.view.now.tick == 300)
        result, plan = operator.draft(request % 5.0, cancel=True)
        assert not result.ok
        assert "canceled" in result.message
        assert plan is None
        late, plan = operator.draft(request % 1.0)
        assert not late.ok
        assert plan is None
        result, plan = operator.draft(request % 5.0)
        assert result.ok, result
        assert operator.ask(topics.DECIDE_PLAN, action=f"refuse {plan.hash}", who="me").ok
        result, plan = operator.draft(request % 6.0)
        adopted = operator.ask(topics.DECIDE_PLAN, action=f"adopt {plan.hash}", who="me")
        assert adopted.ok, adopted
        assert "taken by lqr, pd_feedforward" in adopted.message
        assert operator.link.view.plan.hash == plan.hash
        operator.act("start")
        operator.at("finished")
    rows = BagReader(tmp_path / "run" / "bag").columns("/controller_state", {"reference_position"})
    assert rows["reference_position"][-1].tolist() == pytest.approx([0.15, 0.1])
    again = resim(tmp_path / "run" / "bag")
    assert again.identical, again.first_difference


@pytest.mark.slow
def test_the_page_of_the_command_operates_the_bench_and_ctrl_c_leaves_a_whole_log(
    tmp_path: Path,
) -> None:
    trial, run = tmp_path / "trial.yaml", tmp_path / "run"
    trial.write_text(TRIAL.format(rate=1.0, duration=1000.0))
    with console(str(trial), "--in-process", "--out", str(run)) as (child, address):
        page = PageClient(address)
        end = monotonic() + WALL
        while ">running<" not in page.text:
            assert monotonic() < end, page.text
            if ">paused<" in page.text:
                page.set(page.named("Start"), True)
            page.reach()
        child.send_signal(signal.SIGINT)
        assert child.wait(WALL) == 130
    assert (run / "metrics.json").exists()
    assert [event.kind for event in BagReader(run / "bag").overview.events][-1] == "interrupted"
    assert resim(run / "bag").identical


def test_before_the_plan_is_made_the_page_states_what_it_waits_for() -> None:
    link, answers = InProcessLink("", ""), list[RequestResult]()
    link.ask(topics.OPERATE, {"action": "start", "who": "me"}, answers.append)
    assert link.view.now[:2] == ("waiting", ("the plan of the trial",))
    assert (answers[0].ok, "its plan is being made" in answers[0].message) == (False, True)


@pytest.mark.parametrize("other", [{"attach": True}, {"replay": Path("runs")}])
def test_in_process_is_for_a_trial(other: dict[str, Any]) -> None:
    with pytest.raises(BadInput, match="--in-process is for a trial"):
        command(in_process=True, **other)


@pytest.mark.slow
def test_the_page_needs_no_module_that_linux_alone_has() -> None:
    script = f"import nicegui, uvicorn, websockets\n{ELSEWHERE}" + (
        "from flexslew_lab.console.in_process.link import InProcessLink\n"
        "from flexslew_lab.console.page import Page\n"
        "page = Page(InProcessLink('', ''), '127.0.0.1', 0, lambda words: None)\n"
        "page.poll()\npage.close()\n"
    )
    command = [sys.executable, "-c", script]
    child = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (child.returncode, child.stdout) == (0, "10\n"), child.stderr
