"""Subcommand that searches for the gains of a trial's law."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from flexslew_lab.cli.log import exit_unless
from flexslew_lab.cli.options.option_groups import expand_options
from flexslew_lab.cli.options.shared import Json, PageFile, Sets, TrialFile
from flexslew_lab.cli.terminal import link, print_message, print_table
from flexslew_lab.json_text import json_text
from flexslew_lab.progress import display_progress
from flexslew_lab.trial.outputs import check_output_file, new_file
from flexslew_plant.errors import BadInput
from flexslew_plant.extras import required


@dataclass(frozen=True)
class SearchOptions:
    """How gains are searched for."""

    margin: Annotated[
        float | None,
        typer.Option(min=1e-6, max=2.0, help="Disk margin to be kept; default: the trial's own."),
    ] = None
    trials: Annotated[int, typer.Option(min=1, max=100_000, help="Number of gains tried.")] = 200
    octaves: Annotated[
        float,
        typer.Option(min=0.01, max=20.0, help="Largest change of a gain, in factors of 2."),
    ] = 2.0
    journal: Annotated[
        Path | None,
        typer.Option(help="A file that notes every choice: the same command goes on from there."),
    ] = None
    seed: Annotated[int, typer.Option(min=0, help="Seed of the search.")] = 1


@expand_options
def gains(
    file: TrialFile = None,
    sets: Sets = None,
    controller: Annotated[
        str | None, typer.Option(help="Controller of the trial; default: the one in charge.")
    ] = None,
    gain: Annotated[
        list[str] | None,
        typer.Option(help="Gain to vary; may be repeated; default: all gains of the law."),
    ] = None,
    *,
    search: SearchOptions,
    out: PageFile = None,
    as_json: Json = False,
) -> None:
    """Find gains of a law with the least worst residual that keep a disk margin.

    Every choice flies the trial's manoeuvre on benches with errors of stiffness and payload. Exit
    code 1: nothing better than the trial's own gains was found.

    Example: `./flexslew gains m1 --trials 400 --journal m1_gains.log`
    """
    required("optuna")  # its extra brings pyarrow, too
    from flexslew_lab.gains.ensemble import GainEnsemble, gains_of
    from flexslew_lab.gains.page import columns, gains_page, summary_rows
    from flexslew_lab.gains.search import search_gains
    from flexslew_lab.report.page import write_page
    from flexslew_lab.trial.sources import read_trial

    requested, source = read_trial(file, sets)
    if search.journal is not None:
        check_output_file(search.journal, "--journal", file)
        if out is not None and out.resolve() == search.journal.resolve():
            raise BadInput(f"--out: {out} is the file of --journal, too; give another name")
    target = check_output_file(out or new_file(f"{requested.name}-gains.html"), "--out", file)
    selected = gains_of(requested, source, controller, gain or ())
    with display_progress(requested.name, "choices", "flying") as update:
        found = search_gains(
            GainEnsemble(requested, source, selected),
            selected,
            search.trials,
            search.octaves,
            search.margin,
            search.journal,
            search.seed,
            update,
        )
    if as_json:
        print(json_text(found.plain()))
    else:
        print_table(columns(found), summary_rows(found))
        print_message(found.verdict)
    if out is not None or not as_json:
        print_message(f"written {link(write_page(gains_page(found, requested.name), target))}")
    exit_unless(found.gain > 0.0)
