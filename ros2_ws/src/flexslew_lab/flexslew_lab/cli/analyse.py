"""Subcommand that analyses what flies in a trial."""

from dataclasses import dataclass
from shlex import join
from typing import TYPE_CHECKING, Annotated

import typer

from flexslew_lab.cli.log import exit_unless
from flexslew_lab.cli.model import At, Joints, joints_of
from flexslew_lab.cli.options.option_groups import expand_options
from flexslew_lab.cli.options.shared import Json, PageFile, Sets, TrialFile
from flexslew_lab.cli.terminal import link, print_message, print_table, print_verdict
from flexslew_lab.json_text import finite, json_text
from flexslew_lab.progress import display_progress
from flexslew_lab.trial.outputs import check_output_file, new_file
from flexslew_plant.errors import BadInput

if TYPE_CHECKING:
    from flexslew_lab.analysis.analysis import Analysis
    from flexslew_lab.analysis.proof import Proof
    from flexslew_lab.guarantee.flight import Guarantee


@dataclass(frozen=True)
class CheckOptions:
    """What is proved about the loop."""

    prove: Annotated[
        bool, typer.Option("--prove", help="Fly the bench on both sides of each margin.")
    ] = False
    guarantee: Annotated[
        bool, typer.Option("--guarantee", help="Certify the loop for all values in --vary.")
    ] = False
    vary: Annotated[
        list[str] | None,
        typer.Option(help="name=20% or name=low..high, an uncertain parameter; may be repeated."),
    ] = None


@expand_options
def analyse(
    file: TrialFile = None,
    sets: Sets = None,
    controller: Annotated[
        str | None, typer.Option(help="Controller of the trial; default: the one in charge then.")
    ] = None,
    at: At = None,
    rest: Joints = None,
    out: PageFile = None,
    *,
    checks: CheckOptions,
    as_json: Json = False,
) -> None:
    """Show modes, poles, margins and responses of a trial's loop after its manoeuvre.

    `--at` takes another time, `--rest` another place. The law's linear form is taken from its
    running code. `--guarantee` bounds the worst case over stiffness and payload +-20 %, or what
    `--vary` names; with `--prove` the nearest unstable loop is flown. Exit code 1: the loop is not
    stable or not guaranteed, or what was flown is not what was predicted.

    Example: `./flexslew analyse m1 --at 25`
    """
    from flexslew_lab.analysis.analysis import loop_analysis
    from flexslew_lab.analysis.page import analysis_page, summary_rows
    from flexslew_lab.analysis.proof import verify_margins
    from flexslew_lab.analysis.proof_tables import MARGIN_COLUMNS, margin_rows
    from flexslew_lab.guarantee.flight import guarantee_of
    from flexslew_lab.guarantee.model.parameters import vary_of
    from flexslew_lab.guarantee.tables import GAIN_COLUMNS, gain_rows, worst_case_sections
    from flexslew_lab.guarantee.worst_case import WORST_COLUMNS
    from flexslew_lab.report.page import write_page
    from flexslew_lab.trial.sources import read_trial

    if checks.vary and not checks.guarantee:
        raise BadInput("--vary: only with --guarantee")
    requested, source = read_trial(file, sets)
    target = check_output_file(out or new_file(f"{requested.name}-analysis.html"), "--out", file)
    with display_progress(requested.name, words="analysing"):
        found = loop_analysis(requested, source, controller, at, joints_of(rest))
    for words in found.point.warnings:
        print_message(f"warning: {words}")
    proof = None
    if checks.prove:
        with display_progress(requested.name, words="flying at both sides of the margins"):
            proof = verify_margins(requested, found)
    worst = None
    if checks.guarantee:
        with display_progress(requested.name, words="bounding the worst case"):
            worst = guarantee_of(requested, found, vary_of(checks.vary or []) or None, checks.prove)
    if as_json:
        report: dict[str, object] = {} if proof is None else {"proof": finite(proof.plain())}
        if worst is not None:
            report["guarantee"] = worst.plain()
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
        if worst is not None:
            print_verdict(worst.verdict)
            print_table(WORST_COLUMNS, worst.found.rows)
            print_table(GAIN_COLUMNS, gain_rows(worst.found))
    if out is not None or not as_json:
        line = _command(requested.name, file, sets, found, checks)
        more = [] if worst is None else worst_case_sections(worst, line)
        page = write_page(analysis_page(found, requested.name, proof, more), target)
        print_message(f"written {link(page)}")
    exit_unless(_fulfilled(found, proof, worst))


def _command(
    name: str, file: str | None, sets: list[str] | None, found: "Analysis", checks: CheckOptions
) -> str:
    """Return the line of a shell that repeats the analysis, and flies what it finds."""
    words = ["./flexslew", "analyse", file or name]
    for option, values in (("--set", sets), ("--vary", checks.vary)):
        words += [word for value in values or [] for word in (option, value)]
    words += ["--controller", found.controller, "--at", f"{found.point.rest.time:.9g}"]
    return join([*words, "--guarantee", "--prove"])


def _fulfilled(found: "Analysis", proof: "Proof | None", worst: "Guarantee | None") -> bool:
    """Return whether the loop is stable, and what was proved or guaranteed holds."""
    return found.stable and (proof is None or proof.holds) and (worst is None or worst.holds)
