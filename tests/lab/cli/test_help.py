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
from tests.lab.conftest import Call
from typer.main import get_command

from flexslew_lab.cli.main import app

ROOT = Path(__file__).parents[3]


WIDTH = 78  # of the text where a terminal is 80 wide; a command that is broken cannot be pasted


def commands(within: Any, *path: str) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield every command and group below one, with the words that call it."""
    for name, command in getattr(within, "commands", {}).items():
        yield (*path, name), command
        yield from commands(command, *path, name)


def test_the_version_is_that_of_the_package(call: Call) -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert call("--version") == (0, f"flexslew {version}\n", "")


def test_help_comes_in_groups_and_a_flag_has_no_type(call: Call) -> None:
    whole = call("--help")[1]
    assert whole.index("Fly and plan") < whole.index("Operate a running bench")
    assert "─ Commands" not in whole  # nothing stands outside of the groups
    for words in (["--help"], ["trial", "--help"], ["study", "run", "--help"]):
        assert "bool" not in call(*words)[1]
    assert "<float>" in call("trial", "--help")[1]


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("flexslew trial swap", ["swap_demo"]),
        ("flexslew comp", ["compare", "completion"]),
        ("flexslew trial --in", ["--in-process"]),
        ("flexslew study re", ["report"]),
    ],
)
def test_a_shell_completes_commands_and_trials(line: str, found: list[str], call: Call) -> None:
    words = line.split()
    ask = f"COMP_WORDS=({shlex.join(words)}) COMP_CWORD={len(words) - 1} && _flexslew"
    script = f"{call('completion', 'bash')[1]}\n{ask}\nprintf '%s ' ${{COMPREPLY[@]}}"
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
