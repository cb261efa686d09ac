"""A planner of one's own goes through every door that a built-in one goes through."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from flexslew_control.plan import Plan
from flexslew_control.plan_service.planning import Iteration, PlanProcess, StartOfPlan, plan_request
from flexslew_control.plans.plan_file import load_plan
from flexslew_lab.cli.main import app
from flexslew_lab.comparison.comparison import compare_candidates
from flexslew_lab.comparison.laws import laws
from flexslew_lab.comparison.planners import planners
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.replay.resim import resim
from flexslew_lab.run.pool import InThisProcess
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.studies.run import prepare, run_study
from flexslew_lab.studies.study import parse_study
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.own_code import ANY_CODE, NO_CODE, Trust, Untrusted, code_hash
from flexslew_plant.refusal import Refusal
from flexslew_plant.yaml_data import yaml_text

SHAPER = Path(__file__).parents[3] / "docs" / "examples" / "my_shaper.py"


@pytest.fixture
def method(tmp_path: Path) -> str:
    """Return the planner of the documentation, from a file of the user's own."""
    (tmp_path / "shaper_of_mine.py").write_text(SHAPER.read_text())
    return f"{tmp_path / 'shaper_of_mine.py'}:Shaper"


def trial_text(method: str) -> str:
    trial: dict[str, Any] = {
        "name": "own_planner",
        "duration": 12.0,
        "period": 0.05,
        "testbed": {"kind": "floating_oscillator"},
        "plan": {"method": method, "goal": {"mass": 1.0}, "duration": 4.0},
        "controllers": {"pd_feedforward": {"kp": [0.5], "kd": [1.0]}},
    }
    return yaml_text(trial)


@pytest.fixture
def flown(method: str, tmp_path: Path) -> Any:
    """Return the result of a trial that is planned by it."""
    trial = parse_trial(trial_text(method), "own.yaml", ANY_CODE)
    return run_trial(trial, "own.yaml", tmp_path / "run", in_process=True, report=False)


def test_a_trial_flies_its_plan_and_logs_its_hash(flown: Any, method: str, tmp_path: Path) -> None:
    assert flown.exit_code == 0, flown.message
    assert flown.metrics["residual_tip_deflection"] < 0.01  # of a metre
    reader = BagReader(tmp_path / "run" / "bag", trust=Trust.of([method]))
    assert json.loads(reader.metadata["own_code"]) == {method: code_hash(method)}


def test_a_strangers_bag_runs_it_only_if_it_is_named(
    flown: Any, method: str, tmp_path: Path
) -> None:
    with pytest.raises(Untrusted, match=code_hash(method)) as refused:
        resim(tmp_path / "run" / "bag")
    assert f"--trust {method}" in str(refused.value)
    assert "it is the file that was recorded" in str(refused.value)
    assert "\n" not in str(refused.value)
    assert resim(tmp_path / "run" / "bag", trust=Trust.of([method])).identical


def test_the_command_plans_with_it(method: str, tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_text(trial_text(method))
    saved = tmp_path / "plan.yaml"
    asked = ["plan", str(tmp_path / "own.yaml"), "--out", str(saved)]
    done = CliRunner().invoke(app, asked)
    assert done.exit_code == 0, done.output
    assert load_plan(saved).method == method


@pytest.mark.slow
def test_compare_flies_it_beside_the_others(method: str) -> None:
    trial = parse_trial(trial_text(method), "own.yaml", ANY_CODE)
    found = compare_candidates(planners(trial, "own.yaml", (0.0,)))
    first, *others = found.entries
    assert first.name == method
    assert first.nominal.metrics["residual_tip"] < 0.01
    assert "input_shaping" in {entry.name for entry in others}


def test_every_law_flies_its_plan(method: str) -> None:
    trial = parse_trial(trial_text(method), "own.yaml", ANY_CODE)
    found = compare_candidates(laws(trial, "own.yaml", ()))
    assert {entry.plan.method for entry in found.simulated_entries if entry.plan} == {method}


def test_a_study_flies_it_and_a_received_one_does_not(method: str, tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_text(trial_text(method))
    text = yaml_text({
        "study": "own", "trial": "own.yaml", "seed": 1, "batch": False,
        "sampling": {"method": "random", "n": 2}, "keep": {"bags": "none"},
        "vary": {"testbed.parameters.stiffness": {"relative": {"uniform": [-0.1, 0.1]}}},
    })  # fmt: skip
    source = str(tmp_path / "study.yaml")
    ready = prepare(parse_study(text, source, tmp_path, ANY_CODE))
    run_study(ready, tmp_path / "out", InThisProcess(ready.job))
    with pytest.raises(Untrusted):
        prepare(parse_study(text, source, tmp_path, NO_CODE))


@pytest.mark.slow
@pytest.mark.parametrize("trusted", [True, False])
def test_the_planner_process_runs_it_only_where_it_is_trusted(method: str, trusted: bool) -> None:
    asked = {"method": method, "goal": {"mass": 1.0}, "duration": 4.0}
    bench = yaml_text({"testbed": {"kind": "floating_oscillator"}, "period": 0.02})
    trust = Trust.of([method]) if trusted else NO_CODE
    request = plan_request(
        yaml_text(asked, flow=True), bench, 0.02, [1.0], lambda start: StartOfPlan(), trust
    )
    planning, found = PlanProcess(), list[Iteration | Plan | Refusal]()
    assert not isinstance(request, Refusal)
    planning.ask(request)
    while not found:
        found = planning.updates(wait=10.0)
    planning.close()
    if not trusted:
        assert isinstance(found[-1], Refusal)
        assert f"--trust {method}" in str(found[-1])
        return
    assert isinstance(found[-1], Plan)
    assert found[-1].method == method
    assert np.abs(found[-1].position[-1] - 1.0).max() < 1e-12
