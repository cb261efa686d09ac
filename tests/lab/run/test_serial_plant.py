"""A flight whose plant is a device on a serial line, in lock-step or with a clock of its own."""

import json
import re
import shlex
import sys
from pathlib import Path
from threading import Timer
from typing import Any

import numpy as np
import pytest
from tests.lab.console.test_in_process import operated
from tests.plant.serial_line.lines import BadLine, bridged

from flexslew_lab.cli.main import main
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.replay.resim import resim
from flexslew_lab.run.run_trial import Result, run_trial
from flexslew_lab.trial.trial import Trial, checked_trial, parse_trial
from flexslew_plant.errors import BadInput
from flexslew_plant.events import PlantLost, PlantTicksMissed, WallTimes
from flexslew_plant.external.plant_rules import PlantRules
from flexslew_plant.own_code import ANY_CODE, NO_CODE, Trust, Untrusted
from flexslew_plant.serial_line.port import SerialPort
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.black_box.plant_address import PlantAddress

pytest.importorskip("serial", reason="pyserial is not installed: ./flexslew extras serial")
EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"
DEVICE = [sys.executable, str(EXAMPLES / "serial_plant.py")]
RIG = [*DEVICE, "--own-clock", "--watchdog", "300"]
PROGRAM = [sys.executable, str(EXAMPLES / "external_plant.py")]
TRIAL = """
name: serial
duration: {duration}
period: 0.02
rate_factor: {rate}
testbed: {testbed}
plan:
  method: reference_only
  goal: {{hub: 0.01}}
  duration: 1.0
  model: {{kind: identified, modes: 0}}
controllers: {{pd_feedforward: {{kp: 40.0, kd: 80.0}}}}
"""


def trial_of(duration: float, rate: float = 0.0, **keys: Any) -> Trial:
    testbed = json.dumps({"kind": "external", **keys})
    text = TRIAL.format(testbed=testbed, duration=duration, rate=rate)
    return checked_trial(parse_trial(text, "test", ANY_CODE), "test")


def fly(folder: Path, duration: float = 2.0, rate: float = 0.0, **keys: Any) -> Result:
    """Fly a trial in process."""
    trial = trial_of(duration, rate, **keys)
    return run_trial(trial, "test", folder, in_process=True, report=False)


def facts(folder: Path, kind: type[Any]) -> list[Any]:
    """Return the facts of a kind in the log of a run."""
    events = BagReader(folder / "bag").overview.events
    return [event.what for event in events if isinstance(event.what, kind)]


def spoil_line(monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator, share: float) -> None:
    """Let the bench open a line that loses, damages, repeats and delays."""

    def opened(device: str, baud: int) -> BadLine:
        return BadLine(SerialPort(device, baud), rng, share)

    monkeypatch.setattr(f"{PlantAddress.__module__}.SerialPort", opened)


