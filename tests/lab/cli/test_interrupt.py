"""Ctrl-C at any moment: one line, exit code 130, no traceback."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from tests.representatives import representatives

from flexslew_lab.cli.main import main

MOMENTS = (  # the module whose import has just ended
    "typer",
    "numpy",
    "numba",
    "flexslew_lab.run.run_trial",
)
COMMANDS = {
    "trial": ["trial", "--in-process", "--out", "OUT"],
    "plan": ["plan"],
    "compare": ["compare", "--out", "OUT"],
}
SEARCHES = (["--set", "plan.functions=40"], ["--method", "minimax_feedforward"])


def interrupted(words: list[str], moment: str, folder: Path) -> tuple[int, list[str]]:
    """Return exit code and what was said by a command interrupted after an import."""
    words = [str(folder / "out") if word == "OUT" else word for word in words]
    child = subprocess.Popen(
        [sys.executable, "-X", "importtime", "-m", "flexslew_lab.cli.main", *words],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, cwd=folder,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    assert child.stderr is not None
    try:
        for line in child.stderr:
            if line.startswith("import time:") and line.rsplit("|", 1)[-1].strip() == moment:
                break
        child.send_signal(signal.SIGINT)
        rest = child.stderr.read()
        child.wait(60)
    finally:
        child.kill()
        child.wait()
    said = [line for line in rest.splitlines() if line and not line.startswith("import time:")]
    return child.returncode, said


@pytest.mark.parametrize("moment", representatives(MOMENTS, "numba"))
def test_an_interrupted_import_ends_in_one_line(tmp_path: Path, moment: str) -> None:
    assert interrupted(COMMANDS["trial"], moment, tmp_path) == (130, ["interrupted"])


@pytest.mark.slow
@pytest.mark.parametrize("command", representatives(COMMANDS, "trial"))
def test_an_interrupted_command_ends_in_one_line(tmp_path: Path, command: str) -> None:
    moment = {"trial": "flexslew_lab.run.in_process", "plan": "flexslew_control.plans.plan_file",
              "compare": "flexslew_lab.comparison.comparison"}[command]  # fmt: skip
    code, said = interrupted(COMMANDS[command], moment, tmp_path)
    assert code == 130
    assert said == ["interrupted"]


@pytest.mark.slow
@pytest.mark.parametrize("search", representatives(SEARCHES, SEARCHES[0]))
def test_interrupted_planning_leaves_no_file(tmp_path: Path, search: list[str]) -> None:
    words = ["plan", "--out", "p.yaml", "--figure", "f.html", *search]
    child = subprocess.Popen(
        [sys.executable, "-m", "flexslew_lab.cli.main", *words],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=tmp_path,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    assert child.stdout is not None
    try:
        told = next(line for line in child.stdout if " J " in line)  # of the first iteration
        child.send_signal(signal.SIGINT)
        rest = child.stdout.read()
        child.wait(60)
    finally:
        child.kill()
        child.wait()
    assert told.split()[0] == "1"
    assert (child.returncode, rest.splitlines()[-1:]) == (130, ["interrupted"])
    assert not [*tmp_path.iterdir()]


def test_what_swallows_the_interrupt_is_ended_all_the_same() -> None:
    script = (
        "import signal, sys\n"
        "from flexslew_lab.cli import interrupt\n"
        "interrupt.EXIT_TIMEOUT = interrupt._patience = 0.05\n"
        "@interrupt.while_running()\n"
        "def deaf():\n"
        "    try:\n"
        "        signal.raise_signal(signal.SIGINT)\n"
        "    except KeyboardInterrupt:\n"
        "        pass\n"
        "    while True:\n"
        "        pass\n"
        "deaf()\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, timeout=60)
    assert (done.returncode, done.stderr) == (130, b"interrupted\n")


@pytest.mark.parametrize("words", [["trials"], ["trial", "no such trial"], ["--help"]])
def test_a_program_that_calls_the_command_line_keeps_its_own_handler(
    words: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = signal.getsignal(signal.SIGINT)
    monkeypatch.setattr(sys, "argv", ["flexslew", *words])
    with pytest.raises(SystemExit):
        main()
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.parametrize("leave", ["raise KeyboardInterrupt", "sys.exit(130)"])
def test_an_interrupt_in_a_text_that_is_run_has_the_exit_code_of_any_other(
    tmp_path: Path, leave: str
) -> None:
    """Dataclasses are made by exec: Python takes what leaves it for unhandled, caught or not."""
    program = f"""
import sys
from flexslew_lab.cli import main as cli

def command(**_):
    try:
        exec("raise KeyboardInterrupt")
    except KeyboardInterrupt:
        {leave}

cli.get_command = lambda app: None
cli.without_types = lambda app: command
cli.main()
"""
    (tmp_path / "bench.py").write_text(program)
    done = subprocess.run([sys.executable, "-m", "bench"], cwd=tmp_path, check=False)
    assert done.returncode == 130


def test_an_interrupt_that_compiled_code_reports_as_an_error_is_still_an_interrupt(
    tmp_path: Path,
) -> None:
    """Numba calls a method of Python for each function that it is given, and loses its argument."""
    program = """
import signal
from flexslew_lab.cli import main as cli

def command(**_):
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        pass
    raise TypeError("_get_wrapper_address() missing 1 required positional argument: 'sig'")

cli.get_command = lambda app: None
cli.without_types = lambda app: command
cli.main()
"""
    (tmp_path / "bench.py").write_text(program)
    done = subprocess.run(
        [sys.executable, "-m", "bench"], cwd=tmp_path, check=False, capture_output=True, text=True
    )
    assert (done.returncode, done.stderr.splitlines()) == (130, ["interrupted"])
