"""Question and answer past DDS: the same bits, the same log, whoever is asked in which way."""

import os
import signal
from pathlib import Path
from threading import Timer
from typing import Any

import pytest
from flexslew_msgs.srv import SetRate

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.replay.resim import resim
from flexslew_plant.direct.names import SETTING

from .bystander import Bystander, beside
from .flight import Flight, fork_server, kill, slew
from .lines import Strangers, alone, asked, every_tick, over_dds, whole

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


def test_two_swaps_give_the_same_bits_and_a_whole_log(transport: str, tmp_path: Path) -> None:
    trial = slew(more=", lqr: {}", extra=SWAPS)
    flight = Flight(trial, tmp_path)
    assert flight.outcome == (0, ""), flight.log
    assert flight.metrics["trajectory_hash"] == alone(trial, tmp_path)
    assert (flight.metrics["switches"], flight.metrics["missed_ticks"]) == (2, 0)
    whole(flight.bag, 600)
    if transport == "auto":
        assert asked(flight.bag).keys() == {"pd_feedforward", "lqr"}
        assert all("socket" in ways for ways in asked(flight.bag).values())
    else:
        assert not any("socket" in ways for ways in asked(flight.bag).values())


@pytest.mark.usefixtures("chosen")
@pytest.mark.parametrize("remote", ["lqr", "pd_feedforward"])
def test_swaps_pass_between_a_line_and_dds(remote: str, tmp_path: Path) -> None:
    trial = slew(more=", lqr: {}", extra=SWAPS)
    flight = Flight(trial, tmp_path, change=over_dds([remote]))
    assert flight.outcome == (0, ""), flight.log
    assert flight.metrics["trajectory_hash"] == alone(trial, tmp_path)
    assert (flight.metrics["switches"], flight.metrics["missed_ticks"]) == (2, 0)
    whole(flight.bag, 600)
    assert "socket" not in asked(flight.bag).get(remote, set())
    (other,) = {"lqr", "pd_feedforward"} - {remote}
    assert "socket" in asked(flight.bag)[other]


@pytest.mark.usefixtures("chosen")
def test_strangers_on_the_plant_s_socket_change_nothing(tmp_path: Path) -> None:
    strangers = Strangers("/effort_command")

    def act(pids: dict[str, int], domain: int) -> None:
        lies = b"\0\1\0\0" + bytes(40)
        strangers.call(domain)  # never says a word
        strangers.call(domain, os.urandom(3000))
        strangers.call(domain, b'{"controller": "pd_feedforward"}', b'{"answers": true}', b"?")
        strangers.call(domain, b'{"controller": "somebody"}')  # never reads, never answers
        strangers.call(domain, b'{"controller": "liar"}', b'{"answers": true}', lies)

    trial = slew(duration=40.0)
    flight = Flight(trial, tmp_path, 0, act)
    strangers.close()
    assert flight.outcome == (0, ""), flight.log
    assert len(strangers.lines) == 5
    assert flight.metrics["trajectory_hash"] == alone(trial, tmp_path)
    assert flight.metrics["missed_ticks"] == 0
    every_tick(flight.bag, 4000)


@pytest.mark.parametrize("who", ["pd_feedforward", "plant", "recorder"])
def test_a_process_that_is_stopped_for_a_moment_goes_on(
    transport: str, who: str, tmp_path: Path
) -> None:
    def stop(pids: dict[str, int], domain: int) -> None:
        os.kill(pids[who], signal.SIGSTOP)
        Timer(0.5, os.kill, (pids[who], signal.SIGCONT)).start()

    trial = slew(duration=100.0)
    flight = Flight(trial, tmp_path, 20, stop)
    assert flight.outcome == (0, ""), flight.log
    assert flight.metrics["missed_ticks"] == 0
    assert flight.metrics["trajectory_hash"] == alone(trial, tmp_path)
    assert flight.metrics["log_complete"]
    assert transport == "auto" or "socket" not in asked(flight.bag).get("pd_feedforward", set())


def test_a_fallback_on_either_transport_takes_over_from_the_killed(
    transport: str, tmp_path: Path
) -> None:
    trial = slew(120.0, more=", second: {law: pd_feedforward}", extra="fallback: [second]",
                 patience=0.5)  # fmt: skip
    flight = Flight(trial, tmp_path, 30, kill("pd_feedforward"))
    assert flight.outcome.exit_code == 3
    assert "fallback" in flight.events
    assert "brake" not in flight.events
    assert flight.metrics["ticks"] == 12000
    assert resim(flight.bag).identical
    events = BagReader(flight.bag).overview.events
    (taken,) = (event.tick for event in events if event.kind == "fallback")
    told = [event for event in events if event.kind == "transport" and event.tick > taken]
    assert "pd_feedforward" not in {event.data["controller"] for event in told}  # who is dead
    assert transport == "auto" or not any("socket" in w for w in asked(flight.bag).values())


def test_a_controller_that_was_killed_comes_back_and_is_swapped_in(
    transport: str, tmp_path: Path
) -> None:
    born: list[int] = []

    def act(pids: dict[str, int], domain: int) -> None:
        os.kill(pids["lqr"], signal.SIGKILL)
        with beside(domain) as one:
            born.append(_again(tmp_path, domain))
            _swapped(one)

    trial = slew(duration=100.0, rate=1.0, more=", lqr: {}")
    flight = Flight(trial, tmp_path, 20, act)
    assert flight.outcome.exit_code == 3  # somebody was killed
    assert "lqr ended" in flight.outcome.message
    assert flight.events.count("switched") == 2
    assert "stray" not in flight.events
    assert flight.metrics["log_complete"]
    assert resim(flight.bag).identical
    assert fork_server().exit_code(born[0]) in (None, 0)


@pytest.mark.usefixtures("chosen")
def test_a_controller_comes_back_as_often_as_it_is_killed(tmp_path: Path) -> None:
    """Each time it takes the ports of the dead one, to which the others still send."""
    times = 20
    shared: list[bool] = []

    def act(pids: dict[str, int], domain: int) -> None:
        lqr = pids["lqr"]
        with beside(domain) as one:
            for _ in range(times):
                os.kill(lqr, signal.SIGKILL)
                lqr = _again(tmp_path, domain)
                one.swap("lqr")
                one.swap("pd_feedforward")
            nodes = lqr, pids["plant"], pids["recorder"], pids["planner"]
            maps = (Path(f"/proc/{pid}/maps").read_text() for pid in nodes)
            shared.extend("/dev/shm/fastdds" in text for text in maps)
            assert one.ask(SetRate, "set_rate", rate_factor=0.0).ok

    flight = Flight(slew(duration=300.0, rate=1.0, more=", lqr: {}"), tmp_path, 20, act)
    assert flight.events.count("switched") >= 2 * times, flight.log
    assert flight.metrics["log_complete"]
    assert shared == [False] * 4  # UDP alone: profiles/loopback.xml says why


def _again(folder: Path, domain: int) -> int:
    """Start the controller lqr of a flight once more; return its process id."""
    arguments = ["--ros-args", "--params-file", str(folder / "parameters.yaml"),
                 "-r", "__node:=lqr"]  # fmt: skip
    with (folder / "again.log").open("ab") as said:
        return fork_server().start(
            "flexslew_control.ros.controller_node", arguments, {"ROS_DOMAIN_ID": str(domain)},
            said.fileno(),
        )  # fmt: skip


def _swapped(one: Bystander) -> None:
    one.swap("lqr")
    one.pass_by(100)
    one.swap("pd_feedforward")
    assert one.ask(SetRate, "set_rate", rate_factor=0.0).ok  # the rest as fast as it goes
