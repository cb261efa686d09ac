"""A comparison in processes of its own: the same numbers, whoever dies on the way."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from flexslew_lab.cli.main import app
from flexslew_lab.comparison.comparison import Comparison, compare_candidates
from flexslew_lab.comparison.laws import laws
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.own_code import ANY_CODE

LAW = '''
import os, signal

class Odd:
    """PD that ends its process, or runs out of ideas, at tick 20 if told so."""

    def __init__(self, settings, period, effort_limit):
        self.act = settings["act"]

    def update(self, m, estimate, reference):
        if m.tick == 20 and self.act == "die":
            os.kill(os.getpid(), signal.SIGKILL)
        if m.tick == 20 and self.act == "raise":
            raise RuntimeError("out of ideas")
        return 0.5 * (reference.position - m.joint_position) - m.joint_velocity
'''
TRIAL = """
duration: 2.0
period: 0.05
testbed: {{kind: floating_oscillator}}
plan: {{method: reference_only, goal: {{mass: 0.1}}, duration: 1.0}}
controllers:
  pd_feedforward: {{kp: [0.5], kd: [1.0]}}
  odd: {{law: {law}, act: {act}}}
"""


@pytest.fixture
def law(tmp_path: Path) -> str:
    (tmp_path / "odd.py").write_text(LAW)
    return f"{tmp_path / 'odd.py'}:Odd"


def by_law(text: str, workers: int) -> Comparison:
    trial = parse_trial(text, "odd.yaml", ANY_CODE)
    return compare_candidates(laws(trial, "odd.yaml", (-0.2,)), workers=workers)


@pytest.mark.slow
@pytest.mark.parametrize("act", ["nothing", "raise"])
def test_processes_find_what_one_finds(law: str, act: str) -> None:
    text = TRIAL.format(law=law, act=act)
    alone, found = by_law(text, 1), by_law(text, 2)
    assert json.dumps(found.rows()) == json.dumps(alone.rows())
    assert {"pd_feedforward", "odd"} <= {entry.name for entry in found.simulated_entries}


@pytest.mark.slow
def test_a_law_that_ends_its_process_is_alone_in_that(law: str) -> None:
    kept = {r["law"]: r for r in by_law(TRIAL.format(law=law, act="nothing"), 1).rows()}
    found = {r["law"]: r for r in by_law(TRIAL.format(law=law, act="die"), 2).rows()}
    assert found.pop("odd") == {"law": "odd", "refused": "its process died 2 times (SIGKILL)"}
    del kept["odd"]
    assert json.dumps(found) == json.dumps(kept)


@pytest.mark.slow
def test_the_command_takes_a_number_of_processes(tmp_path: Path, law: str) -> None:
    file = tmp_path / "odd.yaml"
    file.write_text(TRIAL.format(law=law, act="nothing"))
    printed = [
        CliRunner().invoke(app, ["compare", str(file), "--laws", "--json", "--workers", count])
        for count in ("1", "2")
    ]
    assert printed[0].stdout == printed[1].stdout != ""
    assert {result.exit_code for result in printed} == {0}
