"""The subcommand that lists the runs of a folder and writes the page over them."""

import os
from pathlib import Path
from typing import Annotated

import typer

from flexslew_lab.cli.log import Json
from flexslew_lab.cli.open_page import Open, open_page
from flexslew_lab.cli.terminal import link, print_message, print_table
from flexslew_lab.json_text import json_text
from flexslew_lab.short_values import short
from flexslew_lab.trial.outputs import RUNS
from flexslew_plant.errors import BadInput


def runs(
    folder: Annotated[Path, typer.Argument(help="Folder with one folder per run.")] = RUNS,
    trial: Annotated[str, typer.Option(help="Only runs of this trial.")] = "",
    law: Annotated[str, typer.Option(help="Only runs that began with this law.")] = "",
    testbed: Annotated[str, typer.Option(help="Only runs on this kind of testbed.")] = "",
    open_it: Open = False,
    as_json: Json = False,
) -> None:
    """List all runs with their key figures; write index.html, a page to filter and compare them.

    Example: `./flexslew runs --law output_feedback --open`
    """
    from flexslew_lab.report.runs_index import runs_in, write_index

    if not os.path.isdir(folder):
        raise BadInput("no such folder; a first run makes it", folder)
    found, skipped = runs_in(folder, trial, law, testbed)
    page = None
    try:
        page = write_index(folder)
    except OSError as error:  # of a folder that is there to read alone the table is enough
        if open_it:
            raise
        print_message(f"no page is written: {error.filename}: {error.strerror}")
    if skipped:
        print_message(f"not readable, left out: {', '.join(skipped)}")
    if as_json:
        rows = [run._asdict() | {"folder": str(run.folder)} for run in found]
        print(json_text(rows))
        return
    columns = ("run", "law", "testbed", "tip [m]", "settled [s]", "verdict")
    keys = ("residual_tip_deflection", "settling_time")
    print_table(
        columns,
        [
            (r.folder.name, r.law, r.testbed, *(short(r.figures[k], 3) for k in keys), r.verdict)
            for r in found
        ],
    )
    if page is not None:
        print_message(f"{link(page)}")
        if open_it:
            open_page(page)
