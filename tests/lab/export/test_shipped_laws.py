"""Every controller of every shipped trial is written in C and agrees, or is refused in one line."""

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from flexslew_lab.cli.main import app
from flexslew_lab.export.c_module import module_of
from flexslew_lab.export.compiled import CompiledModule, compilers
from flexslew_lab.export.flight_vector import controller_vector
from flexslew_lab.trial.sources import example_trials, read_trial
from flexslew_lab.trial.trial import build_controllers, plan_of_trial
from flexslew_plant.errors import BadInput

needs_compiler = pytest.mark.skipif(not compilers(), reason="no C compiler is here: gcc or clang")


@needs_compiler
@pytest.mark.campaign
@pytest.mark.parametrize("shipped", [one.name for one in example_trials()])
def test_each_law_agrees_or_is_refused_in_one_line(shipped: str, tmp_path: Path) -> None:
    trial, source = read_trial(shipped)
    plan = plan_of_trial(trial, predict=False)
    for name in trial.controllers:
        controller = build_controllers(trial, source)[name]
        reason = ""
        try:
            module = module_of(trial, controller, plan, source=source)
            vector = controller_vector(trial, name, plan, source)
        except BadInput as error:
            reason = str(error)
        if reason:
            unsupported = "model_predictive cannot be written out"  # it calls a solver
            assert re.search(f"{unsupported}|never active", reason)
            assert "\n" not in reason
            continue
        compiled = CompiledModule(module, tmp_path)
        assert vector.error(np.array([compiled.step(row) for row in vector.inputs])) < 1e-9


@needs_compiler
def test_the_command_writes_a_folder_and_checks_it(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    given = ["export", "m1", "--set", "duration=10", "--plant", "--c", str(folder)]
    result = CliRunner().invoke(app, given, catch_exceptions=False)
    assert result.exit_code == 0
    assert result.output.count("allowed 1e-09") == 2
    names = {path.name for path in folder.iterdir()}
    module = {f"m1_plant{end}" for end in (".c", ".h", "_check.c", "_vector.csv")}
    assert module <= names
    assert "CMakeLists.txt" in names


def test_a_command_without_a_folder_says_what_is_missing() -> None:
    with pytest.raises(BadInput, match="--c FOLDER"):
        CliRunner().invoke(app, ["export", "m1"], catch_exceptions=False)
