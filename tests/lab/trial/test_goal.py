"""Whether a run reaches its goal: a law that cannot is not ready, a run that has not has failed."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.representatives import products, representatives

from flexslew_control.controllers import CONTROLLERS
from flexslew_control.plan import Plan
from flexslew_lab.cli.main import main
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.sources import example_trials
from flexslew_lab.trial.trial import (
    build_controllers,
    load_trial,
    parse_trial,
    plan_of_trial,
    set_plan,
)
from flexslew_plant.errors import BadInput, PlanFailed

HOLDING = [name for name, entry in CONTROLLERS.items() if not entry.follows_reference]
STEP = """
name: step
duration: {duration}
period: 0.02
testbed: {{kind: csa, modes: 1}}
plan: {{method: none, goal: {{base_yaw: 0.2}}}}
controllers: {{{law}: {{}}}}
active: {law}
"""
OSCILLATOR = """
name: oscillator
duration: 40.0
testbed: {{kind: floating_oscillator}}
plan: {{method: {method}, goal: {{mass: 1.0}}}}
controllers: {{{law}: {settings}}}
active: {law}
"""


def flown(text: str, folder: Path) -> Any:
    return run_trial(parse_trial(text, "t"), "t", folder, in_process=True, report=False)


# whose plans are made within seconds
SOON = {"m1", "scole_s_a", "own_spacecraft", "replan_oscillator", "antenna_2"}


@pytest.mark.parametrize("law", HOLDING)
def test_a_law_that_only_holds_a_rest_is_not_ready_under_a_plan_that_moves(
    law: str, tmp_path: Path
) -> None:
    settings = "{design: sampled}" if law == "disturbance_minimisation" else "{}"
    text = STEP.format(law=law, duration=2.0).replace("{}", settings)
    with pytest.raises(BadInput, match=f"{law} is not ready: its? ") as caught:
        flown(text, tmp_path / "run")
    assert "moving reference" in str(caught.value) or "no gains" in str(caught.value)
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_laws_refuse_plans_that_move_as_their_entries_say() -> None:
    for name in sorted(set(CONTROLLERS) - {"planned_gains"}):
        settings = dict(CONTROLLERS[name].compared)
        trial = parse_trial(STEP.format(law=name, duration=2.0).replace("{}", str(settings)), "t")
        controllers = build_controllers(trial, "t")
        refused = set_plan(controllers, name, plan_of_trial(trial))
        assert bool(refused) != CONTROLLERS[name].follows_reference, (name, refused)


def test_a_standby_that_cannot_follow_stands_back_and_the_run_goes_on(tmp_path: Path) -> None:
    text = STEP.format(law="pd_feedforward", duration=40.0)
    text = text.replace("{pd_feedforward: {}}", "{pd_feedforward: {}, modal_space: {}}")
    text += "schedule: [{at: 1.0, switch: modal_space}]\n"
    result = flown(text, tmp_path / "run")
    assert result.metrics["switches"] == 0
    assert result.exit_code == 0


def test_a_missed_goal_is_a_failed_check(tmp_path: Path) -> None:
    text = STEP.format(law="pd_feedforward", duration=1.0)
    result = flown(text, tmp_path / "run")
    assert result.exit_code == 1
    assert result.message.startswith("goal missed by ")
    assert "base_yaw -0." in result.message
    assert result.metrics["goal_error"] > 0.1
    wide = flown(text + "goal_tolerance: 1.0\n", tmp_path / "wide")
    assert (wide.exit_code, wide.message) == (0, "")


def test_the_command_ends_with_1_and_the_final_error_comes_before_the_tip(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "step.yaml"
    file.write_text(STEP.format(law="pd_feedforward", duration=1.0))
    run = tmp_path / "run"
    argv = ["flexslew", "trial", str(file), "--in-process", "--out", str(run)]
    monkeypatch.setattr(sys, "argv", argv)
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 1
    told = " ".join(capsys.readouterr().out.split())
    assert told.index("final error: base_yaw") < told.index("tip deflection after")
    page = (run / "report.html").read_text()
    assert page.index("final error") < page.index("residual tip deflection")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "law"),
    products(
        ["optimized_feedforward", "robust_feedforward", "reference_only", "none"],
        ["modal_space", "pd_feedforward", "lqr"],
    ),
)
def test_on_the_oscillator_nothing_needs_nan(method: str, law: str, tmp_path: Path) -> None:
    text = OSCILLATOR.format(method=method, law=law, settings="{}")
    try:
        words = flown(text, tmp_path / "run").message
    except (BadInput, PlanFailed) as refused:
        words = str(refused)
        assert "not stable" in words or "moving reference" in words
    assert "nan" not in words
    assert "\n" not in words


@pytest.mark.parametrize(
    "shipped",
    representatives(
        example_trials(),
        *(trial for trial in example_trials() if trial.name in SOON),
        single=True,
    ),
    ids=lambda trial: trial.name,
)
def test_every_law_of_a_shipped_trial_follows_its_plan(
    shipped: Any, shipped_plan: Callable[[str], Plan | None]
) -> None:
    trial = load_trial(shipped.path)
    controllers = build_controllers(trial, shipped.name)
    assert set_plan(controllers, trial.active, shipped_plan(shipped.name)) is None
