"""A healthy log of a bench that breaks, whatever breaks on it: the check finds nothing wrong."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.representatives import products

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.checks.check import check_log
from flexslew_lab.log.messages.cdr import decode, encode
from flexslew_lab.log.recording.bag_writer import BagWriter
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.faults import FAULTS
from flexslew_plant.yaml_data import yaml_text

NAMED = {
    "joint": "hub_pitch",
    "channel": "joint_velocity",
    "controller": "pd_feedforward",
}


def flown(folder: Path, kind: str, after: str = "[lqr]") -> Path:
    """Return the bag of a run in which this fault acts for a while."""
    entry = FAULTS[kind]
    keys = {k: v for k, v in NAMED.items() if k in entry.settings.__dataclass_fields__}
    fault = {"kind": kind, **keys, **entry.example}
    text = f"""
duration: 0.6
plan: {{method: none, goal: {{base_yaw: 0.01}}, duration: 0.2}}
controllers: {{pd_feedforward: {{}}, lqr: {{}}}}
active: pd_feedforward
fallback: {after}
max_missed: 5
allow_faults: true
schedule: {yaml_text([{"at": 0.1, "until": 0.3, "fault": fault}], flow=True)}
"""
    run_trial(parse_trial(text, "test"), "test", folder / "run", True, False)
    return folder / "run" / "bag"


@pytest.mark.parametrize(("kind", "after"), products(FAULTS, ["[lqr]", "[]"]))
def test_no_fault_makes_a_log_wrong(tmp_path: Path, kind: str, after: str) -> None:
    wrong = [f for f in check_log(flown(tmp_path, kind, after)) if not f.ok]
    assert not wrong


def changed(bag: Path, out: Path, topic: str, change: Callable[[dict[str, Any]], None]) -> Path:
    """Write the bag again with other messages on one topic."""
    reader = BagReader(bag)
    with BagWriter(out, reader.metadata) as writer:
        for name, kind, stamp, _, data in reader.messages():
            if name == topic:
                message = vars(decode(kind, data))
                change(message)
                data = encode(TOPICS[topic].type, message)
            writer.write(name, kind, data, stamp)
        writer.close({"messages": str(writer.messages)})
    return out


def wrong(bag: Path, topic: str) -> list[str]:
    return [f.detail for f in check_log(bag) if not f.ok and f.what == topic]


def test_a_reading_that_no_fault_explains_is_wrong(tmp_path: Path) -> None:
    """NaN before and after the fault, and in another channel than that of the fault."""

    def blind(message: dict[str, Any]) -> None:
        if message["tick"] in (5, 9, 10, 29, 30, 40):
            message["joint_velocity"] = np.full(2, np.nan)
        if message["tick"] == 20:
            message["joint_position"] = np.full(2, np.nan)

    bag = changed(flown(tmp_path, "sensor_nan"), tmp_path / "bag", "/measurement", blind)
    assert wrong(bag, "/measurement") == ["not finite: 10 numbers; NaN under a fault: 40 readings"]


def test_a_sensor_that_freezes_while_it_is_blind_stays_blind(tmp_path: Path) -> None:
    text = """
duration: 0.6
plan: {method: none, goal: {base_yaw: 0.01}, duration: 0.2}
controllers: {pd_feedforward: {}}
max_missed: 100
allow_faults: true
schedule:
  - {at: 0.1, until: 0.2, fault: {kind: sensor_nan, channel: joint_velocity}}
  - {at: 0.15, until: 0.4, fault: {kind: sensor_freeze, channel: joint_velocity}}
"""
    run_trial(parse_trial(text, "test"), "test", tmp_path / "run", True, False)
    columns = BagReader(tmp_path / "run" / "bag").columns("/measurement")
    assert np.isnan(columns["joint_velocity"][columns["tick"] == 30]).all()
    assert not wrong(tmp_path / "run" / "bag", "/measurement")


@pytest.mark.parametrize(
    ("topic", "name"),
    [
        ("/truth", "tip_deflection"),
        ("/measurement", "joint_position"),
        ("/effort_command", "effort"),
        ("/controller_state", "estimate_position"),
    ],
)
def test_an_array_that_changes_its_size_is_wrong(tmp_path: Path, topic: str, name: str) -> None:
    def longer(message: dict[str, Any]) -> None:
        if message["tick"] >= 40:
            message[name] = np.append(message[name], 0.0)

    bag = changed(flown(tmp_path, "command_duplicated"), tmp_path / "bag", topic, longer)
    assert "its arrays change their size" in wrong(bag, topic)[0]


def test_a_law_that_takes_over_has_one_term_more_and_its_log_is_sound(tmp_path: Path) -> None:
    text = """
name: swapped
duration: 1.0
testbed: {kind: csa, modes: 1}
controllers: {pd_feedforward: {}, lqr: {handover_time: 0.2}}
active: pd_feedforward
schedule:
  - {at: 0.2, switch: lqr}
  - {at: 0.1, disturbance: {base_yaw: 3.0}}
"""
    run_trial(parse_trial(text, "test"), "test", tmp_path / "run", True, False)
    bag = tmp_path / "run" / "bag"
    states = [
        decode(kind, data)
        for topic, kind, _, _, data in BagReader(bag).messages()
        if topic == "/controller_state"
    ]
    sizes = {np.size(state.terms) for state in states if state.controller != "pd_feedforward"}
    assert len(sizes) == 2
    assert not wrong(bag, "/controller_state")
