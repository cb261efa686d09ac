"""Hardware in the loop over ROS nodes: a board's law, and a plant with a clock of its own."""

import json
import os
import signal
from pathlib import Path
from typing import Any

import pytest

from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.events import WallTimes
from flexslew_plant.external.messages import MessageKind, decoded
from flexslew_plant.own_code import ANY_CODE
from flexslew_plant.serial_line.exchange import LARGEST, SESSION
from flexslew_plant.serial_line.frames import Deframer
from tests.control.test_external_controller import LAW, TRIAL
from tests.lab.run.test_serial_plant import PATIENT, RIG, facts
from tests.lab.run.test_serial_plant import TRIAL as RIG_TRIAL
from tests.plant.serial_line.lines import bridged, built

from .flight import Flight, patient

pytestmark = pytest.mark.ros
pytest.importorskip("serial", reason="pyserial is not installed: ./flexslew extras serial")


def rig_trial(port: str, duration: float) -> Any:
    testbed = json.dumps({"kind": "external", "serial": port, **PATIENT})
    text = RIG_TRIAL.format(testbed=testbed, duration=duration, rate=0.0) + "max_missed: 50\n"
    return parse_trial(text, "test", ANY_CODE)


def test_a_board_flies_as_a_node_as_the_law_in_python_does_in_process(tmp_path: Path) -> None:
    hashes = []
    with bridged([str(built(tmp_path))]) as (port, _):
        for k, one in enumerate((f"{{law: {LAW}, port: {port}}}", "{law: pd_feedforward}")):
            trial = patient(parse_trial(TRIAL.format(one=one), "t.yaml", ANY_CODE))
            folder = tmp_path / str(k)
            result = run_trial(trial, "t.yaml", folder, in_process=k == 1, report=False)
            assert result.metrics["fallbacks"] == 0, result.message
            hashes.append(result.metrics["trajectory_hash"])
    assert hashes[0] == hashes[1]


class LastKind:
    """Kind of the last message of a rig, with which it has stopped."""

    def __init__(self) -> None:
        self._deframer, self.kind = Deframer(LARGEST), 0

    def watch(self, data: bytes) -> None:
        for frame in self._deframer.take(data):
            self.kind = decoded(frame[SESSION.size :]).kind


def test_a_rig_paces_the_nodes_and_is_braked_at_the_end(tmp_path: Path) -> None:
    last = LastKind()
    with bridged(RIG, watch=last.watch) as (port, process):
        result = run_trial(rig_trial(port, 4.0), "test", tmp_path / "run", report=False)
        assert (result.metrics["ticks"], result.metrics["fallbacks"]) == (200, 0), result.message
        response, interval = facts(tmp_path / "run", WallTimes)
        assert (response.quantity, interval.quantity) == ("response", "interval")
        assert process.poll() is None
    assert last.kind == MessageKind.BRAKE  # not ERROR: its own watchdog had nothing to do


def test_an_interrupt_brakes_the_rig(tmp_path: Path) -> None:
    last = LastKind()
    with bridged(RIG, watch=last.watch) as (port, _):
        flight = Flight(
            rig_trial(port, 1000.0),
            tmp_path,
            at=50,
            act=lambda pids, domain: os.kill(os.getpid(), signal.SIGINT),
        )
        assert flight.outcome.exit_code == 130, flight.log
    assert last.kind == MessageKind.BRAKE
