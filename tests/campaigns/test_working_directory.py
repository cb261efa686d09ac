"""A folder runs nothing: modules that hide those of the bench are not imported from it."""

import ast
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.representatives import representatives

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "ros2_ws" / "src"
# what a command imports early, late, or in a process of its own
HIDING = ("typer", "numpy", "json", "click", "yaml", "rclpy", "pydantic", "numba", "scipy", "site",
          "sitecustomize", "usercustomize", "flexslew_lab", "flexslew_plant", "mcap")  # fmt: skip
COMMANDS = (
    ["--help"], ["trials"], ["trial", "m1", "--in-process", "--set", "duration=0.1", "--set",
    "goal_tolerance=10.0", "--set",
    "plan={method: none, goal: {base_yaw: 0.01}, duration: 0.05}", "--out", "run"],
    ["log", "info", "nothing"], ["study", "list"], ["reproduce", "nobody"],
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    "command", representatives(COMMANDS, COMMANDS[2]), ids=lambda words: " ".join(words[:2])
)
def test_a_folder_full_of_modules_runs_none_of_them(command: list[str], tmp_path: Path) -> None:
    marker = tmp_path / "was_run"
    for name in HIDING:
        (tmp_path / f"{name}.py").write_text(f"open({str(marker)!r}, 'a').write({name!r})\n")
    words = [sys.executable, "-P", "-m", "flexslew_lab.cli.main", *command]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode in (0, 2), done.stderr
    assert not marker.exists(), marker.read_text()


@pytest.mark.slow
def test_a_random_choice_of_modules_runs_none_either(
    case: np.random.Generator, tmp_path: Path
) -> None:
    marker, installed = tmp_path / "was_run", sorted(sys.stdlib_module_names | {*HIDING})
    for name in case.choice(installed, size=20, replace=False):
        (tmp_path / f"{name}.py").write_text(f"open({str(marker)!r}, 'a').write({str(name)!r})\n")
    words = [sys.executable, "-P", "-m", "flexslew_lab.cli.main", *COMMANDS[case.integers(2)]]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert not marker.exists(), marker.read_text()


@pytest.mark.slow
def test_every_process_that_the_bench_starts_is_started_so() -> None:
    wrong = []
    for path in SOURCE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if (
                isinstance(node, ast.List)
                and node.elts
                and ast.unparse(node.elts[0]) == "sys.executable"
            ):
                words = [ast.unparse(word) for word in node.elts[1:2]]
                if words != ["'-P'"]:
                    wrong.append(f"{path.relative_to(SOURCE)}:{node.lineno}")
    assert not wrong
    script = (ROOT / "flexslew").read_text()
    assert '/.venv/bin/python" -P -m flexslew_lab.cli.main' in script
