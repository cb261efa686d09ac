"""Question and answer past DDS: the same bits, the same log, whoever is asked in which way."""

import os
import signal
from pathlib import Path
from threading import Event
from typing import Any

import pytest

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.replay.check import check
from flexslew_lab.replay.resim import resim
from flexslew_plant.direct.inbox import PART
from flexslew_plant.direct.names import RECORDER, SETTING
from flexslew_plant.message_codec import HEAD

from .bystander import beside, stall
from .flight import LONG, Flight, again, fork_server, kill_in_flight, slew
from .lines import Strangers, alone, asked, every_tick, over_dds, whole
from .one_by_one import CONTROLLER

SWAPS = "schedule: [{at: 1.5, switch: lqr}, {at: 3.0, switch: pd_feedforward}]"


@pytest.fixture(params=["auto", "dds"])
def transport(request: Any, monkeypatch: pytest.MonkeyPatch) -> str:
    """Let all nodes of a test choose by themselves, or take DDS alone."""
    monkeypatch.setenv(SETTING, request.param)
    return str(request.param)


@pytest.fixture
def chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let all nodes of a test choose by themselves."""
    monkeypatch.setenv(SETTING, "auto")


LAWS = ", output_feedback: {}, proportional_integral: {}, lqr: {}, collocated_pid: {}"
FOUR_SWAPS = """
schedule:
  - {at: 1.5, switch: output_feedback}
  - {at: 3.0, switch: proportional_integral}
  - {at: 3.5, until: 5.0, disturbance: {base_yaw: 5.0}}
  - {at: 4.5, switch: lqr}
  - {at: 5.5, switch: collocated_pid}
