"""Budgets of shipped trials: what is refused, what is missing, the loop behind them."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov
from tests.present import present
from typer.testing import CliRunner

import flexslew as fs
from flexslew_lab.budget.budget import Budget, BudgetRequest
from flexslew_lab.budget.closed_loop import error_loop
from flexslew_lab.budget.page import bars
from flexslew_lab.budget.pointing_budget import pointing_budget
from flexslew_lab.budget.windows import Windows
from flexslew_lab.cli.main import app
from flexslew_lab.trial.sources import read_trial
from flexslew_lab.trial.trial import plan_of_trial
from flexslew_plant.errors import BadInput

_NOISE = "sensors.joint_position.noise"


def test_the_bars_of_the_page_reach_the_values(plain: Budget) -> None:
    group = bars(plain)
    for metric, panel in zip(plain.metrics, group.panels, strict=True):
        values = [value for trace in panel.traces for value in trace["y"]]
        assert max(values) == pytest.approx(plain.total.bounds[metric].value.max())
        assert present(panel.y_range)[1] > max(values)
        assert panel.traces[0]["x"] == ["slew", "total"]


@pytest.fixture(scope="module")
def plain() -> Budget:
    return fs.budget("m1", require={"APE": "20 arcsec", "RPE.hub_pitch": 1e-3})


def test_a_settled_noise_has_the_covariance_of_the_lyapunov_equation() -> None:
    trial, source = read_trial("replan_csa", [])
    loop = error_loop(trial, source, plan_of_trial(trial, predict=False), 0.0)
    inputs = loop.signal_inputs(tuple(f"position.{n}" for n in loop.loop.joint_names))
    ticks = 200_000
    system = loop.system
    covariance = solve_discrete_lyapunov(system.a, inputs.columns @ inputs.columns.T)
    found = Windows(ticks - 1, ticks - 1, 10).of_noise(loop.responses(inputs, ticks))
    direct = inputs.direct @ inputs.direct.T
    expected = np.diag(system.c @ covariance @ system.c.T + direct)
    assert found["APE"][0] == pytest.approx(expected, rel=1e-3)


def test_a_force_on_a_joint_is_an_effort_on_it() -> None:
    trial, source = read_trial("m1", [])
    loop = error_loop(trial, source, plan_of_trial(trial, predict=False), 25.0)
    efforts = loop.effort_inputs().columns
    assert loop.force_inputs().columns[:, :2] == pytest.approx(efforts, rel=1e-5, abs=1e-9)


def test_a_trial_without_errors_has_its_slew_alone(plain: Budget) -> None:
    assert [one.name for one in plain.contributions] == ["slew"]
    assert not plain.without
    assert "20 arcsec" not in plain.verdict
    assert "NOT met: APE.base_yaw" in plain.verdict
    assert [one.met for one in plain.margins] == [False, True, True]
    assert plain.margins[0].limit == pytest.approx(np.radians(20.0 / 3600.0))
    assert not plain.met


def test_an_error_of_the_model_is_a_source_that_members_draw() -> None:
    budget = fs.budget("m1", vary={"stiffness": 0.01, "delay": [0.0, "10 ms"]})
    parts = {one.name: one.parts["APE"] for one in budget.contributions}
    assert parts["model.stiffness"].drawn.max() > 0.0
    assert parts["model.delay"].drawn.max() > 0.0
    double = fs.budget("m1", vary={"stiffness": 0.02})
    wider = {one.name: one.parts["APE"] for one in double.contributions}["model.stiffness"]
    rms = [np.sqrt(p.drawn.mean()) for p in (parts["model.stiffness"], wider)]
    assert rms[1] == pytest.approx(2.0 * rms[0], rel=0.02)


def test_what_is_simplified_is_listed() -> None:
    changes = {"sensors.joint_position": {"noise": 1e-6, "quantisation": 1e-4}}
    budget = fs.budget(fs.trial("m1", changes))
    assert "sensors.joint_position.quantisation: flown" in " ".join(budget.left_out)


def test_the_verdict_in_the_docs_is_that_of_the_command() -> None:
    """docs/budget.md, to a few percent: a plan depends on the machine in its last digits."""
    page = (Path(__file__).parents[3] / "docs/budget.md").read_text()
    line = page.partition("mixed [rad]: ")[2].splitlines()[0]
    printed = re.findall(r"([A-Z]{3}) ([0-9.]+e-\d+)", line)
    changes = {"sensors.joint_position.noise": "5 arcsec", "sensors.joint_velocity.bias": 1e-6}
    total = fs.budget(fs.trial("three_axes", changes)).total.bounds
    assert [metric for metric, _ in printed] == list(total)
    for metric, value in printed:
        assert float(value) == pytest.approx(total[metric].value.max(), rel=0.03), metric


def test_a_source_that_fails_is_named_and_no_requirement_counts_as_met() -> None:
    """The other sources are kept."""
    budget = fs.budget("m1", {"APE": 1.0}, vary={"stiffnes": 0.2})
    assert budget.without[0].startswith("model: vary: no parameter 'stiffnes'")
    assert "WITHOUT model" in budget.verdict
    assert [one.name for one in budget.contributions] == ["slew"]
    assert not budget.met


@pytest.mark.slow
def test_the_instruments_of_an_observatory_are_sources() -> None:
    sets = ["testbed.sensors.gyro.bias_spread=0", "duration=1300"]
    trial, source = read_trial("observatory", sets)
    budget = pointing_budget(trial, source, BudgetRequest())
    kinds = {one.name.partition("testbed.")[2]: one.kind for one in budget.contributions}
    assert kinds["sensors.tracker.noise"] == kinds["sensors.gyro.angle_random_walk"] == "noise"
    assert kinds["sensors.speeds.noise"] == "noise"
    assert kinds["orbit"] == "torque"
    assert any("one way" in words for words in budget.left_out)
    assert budget.axes.names == ("x", "y", "z")


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"require": {"APX": 1.0}}, "no metric; did you mean APE"),
        ({"require": {"APE.roll": 1.0}}, "no axis; allowed: base_yaw, hub_pitch"),
        ({"require": {"APE": "1 kg"}}, "give a number in rad"),
        ({"require": {"APE": -1.0}}, "above 0"),
        ({"level": 1.5}, "--level"),
        ({"window": 1e-9}, "--window"),
        ({"controller": "none"}, "--controller"),
        ({"windw": 1.0}, "did you mean window"),
        ({"interpretation": "all"}, "mixed, temporal, ensemble"),
    ],
)
def test_what_is_not_understood_is_refused(how: dict[str, object], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        fs.budget("m1", **how)  # type: ignore[arg-type]


def test_a_run_that_ends_before_its_manoeuvre_is_refused() -> None:
    with pytest.raises(BadInput, match="duration"):
        fs.budget(fs.trial("m1", {"duration": 20.0}))


def test_the_command_writes_page_and_tables(tmp_path: Path) -> None:
    page, table, latex = tmp_path / "b.html", tmp_path / "b.csv", tmp_path / "b.tex"
    words = ["budget", "m1", "--set", f"{_NOISE}=1e-4", "--require", "APE=1 deg"]
    done = CliRunner().invoke(app, [*words, "--out", str(page), "--table", str(table)])
    assert done.exit_code == 0, done.output
    assert "pointing budget" in page.read_text()
    assert "bar" in page.read_text()
    lines = table.read_text().splitlines()
    assert lines[0] == "source,kind,metric,axis,unit,mean,deviation,value,limit"
    assert any(line.startswith("total,total,APE,base_yaw,rad,") for line in lines)
    done = CliRunner().invoke(app, [*words, "--json", "--table", str(latex), "--level", "0.95"])
    report = json.loads(done.stdout[: done.stdout.rindex("}") + 1])
    assert report["met"]
    assert report["half_width"] == pytest.approx(1.96, abs=1e-3)
    assert "\\toprule" in latex.read_text()


def test_the_command_fails_where_a_requirement_does() -> None:
    done = CliRunner().invoke(app, ["budget", "m1", "--require", "APE=1e-9", "--json"])
    assert done.exit_code == 1
    assert not json.loads(done.stdout)["met"]
