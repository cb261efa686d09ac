"""A second one of each role comes, or one comes again: the flight and its log stay whole."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from flexslew_msgs.msg import BenchState
from std_srvs.srv import Trigger

from flexslew_control.plans.plan_file import save_plan
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.replay.resim import resim
from flexslew_lab.trial.trial import parse_trial, plan_of_trial
from flexslew_plant.direct.names import SETTING
from flexslew_plant.graph.topics import BENCH_STATE, TOPICS
from flexslew_plant.ros.offers import qos
from tests.present import present

from .flight import SLEW
from .one_by_one import CONTROLLER, PLANNER, PLANT, Bench, standing

# a bench of four processes and as many second ones: on busy processors it takes minutes
pytestmark = [pytest.mark.ros, pytest.mark.timeout(900)]

RECORDER = "flexslew_lab.ros.recorder_node"
# without a plan it would take charge before it hears the one that is flown
GAINS = {"kp": "[460.0, 460.0]", "kd": "[920.0, 920.0]", "requires_plan": "true"}
OTHER = SLEW.format(duration=9.0, rate=0.0, patience=20.0, more="", extra="").replace("0.1", "-0.2")


class Recorded(Bench):
    """A recorded bench that is started, and what it is doing."""

    def __init__(self, folder: Path, domain: int) -> None:
        super().__init__(folder, domain)
        self.state = BenchState()
        self.node.create_subscription(BenchState, BENCH_STATE, self._see, qos(TOPICS[BENCH_STATE]))
        self.bag = folder / "bag"
        other = folder / "plan.yaml"
        save_plan(present(plan_of_trial(parse_trial(OTHER, "test"))), other)
        self._seconds: tuple[tuple[str, str, dict[str, str]], ...] = (
            ("pd_feedforward", CONTROLLER, {"kp": "[300.0, 300.0]", "kd": "[700.0, 700.0]"}),
            ("plant", PLANT, {"bench.active": "nobody"}),
            ("planner", PLANNER, {"file": str(other)}),
        )
        self.start("recorder", RECORDER, folder=str(self.bag), exit_with_plant="true")
        self.start("pd_feedforward", CONTROLLER, **GAINS)
        plan = "'{method: reference_only, goal: {base_yaw: 0.1}, duration: 5.0}'"
        self.start("planner", PLANNER, plan=plan)
        waits = {"autostart": "false", "wait_for": "[recorder]", "answer_timeout": "20.0"}
        self.start("plant", PLANT, **waits, **{"rate_factor": "1.0", "bench.max_missed": "1000"})
        self.until(lambda: bool(self.state.state) and self.ready)

    def _see(self, state: BenchState) -> None:
        self.state = state

    @property
    def ready(self) -> bool:
        status = self.statuses.get("pd_feedforward")
        return status is not None and status.ready

    def ask(self, name: str) -> None:
        client = self.node.create_client(Trigger, name)
        self.until(client.service_is_ready)
        done = client.call_async(Trigger.Request())
        self.until(done.done)
        assert present(done.result()).success, present(done.result()).message

    def seconds_come(self) -> None:
        """Start a second one of each, wait until plant and planner have left, kill the other."""
        firsts = dict(self.pids)
        for name, module, given in self._seconds:
            self.start(name, module, **given)
        seconds, self.pids = dict(self.pids), firsts
        left = [seconds[name] for name in ("plant", "planner")]
        self.pids = {"left_0": left[0], "left_1": left[1], **firsts}
        self.until(lambda: not (self.runs("left_0") or self.runs("left_1")))
        self.pids = firsts
        assert "another controller called pd_feedforward" in self.log("pd_feedforward")
        os.kill(seconds["pd_feedforward"], signal.SIGKILL)


@pytest.fixture
def recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Recorded]:
    monkeypatch.setenv(SETTING, "dds")  # where the plant cannot tell two of a name by their sockets
    with standing(Recorded, tmp_path) as one:
        yield one


def test_a_second_one_of_each_changes_neither_flight_nor_log(recorded: Recorded) -> None:
    recorded.seconds_come()
    recorded.ask("start")
    recorded.until(lambda: recorded.state.tick > 50)
    recorded.seconds_come()
    assert recorded.state.state == "running"
    recorded.ask("reset")
    recorded.seconds_come()
    recorded.ask("start")
    recorded.until(lambda: (recorded.state.epoch, recorded.state.tick >= 50) == (1, True))
    recorded.end("plant")
    recorded.until(lambda: not recorded.runs("recorder"))

    seen = BagReader(recorded.bag)
    kinds = [event.kind for event in seen.overview.events]
    assert not {"began", "not_ready", "plan_refused", "stray"} & {*kinds}, kinds
    assert kinds.count("planned") == 1
    assert len(seen.overview.plans) == 1
    statuses = list(seen.decode_messages(["/controller_status"]))
    assert all("300" not in status.settings for _, _, status in statuses)
    assert len({status.instance for _, _, status in statuses}) == 1
    assert resim(recorded.bag).identical


def test_a_second_one_takes_over_when_the_first_has_gone(recorded: Recorded) -> None:
    first = recorded.pids["pd_feedforward"]
    recorded.ask("start")
    recorded.until(lambda: recorded.state.tick > 30)
    before = recorded.statuses["pd_feedforward"].instance
    recorded.start("pd_feedforward", CONTROLLER, **GAINS)
    recorded.until(lambda: "this one is silent" in recorded.log("pd_feedforward"))
    os.kill(first, signal.SIGKILL)
    recorded.until(
        lambda: recorded.ready and recorded.statuses["pd_feedforward"].instance != before
    )
    recorded.until(lambda: recorded.statuses["pd_feedforward"].last_tick > 200)
    recorded.end("plant")
    recorded.until(lambda: not recorded.runs("recorder"))
    began = [e.kind for e in BagReader(recorded.bag).overview.events].count("began")
    assert began in (1, 2)  # once more where a question came before the plan
    assert resim(recorded.bag).identical


def test_a_recorder_that_is_killed_and_started_again_goes_on_in_its_bag(recorded: Recorded) -> None:
    recorded.ask("start")
    recorded.until(lambda: recorded.state.tick > 50)
    recorded.end("recorder", signal.SIGKILL)
    recorded.start("recorder", RECORDER, folder=str(recorded.bag), exit_with_plant="true")
    recorded.until(lambda: recorded.log("recorder").count("recording into") == 2)
    tick = recorded.state.tick
    recorded.until(lambda: recorded.state.tick > tick + 100)
    recorded.end("plant")
    recorded.until(lambda: not recorded.runs("recorder"))
    events = BagReader(recorded.bag).overview.events
    assert [event.kind for event in events].count("started") == 1
    again = resim(recorded.bag)
    assert set(again.largest.values()) == {0.0}
    assert "in between are missing" in again.missing