"""


@pytest.mark.first(1)
def test_five_laws_and_four_swaps_give_the_same_bits_and_a_whole_log(
    transport: str, tmp_path: Path
) -> None:
    """The lock-step of every law: hash of the run in process, log, resimulation and check."""
    trial = slew(duration=7.0, more=LAWS, extra=FOUR_SWAPS)
    flight = Flight(trial, tmp_path)
    assert flight.outcome == (0, ""), flight.log
    metrics, ways = flight.metrics, asked(flight.bag)
    assert metrics["trajectory_hash"] == alone(trial, tmp_path)
    assert (metrics["ticks"], metrics["switches"]) == (700, 4)
    assert (metrics["missed_ticks"], metrics["missing_ticks"]) == (0, 0)
    assert metrics["wall_time"] > 0.0
    assert metrics["largest_effort_step"] < 1.5  # 1 % of the limit
    whole(flight.bag, 700)
    assert check(flight.bag, "lqr").ok
    if transport == "auto":
        assert ways.keys() == {*trial.controllers}
        assert all("socket" in each for each in ways.values())
    else:
        assert not any("socket" in each for each in ways.values())


@pytest.mark.ros
@pytest.mark.usefixtures("chosen")
def test_swaps_pass_between_a_line_and_dds(tmp_path: Path) -> None:
    trial = slew(more=", lqr: {}", extra=SWAPS)
    flight = Flight(trial, tmp_path, change=over_dds(["lqr"]))
    assert flight.outcome == (0, ""), flight.log
    assert flight.metrics["trajectory_hash"] == alone(trial, tmp_path)
    assert (flight.metrics["switches"], flight.metrics["missed_ticks"]) == (2, 0)
    whole(flight.bag, 600)
    assert "socket" not in asked(flight.bag).get("lqr", set())
    assert "socket" in asked(flight.bag)["pd_feedforward"]


@pytest.mark.ros
@pytest.mark.usefixtures("chosen")
def test_strangers_on_the_sockets_of_plant_and_recorder_change_nothing(tmp_path: Path) -> None:
    plant, recorder = Strangers("/effort_command"), Strangers(RECORDER)
    claim = b'{"topics": ["/measurement", "/truth", "/effort_command", "/events", "/tf"]}'
    headers = [(number, HEAD + bytes(size)) for number in range(5) for size in (0, 3, 12)]
    short = [PART.pack(number, len(data)) + data for number, data in headers]

    def act(pids: dict[str, int], domain: int) -> None:
        zeros = b"\0\1\0\0" + bytes(40)
        plant.call(domain, b'{"controller": "pd_feedforward"}', b'{"answers": true}', b"?")
        plant.call(domain, b'{"controller": "somebody"}')  # never reads, never answers
        plant.call(domain, b'{"controller": "liar"}', b'{"answers": true}', zeros)
        recorder.call(domain, claim, b"?")
        recorder.call(domain, claim, *short)
        recorder.call(domain, claim, PART.pack(3, len(HEAD) + 7) + HEAD + b"missed\0")
        for strangers in (plant, recorder):
            strangers.call(domain)  # sends nothing
            strangers.call(domain, os.urandom(3000))

    trial = slew(duration=40.0)
    flight = Flight(trial, tmp_path, 0, act)
    for strangers in (plant, recorder):
        strangers.close()
        assert len(strangers.lines) == 5
    assert flight.outcome == (0, ""), flight.log
    assert "left out of the log" in flight.log
    assert flight.metrics["trajectory_hash"] == alone(trial, tmp_path)
    assert flight.metrics["missed_ticks"] == 0
    every_tick(flight.bag, 4000)


@pytest.mark.ros
def test_processes_that_are_stopped_for_a_moment_go_on(transport: str, tmp_path: Path) -> None:
    def stop(pids: dict[str, int], domain: int) -> None:
        for name in ("pd_feedforward", "plant", "recorder"):
            stall(pids[name], 0.5)
            Event().wait(0.1)  # some hundred ticks

    trial = slew(duration=40.0)
    flight = Flight(trial, tmp_path, 0, stop)
    assert flight.outcome == (0, ""), flight.log
    assert flight.metrics["missed_ticks"] == 0
    assert flight.metrics["trajectory_hash"] == alone(trial, tmp_path)
    assert flight.metrics["log_complete"]
    assert transport == "auto" or "socket" not in asked(flight.bag).get("pd_feedforward", set())


@pytest.mark.slow
@pytest.mark.parametrize(
    "transport", ["auto", pytest.param("dds", marks=pytest.mark.ros)], indirect=True
)
def test_a_fallback_takes_over_from_the_killed(transport: str, tmp_path: Path) -> None:
    second = ", second: {law: pd_feedforward}"
    trial = slew(40.0, more=second, extra="fallback: [second]", patience=0.5)
    flight = Flight(trial, tmp_path, 0, kill_in_flight("pd_feedforward", tmp_path))
    assert flight.outcome.exit_code == 3
    assert "fallback" in flight.events
    assert "brake" not in flight.events
    assert flight.metrics["ticks"] == 4000
    assert resim(flight.bag).identical
    events = BagReader(flight.bag).overview.events
    (taken,) = (event.tick for event in events if event.kind == "fallback")
    told = [event for event in events if event.kind == "transport" and event.tick > taken]
    assert "pd_feedforward" not in {event.data["controller"] for event in told}  # who is dead
    assert transport == "auto" or not any("socket" in w for w in asked(flight.bag).values())


@pytest.mark.ros
def test_a_controller_comes_back_as_often_as_it_is_killed(transport: str, tmp_path: Path) -> None:
    """Each time it takes the ports of the dead one, to which the others still send."""
    times = 3
    shared: list[bool] = []
    born: list[int] = []

    def act(pids: dict[str, int], domain: int) -> None:
        born.append(pids["lqr"])
        with beside(domain) as one:
            for _ in range(times):
                os.kill(born[-1], signal.SIGKILL)
                born.append(again("lqr", CONTROLLER, tmp_path, domain))
                one.swap("lqr")
                one.swap("pd_feedforward")
            nodes = born[-1], pids["plant"], pids["recorder"], pids["planner"]
            maps = (Path(f"/proc/{pid}/maps").read_text() for pid in nodes)
            shared.extend("/dev/shm/fastdds" in text for text in maps)
        raise KeyboardInterrupt

    flight = Flight(slew(LONG, 1.0, ", lqr: {}", "max_missed: 100000"), tmp_path, 20, act)
    assert flight.outcome.exit_code == 130
    assert flight.events.count("switched") >= 2 * times, flight.log
    assert "stray" not in flight.events
    assert flight.metrics["log_complete"]
    assert resim(flight.bag).identical
    assert shared == [False] * 4  # UDP alone: profiles/loopback.xml says why
    assert fork_server().exit_code(born[-1]) in (None, 0)
