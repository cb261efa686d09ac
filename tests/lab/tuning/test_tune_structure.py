"""The command writes what it has tuned; shipped tunings are read and keep what they promise."""

import json
from pathlib import Path

import pytest
from tests.lab.tuning.acc import ACC, FAST, STIFFNESS
from tests.representatives import representatives
from typer.testing import CliRunner

import flexslew as fs
from flexslew_lab.cli.main import app
from flexslew_lab.tuning.tuning_file import read_tuning, tuning_names
from flexslew_plant.errors import BadInput

pytest.importorskip("ctrlsys")


def test_the_command_writes_a_trial_that_flies_and_a_page(tmp_path: Path) -> None:
    file, out = tmp_path / "acc.yaml", tmp_path / "out"
    file.write_text(json.dumps({**ACC, "guarantee": {STIFFNESS: [0.8, 1.2]}}))
    done = CliRunner().invoke(
        app, ["tune-structure", str(file), "--out", str(out), "--guarantee", "--fly", "--json"]
    )
    assert done.exit_code == 0, done.output
    found = json.loads((out / "tuned.json").read_text())
    assert found["met"]
    assert found["guarantee"]["guaranteed"]
    assert (out / "flight" / "report.html").exists()
    assert fs.trial(out / "trial.yaml").active == "order_2"
    assert "disk margin" in (out / "report.html").read_text()


def test_the_command_reports_what_is_not_met_by_its_exit_code(tmp_path: Path) -> None:
    file = tmp_path / "acc.yaml"
    file.write_text(json.dumps({**ACC, "goals": [FAST], "starts": 1, "evaluations": 60}))
    done = CliRunner().invoke(app, ["tune-structure", str(file), "--out", str(tmp_path / "out")])
    assert done.exit_code == 1
    assert "0 of 1 goals met" in done.output


def test_an_unknown_tuning_names_the_shipped_ones() -> None:
    with pytest.raises(BadInput, match="acc_order_3, observatory_order_5, observatory_pointing"):
        read_tuning("acc_order_4")


@pytest.mark.parametrize("name", representatives(tuning_names(), "acc_order_3"))
def test_a_shipped_tuning_is_read(name: str) -> None:
    problem = read_tuning(name)
    assert problem.settings.tuning == name
    assert len(problem.structure.labels) == len(problem.structure.start)


@pytest.mark.slow
def test_the_shipped_tuning_of_order_3_is_guaranteed_over_the_range_of_its_benchmark() -> None:
    tuned = fs.tune("acc_order_3")
    assert tuned.met
    assert len(tuned.section["system"]["a"]) == 3
    assert fs.worst_case(tuned.trial, {STIFFNESS: [0.5, 2.0]}, "order_3", at=0.0).guaranteed


@pytest.mark.slow
def test_the_shipped_tuning_of_the_observatory_is_that_of_its_tutorial() -> None:
    """The numbers of docs/requirements_to_controller.md."""
    tuned = fs.tune("observatory_pointing")
    assert tuned.met
    assert 1.0 / tuned.goals[0].before == pytest.approx(1.08, abs=0.005)
    assert min(tuned.margins.values()) == pytest.approx(1.38, abs=0.005)
    for goal, before, after in zip(tuned.goals[1:4], (0.98, 0.89, 0.79), (1.0,) * 3, strict=True):
        assert (goal.before, goal.value) == pytest.approx((before, after), abs=0.005)
    found = fs.worst_case(tuned.trial, {"gain": 0.3}, "pointing", at=0.0)
    assert found.guaranteed
    peaks = {gain.name: gain.found for gain in found.gains}
    assert (peaks["S"], peaks["T"]) == pytest.approx((2.60, 2.68), abs=0.01)