def test_a_plant_on_a_bad_line_flies_as_a_program_does_to_the_bit(
    tmp_path: Path, case: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = fly(tmp_path / "program", command=PROGRAM)
    with bridged(DEVICE) as (port, _):
        spoil_line(monkeypatch, case, 0.2)
        device = fly(tmp_path / "device", serial=port)
    assert device.metrics["trajectory_hash"] == program.metrics["trajectory_hash"]
    (times,) = facts(tmp_path / "device", WallTimes)
    assert (times.quantity, times.steps) == ("step", 100)
    assert 0.0 < times.least <= times.median <= times.late <= times.longest


def test_resim_opens_the_port_again_once_it_is_trusted(tmp_path: Path) -> None:
    with bridged(DEVICE) as (port, _):
        fly(tmp_path / "run", serial=port)
        with pytest.raises(Untrusted, match=r"refused to run .*--trust"):
            resim(tmp_path / "run" / "bag")
        again = resim(tmp_path / "run" / "bag", trust=Trust.of([shlex.join([port])]))
    assert (again.identical, again.ticks) == (True, 101)


def test_a_device_that_dies_ends_the_run_with_a_whole_log(tmp_path: Path) -> None:
    with bridged(DEVICE) as (port, process):
        Timer(1.0, process.kill).start()
        result = fly(tmp_path / "run", 1000.0, serial=port, answer_timeout=0.5)
    assert result.exit_code == 3
    (lost,) = facts(tmp_path / "run", PlantLost)
    assert "no answer within 0.5 s" in lost.cause
    assert result.metrics["log_complete"]


PATIENT = {"watchdog": 1000, "max_missed": 1000}  # on a busy machine


def test_a_rig_paces_the_run_by_its_own_clock(tmp_path: Path) -> None:
    with bridged(RIG) as (port, process):
        for name in ("first", "second"):  # the brake ends the first run, a reset begins the second
            metrics = fly(tmp_path / name, serial=port, **PATIENT).metrics
            assert (metrics["ticks"], metrics["missing_ticks"]) == (100, 0)
            response, interval = facts(tmp_path / name, WallTimes)
            assert (response.quantity, interval.quantity) == ("response", "interval")
            assert metrics["plant_step_time"] == response.median
        with pytest.raises(BadInput, match="a rig moves only for a trial"):
            resim(tmp_path / "first" / "bag", trust=ANY_CODE)
        assert process.poll() is None


FEEDFORWARD = """
name: feedforward
duration: 2.0
period: 0.02
testbed: {testbed}
plan:
  method: optimized_feedforward
  goal: {{hub: 0.002}}
  duration: 1.5
  model:
    kind: identified
    inertia: [[120.0]]
    free_modes: [{{frequency: 2.4, damping_ratio: 0.01, joints: [-0.06], tips: [0.48]}}]
controllers: {{pd_feedforward: {{kp: 40.0, kd: 80.0}}}}
"""


def test_a_report_flies_a_rig_once_and_a_program_again_without_feedforward(tmp_path: Path) -> None:
    again = []
    with bridged(RIG) as (port, _):
        plants: tuple[dict[str, Any], ...] = ({"serial": port, **PATIENT}, {"command": PROGRAM})
        for k, keys in enumerate(plants):
            testbed = json.dumps({"kind": "external", **keys})
            trial = parse_trial(FEEDFORWARD.format(testbed=testbed), "test", ANY_CODE)
            result = run_trial(trial, "test", tmp_path / str(k), in_process=True)
            assert (tmp_path / str(k) / "report.html").exists(), result.message
            again.append(bool(result.bare_metrics))
    assert again == [False, True]


def test_an_operator_brakes_a_rig_which_ends_its_run(tmp_path: Path) -> None:
    with bridged(RIG) as (port, process):
        trial = trial_of(1000.0, serial=port, **PATIENT)
        with operated(tmp_path / "run", given=trial) as operator:
            operator.act("start")
            operator.until(lambda: operator.link.view.truth.time.size > 50)
            assert "the plant has a clock of its own" in operator.act("pause").message
            assert operator.act("brake").ok
            operator.at("finished")
        assert process.poll() is None
    (lost,) = facts(tmp_path / "run", PlantLost)
    assert lost.cause == "no controller is active; its brake is on"


def test_lost_measurements_are_missed_ticks_in_the_log(
    tmp_path: Path, case: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    with bridged(RIG) as (port, _):
        spoil_line(monkeypatch, case, 0.1)
        metrics = fly(tmp_path / "run", serial=port, **PATIENT).metrics
    missed = facts(tmp_path / "run", PlantTicksMissed)
    assert sum(one.lost for one in missed) > 0
    assert metrics["plant_missed_ticks"] == sum(one.lost + one.late for one in missed)
    assert (metrics["ticks"], metrics["missing_ticks"]) == (100, 0)


def test_a_silent_rig_ends_the_run_by_the_watchdog(tmp_path: Path) -> None:
    with bridged(RIG) as (port, process):
        Timer(1.0, process.kill).start()
        result = fly(tmp_path / "run", 1000.0, serial=port, max_missed=1000, watchdog=100)
    assert result.exit_code == 3
    (lost,) = facts(tmp_path / "run", PlantLost)
    assert "no measurement for 2 s after tick" in lost.cause
    assert lost.cause.endswith("its brake is not acknowledged")
    assert result.metrics["log_complete"]


def test_a_rig_under_another_clock_is_refused(tmp_path: Path) -> None:
    words = "rate_factor: 1.0 is not allowed: the testbed has a clock of its own"
    with bridged(RIG) as (port, _), pytest.raises(BadInput, match=re.escape(words)):
        fly(tmp_path / "paced", serial=port, rate=1.0)


def test_a_section_names_a_command_or_a_port() -> None:
    for keys in ({}, {"command": PROGRAM, "serial": "/dev/ttyX"}):
        with pytest.raises(BadInput, match="either `command` or `serial`"):
            read_testbed({"kind": "external", "joints": ["hub"], **keys}, "t", ANY_CODE)
    with pytest.raises(BadInput, match=r"serial: '/dev/ttyX' is not allowed: cannot be opened"):
        read_testbed({"kind": "external", "serial": "/dev/ttyX"}, "t", ANY_CODE)
    with pytest.raises(Untrusted, match=r"--trust /dev/ttyX"):
        read_testbed({"kind": "external", "serial": "/dev/ttyX"}, "t", NO_CODE)


@pytest.mark.parametrize(("command", "rules"), [(DEVICE, 7), (RIG, 5)])
def test_conform_examines_a_plant_by_its_port(
    command: list[str],
    rules: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with bridged(command) as (port, _):
        words = ["flexslew", "conform", "--plant", "--json", "--serial", port]
        monkeypatch.setattr(sys, "argv", words)
        with pytest.raises(SystemExit) as end:
            main()
    written = capsys.readouterr()
    assert not end.value.code
    assert [one["wrong"] for one in json.loads(written.out)] == [""] * rules
    assert "steps: shortest" in written.err


def test_a_rig_without_a_watchdog_breaks_its_rule() -> None:
    with bridged([*DEVICE, "--own-clock", "--watchdog", "1000000"]) as (port, _):
        rules = PlantRules(PlantAddress(serial=port, timeout=2.0).connect).check()
    assert [rule.wrong for rule in rules] == [
        *[""] * 4,
        "it still measures after 2 s without efforts",
    ]
