"""Subcommands that replay a log: resimulate it, or check a controller."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from flexslew_lab.cli.log import exit_unless
from flexslew_lab.cli.options.option_groups import expand_options
from flexslew_lab.cli.options.shared import Bag, Json, TrustOption
from flexslew_lab.cli.options.with_command import Patience, With, program_of
from flexslew_lab.cli.terminal import (
    link,
    print_line,
    print_message,
    print_table,
)
from flexslew_lab.json_text import json_text
from flexslew_lab.progress import display_progress
from flexslew_lab.trial.outputs import bag_folder, check_output_file
from flexslew_plant.counted import count_text
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import Trust


@dataclass(frozen=True)
class LogOptions:
    """What a replay accepts of a log."""

    partial: Annotated[
        bool, typer.Option("--partial", help="The log holds a part of the run: accept that part.")
    ] = False
    trust: TrustOption = None


@dataclass(frozen=True)
class ProgramOptions:
    """The program that answers instead of a law."""

    command: With = None
    patience: Patience = 10.0


@dataclass(frozen=True)
class ToleranceOptions:
    """The differences that count as equal."""

    tolerance: Annotated[
        float,
        typer.Option(min=0.0, help="Accepted difference, of the field's largest magnitude [-]."),
    ] = 0.0
    absolute: Annotated[
        float, typer.Option(min=0.0, help="Accepted difference, in the field's unit, added to it.")
    ] = 0.0


@dataclass(frozen=True)
class LawOptions:
    """What replaces the recorded law."""

    law: Annotated[str | None, typer.Option(help="Law instead of the recorded one.")] = None
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set", help="key=value in YAML, replaces the recorded one; may be repeated."
        ),
    ] = None


@expand_options
def resim(
    bag: Bag,
    *,
    elsewhere: Annotated[
        bool, typer.Option(help="Recorded on another build or processor: accept rounding.")
    ] = False,
    sets: Annotated[
        list[str] | None,
        typer.Option(
            "--set", help="key.path=value of the trial but its plan: what does it change?"
        ),
    ] = None,
    command: With = None,
    controller: Annotated[
        str,
        typer.Option(
            help="With --with: the controller of the log that COMMAND replaces; default: "
            "the one that was a program, or the first active one."
        ),
    ] = "",
    patience: Patience = 10.0,
    accepted: LogOptions,
    as_json: Json = False,
) -> None:
    """Simulate a run again from its log alone and compare the trajectory.

    The exit code is 1 unless every bit is the same; --elsewhere accepts a difference of each field
    of up to 1e-9 of its largest magnitude. A law or a testbed from a file or a module runs only if
    --trust names it. A controller that was a program of its own flies again with --with.

    Example: `./flexslew resim runs/m1-20260101-120000`
    """
    from flexslew_lab.replay.resim import TOLERANCE
    from flexslew_lab.replay.resim import resim as fly_again
    from flexslew_lab.trial.sources import changes_of

    if controller and command is None:
        raise BadInput(
            "is the controller that --with COMMAND replaces; add that option", key="--controller"
        )
    program = program_of(command, patience)
    with display_progress("resim", "ticks") as update:
        result = fly_again(
            bag_folder(bag),
            update,
            changes_of(sets),
            Trust.of(accepted.trust or ()),
            program,
            controller,
        )
    first = result.first_difference
    if as_json:
        values = {**result._asdict(), "first_difference": first and first._asdict()}
        values |= {"within_tolerance": result.within_tolerance, "tolerance": TOLERANCE}
        print(json_text(values))
    else:
        replay_counts = ", ".join(
            f"{count} {kind}" for kind, count in result.replayed.items() if count
        )
        rows = [
            ("recorded", result.recorded_hash),
            ("again", result.hash),
            ("ticks", f"{result.ticks}"),
            ("from the log", replay_counts or "no request of an operator, no missed tick"),
            *((f"largest of {name}", f"{value:.3g}") for name, value in result.largest.items()),
            *(
                (f"version of {n}", f"{a} there, {b} here")
                for n, (a, b) in result.other_versions.items()
            ),
        ]
        print_table(("", "bit-identical" if result.identical else "DIFFERENT"), rows)
        if first is not None:
            print_line(
                f"first difference: tick {first.tick} of epoch {first.epoch}, {first.field}: "
                f"recorded {first.recorded!r}, here {first.ours!r}"
            )
    _print_coverage(result.missing, result.changed_code)
    exit_unless(result.identical or (elsewhere and result.within_tolerance))
    exit_unless(accepted.partial or not result.missing)


@expand_options
def check(
    bag: Bag,
    controller: Annotated[
        str,
        typer.Argument(
            help="Name of the controller in the log; default: the first active one, or with --with "
            "the one that was a program."
        ),
    ] = "",
    *,
    program: ProgramOptions,
    tolerance: ToleranceOptions,
    replacement: LawOptions,
    figure: Annotated[Path | None, typer.Option(help="Draw the differences as HTML.")] = None,
    accepted: LogOptions,
    as_json: Json = False,
) -> None:
    """Feed recorded measurements to a controller and compare every number of its answers.

    With --with, a program of its own in whatever language answers instead of a law, and the
    efforts of its commands are compared. The exit code is 1 if any number differs by more than
    the tolerance.

    Example: `./flexslew check runs/m1-20260101-120000 pd_feedforward`
    """
    from flexslew_lab.replay.check import AnswerTolerance, difference_page
    from flexslew_lab.replay.check import check as compare

    if program.command is not None and (replacement.law or replacement.settings):
        raise BadInput("--law and --set change a law of the bench; leave them out", key="--with")
    start = program_of(program.command, program.patience)
    if figure is not None:
        check_output_file(figure, "--figure")
    with display_progress("check", "ticks") as update:
        result = compare(
            bag_folder(bag),
            controller,
            replacement.law,
            _settings(replacement.settings or []),
            update,
            Trust.of(accepted.trust or ()),
            start,
            AnswerTolerance(tolerance.tolerance, tolerance.absolute),
        )
    if figure is not None:
        from flexslew_lab.report.page import write_page

        print_message(f"drawn {link(write_page(difference_page(result), figure))}")
    first = result.first_divergence
    if as_json:
        values = result._asdict()
        del values["curves"]
        values["first_divergence"] = first and {k: _plain(v) for k, v in first._asdict().items()}
        values["rows"] = [row._asdict() for row in result.rows]
        print(json_text(values))
    else:
        columns = ("field", "compared", "different", "first tick", "largest", "relative")
        rows = [
            (
                *row[:3],
                "-" if row.first_tick is None else row.first_tick,
                f"{row[4]:.3g}",
                f"{row[5]:.3g}",
            )
            for row in result.rows
        ]
        print_table(columns, rows)
        print_line(
            f"{result.controller} ({result.law}): {count_text(result.ticks, 'answer')} compared, "
            f"{result.only_recorded} only in the log, {result.only_ours} only from this controller"
        )
        if first is not None:
            print_line(
                f"first divergence: tick {first.tick} of epoch {first.epoch}, {first.field}: "
                f"recorded {first.recorded!r}, here {first.ours!r}"
            )
    _print_coverage(result.missing, result.changed_code)
    exit_unless(result.ok and (accepted.partial or not result.missing))


def _print_coverage(missing: str, changed: dict[str, tuple[str, str]]) -> None:
    """Print what a comparison does not cover, and the code that differs from the recorded one."""
    for name, (recorded, here) in changed.items():
        print_message(
            f"{name} is another file: SHA-256 {recorded[:16]} in the log, {here[:16]} here"
        )
    if missing:
        print_message(missing, head="partial: ")


def _settings(pairs: list[str]) -> dict[str, Any]:
    """Return `key=value` texts as settings; dots nest."""
    from flexslew_lab.trial.overrides import override_values
    from flexslew_plant.yaml_data import load_yaml

    settings: dict[str, Any] = {}
    for pair in pairs:
        key, sign, text = pair.partition("=")
        if not (key and sign):
            raise BadInput(f"--set: {pair!r} is not of the form key=value")
        settings[key] = load_yaml(text, f"--set {key}")
    return override_values({}, settings)


def _plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else value
