"""A first use that compiles says so on standard error, and how far it is; a later one is silent."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from flexslew_lab.cli import compiling

OWN = """
import sys
from flexslew_lab.cli.compiling import print_compile_progress
print_compile_progress()
from flexslew_plant.hardware.friction import friction_velocity
print(friction_velocity(0.7, 0.3, 4.0, 0.0, 1e-4, 0.5))
"""


@pytest.mark.slow
def test_a_first_use_says_that_it_compiles(tmp_path: Path) -> None:
    said = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", OWN],
            env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        )
        assert float(done.stdout) > 0.0
        said.append(done.stderr)
    assert said[0].startswith("compiling machine code for a first use")
    assert "friction.friction_velocity" in said[0]
    assert said[0].count("\n") == 1
    assert said[1] == ""


def test_a_long_compilation_says_how_far_it_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = iter([0.0, 1.0, 6.0, 7.0, 12.0])
    monkeypatch.setattr(compiling, "monotonic", lambda: next(clock))
    told = compiling._CompileReport()
    for name in "abcde":
        told(name)
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 3
    assert said[1:] == [
        "compiling: 3 functions so far, 6 s, now c",
        "compiling: 5 functions so far, 12 s, now e",
    ]
