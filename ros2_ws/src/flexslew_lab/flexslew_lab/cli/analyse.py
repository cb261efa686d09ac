"""Subcommand that analyses what flies in a trial."""

from pathlib import Path
from typing import Annotated

import typer

from flexslew_lab.cli.compare import Sets, TrialFile
from flexslew_lab.cli.log import Json
from flexslew_lab.cli.model import At, Joints, joints_of
from flexslew_lab.cli.terminal import link, print_message, print_table, print_verdict
from flexslew_lab.json_text import json_text
from flexslew_lab.progress import display_progress
from flexslew_lab.trial.outputs import check_output_file, new_file


def analyse(
    file: TrialFile = None,
    sets: Sets = None,
    controller: Annotated[
        str | None, typer.Option(help="Controller of the trial; default: the one in charge then.")
    ] = None,
    at: At = None,
    rest: Joints = None,
    out: Annotated[
        Path | None, typer.Option(help="HTML file; default: a new one below runs/.")
    ] = None,
    prove: Annotated[
        bool, typer.Option("--prove", help="Fly the bench on both sides of each margin.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Show modes, poles, margins and responses of a trial's loop after its manoeuvre.

    `--at` takes another time, `--rest` another place. The law's linear form is taken from its
    running code. Exit code 1: the loop is not stable, or what was flown is not what was predicted.

    Example: `./flexslew analyse m1 --at 25`
    """
    from flexslew_lab.analysis.analysis import finite, loop_analysis
    from flexslew_lab.analysis.page import analysis_page, summary_rows
    from flexslew_lab.analysis.proof import verify_margins
    from flexslew_lab.analysis.proof_tables import MARGIN_COLUMNS, margin_rows
    from flexslew_lab.report.page import write_page
    from flexslew_lab.trial.sources import read_trial

    requested, source = read_trial(file, sets)
    target = check_output_file(out or new_file(f"{requested.name}-analysis.html"), "--out", file)
    with display_progress(requested.name, words="analysing"):
        found = loop_analysis(requested, source, controller, at, joints_of(rest))
    for words in found.point.warnings:
        print_message(f"warning: {words}")
    proof = None
    if prove:
        with display_progress(requested.name, words="flying at both sides of the margins"):
            proof = verify_margins(requested, found)
    if as_json:
        report = {} if proof is None else {"proof": finite(proof.plain())}
        print(json_text({**found.plain(), **report}))
    else:
        for kind in found.point.left_out:
            print_message(f"left out: {kind}")
        print_verdict(found.verdict)
        print_table(("", found.controller), summary_rows(found))
        if proof is not None:
            print_table(MARGIN_COLUMNS, margin_rows(proof))
            for words in proof.skipped:
                print_message(f"not flown: {words}")
    if out is not None or not as_json:
        page = write_page(analysis_page(found, requested.name, proof), target)
        print_message(f"written {link(page)}")
    if not found.stable or (proof is not None and not proof.holds):
        raise typer.Exit(1)
