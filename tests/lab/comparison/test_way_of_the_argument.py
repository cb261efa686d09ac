"""How far a reader of `compare` follows its file argument until all has flown, in processes.

A stop is a function of the command line or of the comparison that is handed the argument or what is
made of it, or one of another family that those hand it to: what that does inside is its own, and so
is what a process does with its case.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import pytest
from typer.testing import CliRunner

from flexslew_control.controllers.controller import Controller
from flexslew_control.plan import Plan
from flexslew_lab.cli.main import app
from flexslew_lab.comparison import comparison, laws, planners
from flexslew_lab.comparison.comparison import Candidate, Description
from flexslew_lab.trial.trial import Trial
from flexslew_plant.bench.bench import Bench
from flexslew_plant.bench.records import BenchSettings
from flexslew_plant.testbeds.oscillators.floating_oscillator import FloatingOscillatorTestbed

BOUND = 20
MADE = (Trial, BenchSettings, Plan, Bench, Controller, Description, Candidate)  # of the argument
ROOMS = tuple(f"flexslew_lab/{room}/" for room in ("cli", "comparison"))
OSCILLATOR = """
duration: 2.0
period: 0.05
testbed: {kind: floating_oscillator}
plan: {method: reference_only, goal: {mass: 0.1}, duration: 1.0}
controllers: {pd_feedforward: {kp: [0.5], kd: [1.0]}}
"""


def place(frame: FrameType | None) -> str:
    """Return the file of a function of the tree, from its package on; else nothing."""
    name = "" if frame is None else frame.f_code.co_filename
    return name[name.rfind("flexslew_") :] if "/flexslew_" in name else ""


def caller(frame: FrameType) -> FrameType | None:
    """Return what called a function, a comprehension being part of the function around it."""
    back = frame.f_back
    while back is not None and back.f_code.co_name.startswith("<") and place(back):
        back = back.f_back
    return back


def of_argument(value: Any, argument: str) -> bool:
    """Return whether a value is the argument, what is made of it, or holds such a one."""
    if isinstance(value, (str, Path)):
        return argument in str(value)
    if isinstance(value, (list, tuple)) and not isinstance(value, MADE):
        return any(of_argument(part, argument) for part in value)
    if isinstance(value, dict):
        return any(of_argument(part, argument) for part in value.values())
    return isinstance(value, (*MADE, FloatingOscillatorTestbed))


@contextmanager
def stops(argument: str) -> Iterator[set[str]]:
    """Collect the stops of a block, in this process, until all has flown."""
    found: set[str] = set()

    def called(frame: FrameType, event: str, _: Any) -> None:
        if event == "return" and frame.f_code is comparison._simulate.__code__:
            sys.setprofile(None)
        if event != "call" or not place(frame) or frame.f_code.co_name.startswith("<"):
            return
        near = (place(frame), place(caller(frame)))
        if any(part.startswith(ROOMS) for part in near):
            code = frame.f_code
            names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
            sys.setprofile(None)
            if any(of_argument(frame.f_locals.get(name), argument) for name in names):
                found.add(f"{near[0]}:{code.co_qualname}")
            sys.setprofile(called)

    sys.setprofile(called)
    try:
        yield found
    finally:
        sys.setprofile(None)


@pytest.mark.slow
@pytest.mark.parametrize("options", [[], ["--laws"]])
def test_few_functions_hand_on_the_file_of_a_comparison(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: list[str]
) -> None:
    file = tmp_path / "way.yaml"
    file.write_text(OSCILLATOR)
    # one candidate's way is that of all
    monkeypatch.setattr(planners, "PLANNERS", {})
    monkeypatch.setattr(laws, "CONTROLLERS", {})
    words = ["compare", str(file), *options, "--workers", "2", "--out", str(tmp_path / "page.html")]
    with stops(str(file)) as found:
        result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    ends = {
        "flexslew_lab/cli/compare.py:compare",
        "flexslew_lab/comparison/comparison.py:_simulate",
    }
    assert ends <= found
    assert len(found) < BOUND, "\n".join(sorted(found))
