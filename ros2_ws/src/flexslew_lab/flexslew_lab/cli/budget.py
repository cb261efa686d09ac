"""Subcommand that makes the pointing budget of a trial."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flexslew_lab.budget.parts import Interpretation
from flexslew_lab.cli.log import exit_unless
from flexslew_lab.cli.options.option_groups import expand_options
from flexslew_lab.cli.options.quantity import quantity
from flexslew_lab.cli.options.shared import Json, PageFile, Sets, TrialFile
from flexslew_lab.cli.terminal import link, print_message, print_table, print_verdict
from flexslew_lab.json_text import json_text
from flexslew_lab.progress import display_progress
from flexslew_lab.trial.outputs import check_output_file, new_file
from flexslew_plant.errors import BadInput

if TYPE_CHECKING:
    from flexslew_lab.budget.budget import Budget, BudgetRequest
    from flexslew_lab.budget.prove import ProvedBudget


@dataclass(frozen=True)
class MetricOptions:
    """How errors are measured."""

    window: Annotated[
        float | None,
        typer.Option(
            parser=quantity("s"),
            help="Window of MPE, RPE and PDE [s]; default: the testbed's pointing_window, or 10 s.",
        ),
    ] = None
    drift: Annotated[
        float | None,
        typer.Option(
            parser=quantity("s"),
            help="From a window to that with which PDE compares it [s]; default: the next one.",
        ),
    ] = None
    level: Annotated[float, typer.Option(help="Level of confidence [-].")] = 0.9973
    interpretation: Annotated[
        Interpretation, typer.Option(help="Statistics: over time, over the ensemble, or both.")
    ] = "mixed"
    controller: Annotated[
        str | None, typer.Option(help="Controller of the trial; default: the active one then.")
    ] = None
    vary: Annotated[
        list[str] | None,
        typer.Option(help="name=20% or name=low..high, an error of the model; may be repeated."),
    ] = None
    require: Annotated[
        list[str] | None,
        typer.Option(help='Requirement, "APE=20 arcsec" or "RPE.x=1e-5"; may be repeated.'),
    ] = None

    def request(self) -> "BudgetRequest":
        """Return how the budget is made.

        Raises:
            BadInput: if a value is not allowed.
        """
        from flexslew_lab.budget.budget import BudgetRequest
        from flexslew_lab.budget.requirements import requirements_of
        from flexslew_lab.guarantee.model.parameters import vary_of

        vary, require = vary_of(self.vary or []), requirements_of(self.require or [])
        return BudgetRequest(**{**vars(self), "vary": vary, "require": require})


@expand_options
def budget(
    file: TrialFile = None,
    sets: Sets = None,
    *,
    metrics: MetricOptions,
    prove: Annotated[
        int | None, typer.Option(help="Fly the bench with so many seeds and compare.")
    ] = None,
    out: PageFile = None,
    table: Annotated[Path | None, typer.Option(help="The budget as a table: .tex or .csv.")] = None,
    as_json: Json = False,
) -> None:
    """Make a trial's pointing budget by error source, with the margins of requirements.

    It is that of the time after the manoeuvre: APE, MPE, RPE and PDE of ECSS-E-ST-60-10C, and the
    errors of knowledge. Noises, biases and torques go through the linear closed loop, the rest is
    flown. Exit code 1: a requirement is not met or a source is missing where there are some, or
    what was flown is not what was predicted.

    Example: `./flexslew budget three_axes --set sensors.joint_position.noise=1e-5`
    """
    from flexslew_lab.budget.page import budget_page
    from flexslew_lab.budget.pointing_budget import pointing_budget
    from flexslew_lab.budget.prove import prove_budget
    from flexslew_lab.budget.tables import write_budget_table
    from flexslew_lab.publication.figure import format_of
    from flexslew_lab.publication.metric_table import TABLE_FORMATS
    from flexslew_lab.report.page import write_page
    from flexslew_lab.trial.sources import read_trial

    request = metrics.request()
    if prove is not None and prove < 2:
        raise BadInput("at least 2 members", key="--prove", value=prove)
    requested, source = read_trial(file, sets)
    target = check_output_file(out or new_file(f"{requested.name}-budget.html"), "--out", file)
    if table is not None:
        format_of(table, "--table", TABLE_FORMATS)
    with display_progress(requested.name, words="adding up error sources"):
        found = pointing_budget(requested, source, request)
    proof = None
    if prove is not None:
        with display_progress(requested.name, "members", "flying") as update:
            proof = prove_budget(requested, source, found, prove, update)
    if as_json:
        report = {} if proof is None else {"proof": proof.plain()}
        print(json_text({**found.plain(), **report}))
    else:
        _print_budget(found, proof)
    if table is not None:
        write_budget_table(found, table)
        print_message(f"written {link(table)}")
    if out is not None or not as_json:
        print_message(f"written {link(write_page(budget_page(found, proof), target))}")
    exit_unless((found.met or not found.margins) and (proof is None or proof.holds))


def _print_budget(found: "Budget", proof: "ProvedBudget | None") -> None:
    from flexslew_lab.budget.tables import (
        MARGIN_COLUMNS,
        PROVED_COLUMNS,
        budget_columns,
        budget_rows,
        margin_rows,
        proved_rows,
    )

    for words in found.without:
        print_message(f"without {words}", "red")
    for words in found.left_out:
        print_message(f"left out: {words}")
    print_verdict(found.verdict)
    print_table(budget_columns(found), [tuple(row) for row in budget_rows(found)])
    if found.margins:
        print_table(MARGIN_COLUMNS, margin_rows(found))
    if proof is not None:
        print_verdict(proof.verdict)
        print_table(PROVED_COLUMNS, proved_rows(proof))
