"""Subcommands that need a checkout: benchmarks and tests."""

import subprocess
import sys
from contextlib import chdir
from pathlib import Path
from typing import Annotated

import typer

from flexslew_lab.background import machine_code_log, wait_for
from flexslew_lab.cli.log import exit_unless
from flexslew_lab.cli.options.shared import Json
from flexslew_lab.cli.suite import (
    NO_TESTS_EXIT_CODE,
    Selection,
    exit_code,
    parts,
    read_selection,
)
from flexslew_lab.cli.terminal import for_people, print_message, print_table
from flexslew_lab.json_text import json_text
from flexslew_plant.errors import BadInput
from flexslew_plant.extras import EXTRAS, LOCK, WITH_PIP

# they take long, or much of the machine
LONG = ("console", "day", "gains", "identification", "margins", "study_bad_days")
_IN_A_CHECKOUT = "tests and benchmarks are in the source tree; run ./flexslew in a checkout"


def bench(
    names: Annotated[
        list[str] | None, typer.Argument(help="Only these files of benchmarks/.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Run the benchmarks, each figure with a reference floor measured in the same run.

    Only when named: `console`, a page beside a bench; `day`, memory and reading over a run of
    FLEXSLEW_BENCH_HOURS (24); `gains`, a search beside an exhaustive grid; `identification`,
    hundreds of shaken benches; `margins`, each law's margins flown on six testbeds; and
    `study_bad_days`, a study that is killed, robbed of a process and of its disk.

    Example: `./flexslew bench planning --json`
    """
    folder = _root() / "benchmarks"
    known = sorted(path.stem for path in folder.glob("*.py"))
    for name in names or ():
        if name not in known:
            raise BadInput(f"{name} is not a benchmark; allowed: {', '.join(known)}")
    _wait_for_machine_code()
    figures: dict[str, float] = {}
    failed: dict[str, str] = {}
    for name in names or [name for name in known if name not in LONG]:
        with for_people.status(f"measuring {name}"):
            try:
                figures |= _figures_of(name, folder / f"{name}.py")
            except Exception as error:  # the figures of the others are not lost with it
                failed[name] = f"{type(error).__name__}: {' '.join(str(error).split())}"
                print_message(f"{name}: {failed[name]}", head="failed: ")
    if as_json:
        print(json_text(figures))
    else:
        print_table(("figure", "value"), [(k, f"{v:.4g}") for k, v in figures.items()])
    exit_unless(not failed)


def _figures_of(name: str, path: Path) -> dict[str, float]:
    """Return what a file of benchmarks/ measures."""
    import importlib.util

    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # a kernel that is kept for later runs is found by this name
    # where the processes that it starts look for it, and it for what it shares with tests
    sys.path += [str(p) for p in (path.parent, path.parent.parent) if str(p) not in sys.path]
    spec.loader.exec_module(module)
    figures: dict[str, float] = module.figures()
    return figures


def extras(
    names: Annotated[
        list[str] | None, typer.Argument(help="Of the extras; left out: all, about 690 MB.")
    ] = None,
) -> None:
    """Install what tests, benchmarks and further commands need, once.

    A command that lacks a package names the extra that has it.

    Example: `./flexslew extras console export`
    """
    known = ", ".join(sorted({*EXTRAS.values()} - {WITH_PIP}))
    root = _root(f"this is no checkout: pip install 'flexslew[EXTRA]'; extras: {known}")
    locked = sorted(path.name.split(".")[2] for path in (root / "setup").glob(LOCK.format("*")))
    for name in names or ():
        if name not in locked:
            raise BadInput(f"{name} is no extra; allowed: {', '.join(locked)}")
    print_message(
        f"installed: {', '.join(names or locked)}"
    )  # ./flexslew has done it before this call


def run_tests(
    context: typer.Context,
    everything: Annotated[
        bool,
        typer.Option("--all", help="Also what is marked ros, browser, campaign, matrix, slow."),
    ] = False,
) -> None:
    """Run the tests; all other arguments are passed on to pytest.

    Every property is checked once. With --all also over ROS and in a browser beyond the
    representatives, in all random cases, in full products and in long runs. A file that is named
    runs whole, and so do campaigns with --cases; an expression of -m replaces the selection.

    As many tests run side by side as there are processors, at most eight: first those that need
    no ROS, then those over ROS, and at last, alone, those against the wall clock. A failed test
    is not repeated.

    Example: `./flexslew test tests/plant -k energy`
    """
    _wait_for_machine_code()
    with chdir(_root()):
        selection = read_selection(context.args) if context.args else Selection()
        if isinstance(selection, int):
            raise typer.Exit(selection)
        codes = []
        for part in parts(selection, everything):
            codes.append(_pytest(*part))
            if selection.stops and codes[-1] not in (0, NO_TESTS_EXIT_CODE):
                break
    raise typer.Exit(exit_code(codes))


def _wait_for_machine_code() -> None:
    """Return when all is there that the set-up compiles in the background."""
    with for_people.status("waiting for the machine code of the models"):
        wait_for(machine_code_log())


def _pytest(*arguments: str) -> int:
    """Return the exit code of pytest; one that a signal ended has 128 and its number."""
    command = [sys.executable, "-P", "-m", "pytest", *arguments]
    code = subprocess.run(command, check=False).returncode
    return code if code >= 0 else 128 - code


def _root(otherwise: str = _IN_A_CHECKOUT) -> Path:
    """Return the root of the checkout, above ros2_ws.

    Raises:
        BadInput: there is none; `otherwise`.
    """
    for folder in Path(__file__).resolve().parents:
        if (folder / "benchmarks").is_dir() and (folder / "tests").is_dir():
            return folder
    raise BadInput(otherwise)
