"""A program as the plant: what it answers, and every way in which it can break the protocol."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.errors import BadInput
from flexslew_plant.events import PlantLost, WallTimes
from flexslew_plant.measurement import EffortCommand
from flexslew_plant.own_code import ANY_CODE, NO_CODE, Trust, Untrusted
from flexslew_plant.settings import plain
from flexslew_plant.testbeds import read_testbed

PROGRAM = str(Path(__file__).parent / "faulty_plant.py")
TIMEOUT = 0.5  # of an answer, for the one that hangs [wall s]


def section(way: str = "", **keys: Any) -> dict[str, Any]:
    return {"kind": "external", "command": [sys.executable, PROGRAM, way], **keys}


def bench_of(way: str = "", **keys: Any) -> Bench:
    testbed = read_testbed(section(way, answer_timeout=TIMEOUT, **keys), "t", ANY_CODE)
    return Bench(BenchSettings(testbed=testbed, duration=0.1))


def fly(bench: Bench, effort: float = 2.0) -> list[float]:
    readings = []
    while not bench.done:
        question = bench.question
        readings.append(float(question.joint_position[0]))
        numbers = np.array([effort])
        bench.offer(EffortCommand(question.tick, question.epoch, question.controller, numbers))
        bench.advance()
    return readings


def test_efforts_go_out_and_measurements_come_back_tick_by_tick() -> None:
    bench = bench_of()
    assert fly(bench) == [2.0 * tick for tick in range(10)]
    assert bench.truth().tip_deflection == pytest.approx([2.0])
    bench.close()


def test_a_reset_begins_the_next_epoch_at_the_start() -> None:
    bench = bench_of()
    first = fly(bench)
    bench.reset()
    assert (bench.question.epoch, fly(bench)) == (1, first)
    bench.close()


def test_a_closed_bench_starts_the_program_again() -> None:
    bench = bench_of()
    first = fly(bench)
    bench.close()
    bench.reset()
    assert fly(bench) == first
    bench.close()


@pytest.mark.parametrize(
    ("way", "words"),
    [
        ("exit", "its process exited with 4 (tick 3 of epoch 0)"),
        ("hang", "no answer within 0.5 s (tick 3 of epoch 0)"),
        ("print", "b'debug: tick 3' on its standard output is no frame; print to stderr"),
        ("error", "reports: the motor is too hot"),
        ("tick", "answered tick 4 of epoch 0; tick 3 of epoch 0 is due"),
        ("epoch", "answered tick 3 of epoch 1; tick 3 of epoch 0 is due"),
        ("nan", "its measurement of tick 3: number 0 is nan; all must be finite"),
        ("size", "its measurement of tick 3: a body of 23 bytes; 3 numbers are 24"),
        ("kind", "sent a message of kind 2; 5 (MEASUREMENT) is due"),
    ],
)
def test_a_plant_that_breaks_the_protocol_ends_the_run_with_its_fault(way: str, words: str) -> None:
    bench = bench_of(way)
    assert len(fly(bench)) == 3  # ticks 0 to 2 were answered
    assert words in bench.failure
    (fault,) = [e.what for e in bench.events if isinstance(e.what, PlantLost)]
    assert (fault.tick, bench.faulted, bench.truth().tick) == (2, True, 2)
    bench.close()


@pytest.mark.parametrize(
    ("way", "words"),
    [
        ("unit", "its description: joints.0.unit: 'deg'; allowed: rad, m"),
        ("protocol", "its description: protocol 9; 1 is supported"),
        ("key", "its description: colour: unknown key; allowed: protocol, name, joints"),
        ("json", "its description: a body that is no JSON"),
    ],
)
def test_a_wrong_description_is_refused_in_one_line(way: str, words: str) -> None:
    with pytest.raises(BadInput, match="command") as refused:
        read_testbed(section(way), "t", ANY_CODE)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_program_that_a_log_names_is_started_only_by_trust() -> None:
    command = " ".join([sys.executable, PROGRAM, "exit"])
    with pytest.raises(Untrusted, match=r"refused to run .* --trust"):
        read_testbed(section("exit"), "t", NO_CODE)
    assert read_testbed(section("exit"), "t", Trust.of([command])).kind == "external"


def test_a_described_section_is_read_without_the_program_and_compared_at_the_start() -> None:
    whole = plain(read_testbed(section(), "t", ANY_CODE))
    whole["command"] = ["no_such_program"]
    assert read_testbed(whole, "t", ANY_CODE).model().joint_names == ("hub",)
    other = read_testbed({**whole, **section(), "joints": ["base"]}, "t", ANY_CODE)
    with pytest.raises(BadInput, match=r"testbed: joints: .*describes \('hub',\)"):
        Bench(BenchSettings(testbed=other, duration=0.1))


def test_what_needs_equations_is_refused_and_names_the_remedy() -> None:
    model = read_testbed(section(), "t", ANY_CODE).model()
    for call in (
        lambda: model.linearise(np.zeros(2)),
        lambda: model.mass_matrix(np.zeros(2)),
        lambda: model.advance(np.zeros(4), np.zeros(1), 0.01),
        lambda: model.rates,
        lambda: model.kernels.compiled,
    ):
        with pytest.raises(BadInput, match=r"black box without equations; .*model: "):
            call()


def test_the_process_ends_with_its_bench() -> None:
    bench = bench_of()
    plant: Any = bench._plant
    process = plant._transport._process
    bench.close()
    assert process.poll() == 0


def test_a_program_with_a_clock_of_its_own_paces_the_bench_and_is_braked() -> None:
    command = [sys.executable, str(Path(PROGRAM).with_name("own_clock_plant.py"))]
    keys = {"watchdog": 1000, "max_missed": 1000}  # on a busy machine
    testbed = read_testbed({"kind": "external", "command": command, **keys}, "t", ANY_CODE)
    bench = Bench(BenchSettings(testbed=testbed, duration=0.5, period=0.02, active="a"))
    assert fly(bench) == list(range(25))
    bench.finish(0.5)
    assert not bench.failure
    times = [event.what for event in bench.events if isinstance(event.what, WallTimes)]
    assert [one.quantity for one in times] == ["response", "interval"]
    bench.reset()
    assert fly(bench)[:3] == [0.0, 1.0, 2.0]
    plant: Any = bench._plant
    process = plant._link._transport._process
    bench.close()
    assert process.poll() == 0
