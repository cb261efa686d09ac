"""What the command line says of itself: version, help in groups, completion."""

import os
import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from flexslew_lab.cli.main import app, main

ROOT = Path(__file__).parents[3]


WIDTH = 78  # of the text where a terminal is 80 wide; a command that is broken cannot be pasted


def commands(within: Any, *path: str) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield every command and group below one, with the words that call it."""
    for name, command in getattr(within, "commands", {}).items():
        yield (*path, name), command
        yield from commands(command, *path, name)


def said(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: str) -> str:
    monkeypatch.setattr(sys, "argv", ["flexslew", *words])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 0
    return capsys.readouterr().out


def test_the_version_is_that_of_the_package(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert said(monkeypatch, capsys, "--version") == f"flexslew {version}\n"


def test_help_comes_in_groups_and_a_flag_has_no_type(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = said(monkeypatch, capsys, "--help")
    assert whole.index("Fly and plan") < whole.index("Operate a running bench")
    assert "─ Commands" not in whole  # nothing stands outside of the groups
    for words in (["--help"], ["trial", "--help"], ["study", "run", "--help"]):
        assert "bool" not in said(monkeypatch, capsys, *words)
    assert "<float>" in said(monkeypatch, capsys, "trial", "--help")


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("flexslew trial swap", ["swap_demo"]),
        ("flexslew comp", ["compare", "completion"]),
        ("flexslew trial --in", ["--in-process"]),
        ("flexslew study re", ["report"]),
    ],
)
def test_a_shell_completes_commands_and_trials(
    line: str,
    found: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = line.split()
    ask = f"COMP_WORDS=({shlex.join(words)}) COMP_CWORD={len(words) - 1} && _flexslew"
    script = (
        f"{said(monkeypatch, capsys, 'completion', 'bash')}\n{ask}\nprintf '%s ' ${{COMPREPLY[@]}}"
    )
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True)
    assert sorted(done.stdout.split()) == found


def test_every_help_holds_an_example_that_can_be_pasted() -> None:
    whole: Any = get_command(app)
    for path, command in commands(whole):
        examples = re.findall(r"^ *Example: `(.*)`$", command.help or "", re.MULTILINE)
        assert len(examples) == 1, path
        assert len(f"Example: {examples[0]}") <= WIDTH, path
        _, called = examples[0].split("./flexslew ")
        words = shlex.split(called.partition(" >")[0].removesuffix(')"'))
        called_for = whole
        while words and words[0] in getattr(called_for, "commands", {}):
            called_for = called_for.commands[words.pop(0)]
        called_for.make_context(called, words)  # refuses what is no argument or option of it


def test_output_that_nobody_reads_is_no_check_that_failed() -> None:
    read, write = os.pipe()
    os.close(read)
    words = [sys.executable, "-P", "-m", "flexslew_lab.cli.main", "--help"]
    done = subprocess.run(words, stdout=write, stderr=subprocess.PIPE, check=False)
    os.close(write)
    assert (done.returncode, done.stderr) == (141, b"")
