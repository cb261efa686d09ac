"""A program or a board in the loop flies a trial as the bench's own law does."""

import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from tests.plant.serial_line.lines import bridged, built

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.replay.resim import resim
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.own_code import user_file_hashes
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.errors import BadInput
from flexslew_plant.events import WallTimes
from flexslew_plant.own_code import ANY_CODE, Trust, Untrusted

LAW = "flexslew_control.external_controller.ExternalController"
EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "external_controller.py"
# what it does wrong at its first measurement, in place of its efforts
FAULTS = {
    "raise SystemExit(3)": "its process exited with 3",
    "write(EFFORT, epoch, tick + 1, bytes(8 * joints))": "answered tick 1 of epoch 0",
    "write(EFFORT, epoch, tick, bytes(8))": "its efforts of tick 0 of epoch 0",
    "write(EFFORT, epoch, tick, struct.pack('<2d', 0.0, float('nan')))": "finite",
    "write(7, epoch, tick, b'lost')": "reports: lost",
    "print('here', flush=True)": "print to stderr",
    "sys.stdin.read()": "no answer within 0.5 s",
}
TRIAL = """
duration: 2.0
testbed: {{kind: csa}}
plan: {{method: reference_only, goal: {{base_yaw: 0.005, hub_pitch: 0.002}}, duration: 1.5}}
controllers:
  one: {one}
  pd_feedforward: {{}}
active: one
fallback: [pd_feedforward]
"""


def test_a_board_in_c_flies_a_trial_as_the_law_in_python_does(tmp_path: Path) -> None:
    pytest.importorskip("serial", reason="pyserial is not installed: ./flexslew extras serial")
    hashes = []
    with bridged([str(built(tmp_path))]) as (port, _):
        board = f"{{law: {LAW}, port: {port}}}"
        for k, one in enumerate((board, board, "{law: pd_feedforward}")):
            trial = parse_trial(TRIAL.format(one=one), "t.yaml", ANY_CODE)
            result = run_trial(trial, "t.yaml", tmp_path / str(k), in_process=True, report=False)
            assert result.metrics["fallbacks"] == 0, result.message
            events = BagReader(tmp_path / str(k) / "bag").overview.events
            times = [event.what for event in events if isinstance(event.what, WallTimes)]
            assert [one.steps for one in times] == ([64, 128] if k < 2 else [])
            assert {one.quantity for one in times} <= {"controller"}
            hashes.append(result.metrics["trajectory_hash"])
    assert hashes[0] == hashes[1] == hashes[2]


def test_a_port_that_is_not_there_is_a_fault_with_its_reason(tmp_path: Path) -> None:
    pytest.importorskip("serial", reason="pyserial is not installed: ./flexslew extras serial")
    one = f"{{law: {LAW}, port: {tmp_path}/ttyX}}"
    trial = parse_trial(TRIAL.format(one=one), "t.yaml", ANY_CODE)
    result = run_trial(trial, "t.yaml", tmp_path / "run", in_process=True, report=False)
    assert result.exit_code == 3
    assert "cannot be opened" in result.message
    assert result.metrics["fallbacks"] == 1


@pytest.mark.parametrize("language", ["python", "c"])
def test_a_program_flies_as_the_law_in_python_does_and_again_from_its_log(
    language: str, tmp_path: Path
) -> None:
    command = [sys.executable, str(EXAMPLE)]
    if language == "c":
        command = [str(tmp_path / "external_controller_c")]
        flags = ["-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror"]
        source = str(EXAMPLE.with_suffix(".c"))
        subprocess.run(["cc", *flags, source, "-o", *command], check=True)
    hashes = []
    for k, one in enumerate((f"{{law: {LAW}, command: {command}}}", "{law: pd_feedforward}")):
        trial = parse_trial(TRIAL.format(one=one), "t.yaml", ANY_CODE)
        result = run_trial(trial, "t.yaml", tmp_path / str(k), in_process=True, report=False)
        assert result.metrics["fallbacks"] == 0, result.message
        hashes.append(result.metrics["trajectory_hash"])
        if k == 0:
            assert user_file_hashes(trial)[shlex.join(command)]
    assert hashes[0] == hashes[1]
    bag = tmp_path / "0" / "bag"
    with pytest.raises(Untrusted, match=r"refused to run .*external_controller.*--trust"):
        resim(bag, trust=Trust.of([LAW]))  # a class that starts what it is told to start
    assert resim(bag, trust=Trust.of([LAW, shlex.join(command)])).identical


@pytest.mark.parametrize("fault", FAULTS)
def test_a_program_that_fails_leaves_the_flight_to_its_fallback(fault: str, tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    efforts = (
        'write(EFFORT, epoch, tick, struct.pack(f"<{joints}d", *efforts(numbers, joints, tips)))'
    )
    text = EXAMPLE.read_text()
    assert efforts in text
    program.write_text(text.replace(efforts, fault))
    one = f"{{law: {LAW}, command: [{sys.executable}, {program}], timeout: 0.5}}"
    trial = parse_trial(TRIAL.format(one=one), "t.yaml", ANY_CODE)
    result = run_trial(trial, "t.yaml", tmp_path / "run", in_process=True, report=False)
    assert (result.exit_code, result.metrics["fallbacks"]) == (3, 1), result.message
    assert FAULTS[fault] in result.message


@pytest.mark.parametrize("keys", ["", ", command: [a], port: b"])
def test_there_is_one_way_to_an_external_controller(keys: str, tmp_path: Path) -> None:
    trial = parse_trial(TRIAL.format(one=f"{{law: {LAW}{keys}}}"), "t.yaml", ANY_CODE)
    with pytest.raises(BadInput, match="give either a program or a serial port"):
        run_trial(trial, "t.yaml", tmp_path / "run", in_process=True, report=False)
    assert not (tmp_path / "run").exists()
