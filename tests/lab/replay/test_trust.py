"""A log is data: what code it names runs only when its reader says so."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.plant.testbeds.spacecraft.finite_elements.frames import ANGLE, arrays
from tests.present import present

from flexslew_control.controllers.user_law import find_law
from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.messages.cdr import encode
from flexslew_lab.log.recording.bag_writer import BagWriter
from flexslew_lab.replay.check import check
from flexslew_lab.replay.resim import resim
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import ANY_CODE, NO_CODE, Trust, Untrusted, code_hash, file_of

LAW = """
from pathlib import Path

Path({traces!r}).touch()


class MyLaw:
    def __init__(self, settings, period, effort_limit):
        Path({traces!r}).touch()  # a module that is loaded already is not run again
        self.gain = {gain}

    def update(self, measurement, estimate, reference):
        return self.gain * (reference.position - measurement.joint_position)
"""
TRIAL = """
name: own
duration: 1.0
plan: {{method: reference_only, goal: {{base_yaw: 0.01, hub_pitch: 0.0}}, duration: 0.5}}
controllers: {{mine: {{law: "{law}"}}}}
active: mine
"""

WITH_DATA = """
name: own
duration: 0.5
testbed:
  kind: spacecraft
  platform: {{mass: 200.0, inertia: {{xx: 35.0, yy: 30.0, zz: 32.0}}}}
  appendages:
    left:
      hinge: {{place: [0.0, 0.6, 0.0]}}
      shape: {{kind: finite_elements, file: {file}, modes: 2, damping_ratio: 0.01}}
  actuators: {{}}
  wheels: {{roll: {{axis: [1.0, 0.0, 0.0], inertia: 0.02, limit: 0.5, momentum_limit: 10.0}}}}
plan: {{method: reference_only, goal: {{roll: 0.001}}, duration: 0.4}}
controllers: {{pd_feedforward: {{kp: [12.0], kd: [60.0]}}}}
active: pd_feedforward
"""


@pytest.fixture
def own(tmp_path: Path) -> tuple[Any, Any, Any]:
    """Return a log of a law from a file, the law's name, and the file that grows when it runs."""
    file, traces = tmp_path / "my_law.py", tmp_path / "traces"
    file.write_text(LAW.format(traces=str(traces), gain=10.0))
    law = f"{file}:MyLaw"
    trial = parse_trial(TRIAL.format(law=law), "test", ANY_CODE)
    run_trial(trial, "test", tmp_path / "run", in_process=True, report=False)
    traces.unlink()
    return tmp_path / "run" / "bag", law, traces


@pytest.mark.parametrize("action", [resim, lambda bag: check(bag, "mine")], ids=["resim", "check"])
def test_a_law_that_a_log_names_is_refused_with_its_path_and_hash(
    own: tuple[Any, Any, Any], action: Any
) -> None:
    bag, law, traces = own
    with pytest.raises(Untrusted) as refused:
        action(bag)
    words = str(refused.value)
    assert law in words
    assert f"SHA-256 {code_hash(law)}" in words
    assert "it is the file that was recorded" in words
    assert f"--trust {law}" in words
    assert "\n" not in words
    assert not traces.exists()


@pytest.mark.parametrize("trusted", ["its name", "all"])
def test_a_trusted_law_runs(own: tuple[Any, Any, Any], trusted: str) -> None:
    bag, law, traces = own
    names = [law] if trusted == "its name" else ["all"]
    assert resim(bag, trust=Trust.of(names)).identical
    assert check(bag, "mine", trust=Trust.of(names)).ok
    assert traces.exists()


def test_to_trust_another_name_is_not_enough(own: tuple[Any, Any, Any]) -> None:
    bag, _, traces = own
    with pytest.raises(Untrusted):
        resim(bag, trust=Trust.of(["other.py:MyLaw"]))
    assert not traces.exists()


def test_a_law_that_has_changed_is_said_before_and_after_it_runs(own: tuple[Any, Any, Any]) -> None:
    bag, law, traces = own
    recorded = code_hash(law)
    file = present(file_of(law))
    file.write_text(LAW.format(traces=str(traces), gain=11.0))
    with pytest.raises(Untrusted, match=f"NOT the file that was recorded.* {recorded}"):
        resim(bag)
    again = resim(bag, trust=Trust.of(["all"]))
    assert again.changed_code == {law: (recorded, code_hash(law))}
    assert not again.identical
    assert check(bag, "mine", trust=Trust.of(["all"])).changed_code == again.changed_code


def test_the_log_holds_the_hash_in_its_trial_and_in_the_status(own: tuple[Any, Any, Any]) -> None:
    bag, law, _ = own
    reader = BagReader(bag)
    assert json.loads(reader.metadata["own_code"]) == {law: code_hash(law)}
    assert code_hash(law) in reader.overview.statuses["mine"].settings


@pytest.mark.parametrize("law", ["os.Popen", "antigravity.Any", "evil.py:Law"])
def test_a_controller_that_is_not_in_the_trial_names_no_code_either(
    own: tuple[Any, Any, Any], tmp_path: Path, law: str
) -> None:
    bag, mine, _ = own
    reader = BagReader(bag)
    kind = TOPICS["/controller_status"].type
    status = {"controller": "stranger", "law": law, "settings": "{}"}
    with BagWriter(tmp_path / "other", reader.metadata) as writer:
        writer.write("/controller_status", kind, encode(kind, status), 0)
        for topic, name, stamp, _, data in reader.messages():
            writer.write(topic, name, data, stamp)
    with pytest.raises(Untrusted, match=f"refused to run {law}"):
        resim(tmp_path / "other", trust=Trust.of([mine]))


def test_a_testbed_of_the_readers_own_is_code_too(tmp_path: Path) -> None:
    text = "duration: 1.0\ntestbed: {kind: 'mine.py:Testbed'}\ncontrollers: {pd_feedforward: {}}\n"
    with BagWriter(tmp_path / "bag", {"trial": text}) as writer:
        kind = TOPICS["/clock"].type
        writer.write("/clock", kind, encode(kind, {}), 0)
    with pytest.raises(BadInput, match=r"mine\.py:Testbed"):
        resim(tmp_path / "bag")


def test_nothing_is_trusted_unless_it_is_named() -> None:
    for trust in (NO_CODE, Trust(), Trust.of(["a.A", "b.C"])):
        with pytest.raises(Untrusted):
            find_law("b.B", "test", (), trust)
    path = Path(__file__)
    assert file_of(f"{path}:Anything") == path


def test_the_log_holds_the_hashes_of_its_data(tmp_path: Path) -> None:
    """Of each file that is read for an appendage, also of those beside the one that is named."""
    panel = tmp_path / "panel.npz"
    np.savez(panel, **arrays(ANGLE, 3))
    trial = parse_trial(WITH_DATA.format(file=panel), "test")
    run_trial(trial, "test", tmp_path / "run", in_process=True, report=False)
    bag = tmp_path / "run" / "bag"
    recorded = json.loads(BagReader(bag).metadata["own_code"])
    assert recorded == {str(panel): code_hash(str(panel))}
    with pytest.raises(Untrusted, match=f"--trust {panel}.*; it is the file that was recorded"):
        resim(bag)
    assert resim(bag, trust=Trust.of([str(panel)])).changed_code == {}
    np.savez(panel, **arrays(ANGLE, 4))
    with pytest.raises(Untrusted, match="it is NOT the file that was recorded"):
        resim(bag)
    again = resim(bag, trust=Trust.of([str(panel)]))
    assert again.changed_code.keys() == {str(panel)}
    assert not again.identical
