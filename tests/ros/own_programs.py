"""The controllers of docs/any_language.md as commands, with some words exchanged."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[2] / "docs/examples/any_language.py"
IN_C = EXAMPLE.with_suffix(".c")
_MISSING = [tool for tool in ("gcc", "python3-config") if shutil.which(tool) is None]
needs_gcc = pytest.mark.skipif(bool(_MISSING), reason=f"not installed: {', '.join(_MISSING)}")


def changed(example: Path, *changes: tuple[str, str]) -> str:
    """Return the text of an example with some words exchanged."""
    words = example.read_text()
    for old, new in changes:
        assert old in words
        words = words.replace(old, new)
    return words


def of_example(folder: Path, *changes: tuple[str, str]) -> list[str]:
    """Return the command of the example with some words exchanged."""
    (folder / "controller.py").write_text(changed(EXAMPLE, *changes))
    return [sys.executable, str(folder / "controller.py")]


def build_in_c(folder: Path, monkeypatch: pytest.MonkeyPatch, *changes: tuple[str, str]) -> str:
    """Return the program of the example in C with some words exchanged, and set its libraries.

    Warnings are errors.
    """
    page = (EXAMPLE.parents[1] / "any_language.md").read_text()
    block = next(block for block in page.split("```sh\n") if "gcc" in block)
    *lines, last = block.partition("\n```")[0].splitlines()
    assert last == "./flexslew conform -- ./any_language_c"
    source = folder / IN_C.relative_to(EXAMPLE.parents[2])
    source.parent.mkdir(parents=True)
    source.write_text(changed(IN_C, *changes))
    for name in ("setup", ".venv", "ros2_ws"):
        (folder / name).symlink_to(EXAMPLE.parents[2] / name)
    script = "\n".join([*lines, 'printf %s "$LD_LIBRARY_PATH"'])
    script = script.replace("gcc ", "gcc -Wall -Wextra -Werror ")
    done = subprocess.run(["bash", "-e"], input=script, cwd=folder, capture_output=True, text=True)
    assert not done.returncode, done.stderr
    monkeypatch.setenv("LD_LIBRARY_PATH", done.stdout)
    return str(folder / "any_language_c")
