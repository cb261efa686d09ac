"""Progress: compilations, phases with counts and the time left, on each kind of output."""

import os
import subprocess
import sys
from collections.abc import Callable
from io import StringIO
from pathlib import Path
from queue import Queue
from types import SimpleNamespace

import pytest
from rich.console import Console

from flexslew_lab import progress
from flexslew_lab.cli.terminal import for_people
from flexslew_lab.progress import CompileReport, display_progress, phase

OWN = """
import sys
from flexslew_lab.progress import display_library_progress
from flexslew_plant.hardware.friction import friction_velocity
with display_library_progress("first"):
    print(friction_velocity(0.7, 0.3, 4.0, 0.0, 1e-4, 0.5))
"""


@pytest.mark.slow
def test_a_first_use_says_that_it_compiles(tmp_path: Path) -> None:
    printed = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", OWN],
            env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        )
        assert float(done.stdout) > 0.0
        printed.append(done.stderr)
    assert printed[0].startswith("compiling machine code for a first use")
    assert "friction.friction_velocity" in printed[0]
    assert printed[0].count("\n") == 1
    assert printed[1] == ""


def test_a_long_compilation_says_how_far_it_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = iter([0.0, 1.0, 6.0, 7.0, 12.0])
    monkeypatch.setattr(progress, "monotonic", lambda: next(clock))
    report = CompileReport()
    for name in "abcde":
        report(name)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3
    assert lines[1:] == [
        "compiling: 3 functions so far, 6 s, now c",
        "compiling: 5 functions so far, 12 s, now e",
    ]


@pytest.fixture
def line(monkeypatch: pytest.MonkeyPatch) -> Callable[[], str]:
    """Return a function that gives the line of the open display; the clock is at `seconds`."""
    monkeypatch.setattr(progress, "_LINE_PERIOD", 1e6)
    return lambda: progress._display.get().line  # type: ignore[union-attr]


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Return the time that the display reads [wall s], to be set."""
    now = [0.0]
    monkeypatch.setattr(progress, "monotonic", lambda: now[0])
    return now


def test_a_line_has_what_is_done_how_much_of_it_and_the_time_left(
    line: Callable[[], str], clock: list[float]
) -> None:
    with display_progress("robust"), phase("flying", "trials") as count:
        for step in range(10):
            clock[0] = 40.0 + 5.0 * step
            count(100 + 50 * step, 1000)
            if step == 1:
                first = line()
        assert line() == "robust: flying, 550 of 1000 trials, 0:01:25 so far, 0:00:45 left"
    assert first == "robust: flying, 150 of 1000 trials, 0:00:45 so far, estimating the time left"


def test_the_innermost_phase_is_shown_and_then_the_one_around_it(
    line: Callable[[], str], clock: list[float]
) -> None:
    with display_progress("m1", "ticks", "flying") as count:
        with phase("planning by minimax", "iteration") as planned:
            assert line() == "m1: planning by minimax, 0:00:00 so far"
            planned(7, 0)
            clock[0] = 61.0
            assert line() == "m1: planning by minimax, iteration 7, 0:01:01 so far"
        count(1000, 4000)
        assert line().startswith("m1: flying, 1000 of 4000 ticks, 0:01:01 so far")
        with display_progress("inner", words="writing"):  # a display is open already
            assert line().startswith("m1: writing, ")


def test_a_phase_without_a_display_shows_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with phase("planning") as count:
        count(1, 2)
    assert capsys.readouterr() == ("", "")


def test_a_phase_that_fails_is_shown_no_longer(line: Callable[[], str]) -> None:
    with display_progress("m1", words="flying"):
        with pytest.raises(ValueError, match="no plan"), phase("planning"):
            raise ValueError("no plan")
        assert line().startswith("m1: flying, ")


def test_the_log_of_a_batch_queue_has_a_line_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress, "_LINE_PERIOD", 0.01)
    monkeypatch.setattr(for_people, "_force_terminal", False)
    printed = ""
    with display_progress("robust", words="flying"):  # it says nothing of its own
        while printed.count("\n") < 2:
            printed += capsys.readouterr().err
    assert printed.splitlines()[0] == "robust: flying, 0:00:00 so far"


def test_a_terminal_has_a_bar_that_is_gone_at_the_end(
    monkeypatch: pytest.MonkeyPatch, line: Callable[[], str]
) -> None:
    terminal = StringIO()
    console = Console(file=terminal, force_terminal=True, width=100, _environ={"TERM": "xterm"})
    monkeypatch.setattr("flexslew_lab.cli.terminal.for_people", console)
    with display_progress("m1", "ticks", "flying") as count:
        count(1000, 4000)
        progress._display.get()._bar.refresh()  # type: ignore[union-attr]
        assert "m1: flying, 1000 of 4000 ticks" in terminal.getvalue()
        assert "estimating the time left" in terminal.getvalue()
    assert terminal.getvalue().endswith("\x1b[2K")  # the line is erased


def test_a_notebook_has_a_line_that_is_replaced_and_gone_at_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shows: Queue[dict[str, str]] = Queue()
    handle = SimpleNamespace(update=lambda data, raw: shows.put(data))
    stub = SimpleNamespace(display=lambda data, raw, display_id: handle)
    monkeypatch.setitem(sys.modules, "IPython.display", stub)
    monkeypatch.setattr(progress, "_NOTEBOOK_PERIOD", 0.01)
    console = Console(file=StringIO(), force_jupyter=True)
    monkeypatch.setattr("flexslew_lab.cli.terminal.for_people", console)
    with display_progress("m1", words="flying"):
        CompileReport()("kernel")
        assert any(
            "compiling machine code" in shows.get(timeout=60)["text/plain"] for _ in range(9)
        )
    while not shows.empty():
        last = shows.get()
    assert last == {}
