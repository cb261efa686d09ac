"""Subcommands of a checkout: measure the speed, run the tests."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer

from flexslew_lab.cli.log import Json
from flexslew_lab.cli.terminal import print_table, screen
from flexslew_plant.errors import BadInput

LONG = ("day",)  # benchmarks that take hours


def bench(
    names: Annotated[
        list[str] | None, typer.Argument(help="Only these files of benchmarks/.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Measure the speed, each figure beside a floor of the same run.

    `day`, memory and reading over a run of FLEXSLEW_BENCH_HOURS (24), is measured only when named.

    Example: `./flexslew bench planning --json`
    """
    import importlib.util

    folder = _root() / "benchmarks"
    known = sorted(path.stem for path in folder.glob("*.py"))
    figures: dict[str, float] = {}
    for name in names or [name for name in known if name not in LONG]:
        if name not in known:
            raise BadInput(f"{name} is not a benchmark; allowed: {', '.join(known)}")
        with screen.status(f"measuring {name}"):
            spec = importlib.util.spec_from_file_location(name, folder / f"{name}.py")
            assert spec is not None
            assert spec.loader is not None
            module = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(module)
            figures |= module.figures()
    if as_json:
        print(json.dumps(figures, indent=2))
    else:
        print_table(("figure", "value"), [(k, f"{v:.4g}") for k, v in figures.items()])


def test(context: typer.Context) -> None:
    """Run the tests; what follows goes to pytest.

    Example: `./flexslew test tests/plant -k energy`
    """
    command = [sys.executable, "-m", "pytest", *context.args]
    raise typer.Exit(subprocess.run(command, cwd=_root(), check=False).returncode)


def _root() -> Path:
    """Return the root of the checkout, above ros2_ws."""
    for folder in Path(__file__).resolve().parents:
        if (folder / "benchmarks").is_dir() and (folder / "tests").is_dir():
            return folder
    raise BadInput("tests and benchmarks are in the source tree; call ./flexslew of a checkout")
