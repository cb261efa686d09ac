"""Subcommand that writes the linear model of a trial to a file."""

from pathlib import Path
from typing import Annotated

import typer

from flexslew_lab.cli.options.quantity import quantity
from flexslew_lab.cli.options.shared import Sets, TrialFile
from flexslew_lab.cli.terminal import print_message, print_table
from flexslew_lab.named import names_in
from flexslew_lab.trial.outputs import check_output_file
from flexslew_plant.errors import BadInput
from flexslew_plant.keys.units import is_quantity
from flexslew_plant.near_names import spelling_hint

At = Annotated[
    float | None,
    typer.Option(
        parser=quantity("s"),
        help="Linearise about the plan's position at this simulated time [s].",
    ),
]
Joints = Annotated[
    list[str] | None,
    typer.Option(
        "--rest", help="joint=position, where it rests [rad or m, or 30 deg]; may be repeated."
    ),
]


def model(
    to: Annotated[Path, typer.Option(help="The file: .mat, .npz or .json.")],
    file: TrialFile = None,
    sets: Sets = None,
    at: At = None,
    rest: Joints = None,
    sampled: Annotated[
        bool, typer.Option("--sampled", help="As the bench ticks: hold, delay, motor lag.")
    ] = False,
    outputs: Annotated[
        str | None, typer.Option(help="These alone: position.yaw,rate.yaw; default: all.")
    ] = None,
    minimal: Annotated[
        bool, typer.Option("--minimal", help="Without states that nothing moves or sees.")
    ] = False,
) -> None:
    """Write the small motions of a trial's testbed about a rest, with named signals, to a file.

    Example: `./flexslew model m1 --at 25 --sampled --to plant.mat`
    """
    from flexslew_control.analysis.minimal import minimal_part
    from flexslew_control.analysis.model_file import save_model
    from flexslew_lab.analysis.trial_models import model_of, point_of
    from flexslew_lab.trial.sources import read_trial

    check_output_file(to, "--to", file)
    requested, _ = read_trial(file, sets)
    point = point_of(requested, at, joints_of(rest))
    system = model_of(point, sampled)
    if outputs is not None:
        system = system.rows(_require_known(names_in(outputs), system.outputs))
    if minimal:
        system = minimal_part(system)
    save_model(system, to)
    for kind in point.left_out:
        print_message(f"left out: {kind}")
    rows = [
        ("inputs", ", ".join(system.inputs)),
        ("outputs", ", ".join(system.outputs)),
        ("states", ", ".join(system.states)),
        ("Ts [s]", f"{system.period:g}" if sampled else "0 (continuous)"),
    ]
    print_table(("", str(to)), rows)


def _require_known(names: list[str], outputs: tuple[str, ...]) -> list[str]:
    for name in names or [""]:
        if name not in outputs:
            hint = spelling_hint(name, outputs)
            raise BadInput(f"--outputs: no {name!r}; {hint}allowed: {', '.join(outputs)}")
    return names


def joints_of(assignments: list[str] | None) -> dict[str, float | str]:
    """Return `joint=position` as positions by name.

    Raises:
        BadInput: there is no `=`, or no number behind it.
    """
    found: dict[str, float | str] = {}
    for assignment in assignments or []:
        name, sign, value = assignment.partition("=")
        try:
            found[name.strip()] = value if is_quantity(value) else float(value)
        except ValueError:
            sign = ""
        if not sign:
            raise BadInput(f"--rest: {assignment}: give joint=position, for example yaw=0.5")
    return found
