"""Subcommand that flies one manoeuvre with every planner, or with every law."""

import os
from typing import Annotated

import typer

from flexslew_lab.cli.options.shared import Json, PageFile, Sets, TrialFile, Workers
from flexslew_lab.cli.terminal import link, print_message, print_table, print_verdict
from flexslew_lab.json_text import json_text
from flexslew_lab.progress import display_progress
from flexslew_lab.trial.outputs import check_output_file, new_file


def compare(
    file: TrialFile = None,
    sets: Sets = None,
    by_law: Annotated[bool, typer.Option("--laws", help="Compare laws, not planners.")] = False,
    workers: Workers = None,
    out: PageFile = None,
    as_json: Json = False,
) -> None:
    """Fly one manoeuvre with every planner, or every law, also on testbeds with model errors.

    Example: `./flexslew compare antenna_2 --laws --out laws.html`
    """
    from flexslew_lab.comparison.comparison import compare_candidates
    from flexslew_lab.comparison.laws import laws
    from flexslew_lab.comparison.page import comparison_page
    from flexslew_lab.comparison.planners import planners
    from flexslew_lab.comparison.winners import verdict
    from flexslew_lab.report.page import write_page
    from flexslew_lab.trial.sources import read_trial

    requested, source = read_trial(file, sets)
    words = "laws" if by_law else "compare"
    target = check_output_file(out or new_file(f"{requested.name}-{words}.html"), "--out", file)
    comparison = (laws if by_law else planners)(requested, source)
    with display_progress("compare", "plans and flights") as on_progress:
        found = compare_candidates(comparison, on_progress, workers or os.cpu_count() or 1)
    if as_json:
        print(json_text(found.rows()))
    else:
        print_verdict(verdict(found))
        short = found.filled(found.short)
        headers = (found.word, *(column.title for column in short))
        print_table(headers, [(name, *cells) for name, cells in found.table(short)])
        if found.note:
            print_message(found.note)
        for entry in found.entries:
            if entry.refused:
                print_message(f"not flown: {entry.name}: {entry.refused}")
    if out is not None or not as_json:
        print_message(f"written {link(write_page(comparison_page(found), target))}")
