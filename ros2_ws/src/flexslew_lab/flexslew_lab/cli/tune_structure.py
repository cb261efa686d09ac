"""Subcommand that tunes a controller of a given structure against goals."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexslew_lab.cli.log import exit_unless
from flexslew_lab.cli.options.option_groups import expand_options
from flexslew_lab.cli.options.shared import Json
from flexslew_lab.cli.terminal import link, print_message, print_table, print_verdict
from flexslew_lab.json_text import json_text
from flexslew_lab.progress import display_progress
from flexslew_lab.trial.outputs import RUNS, check_output_folder
from flexslew_plant.extras import required

if TYPE_CHECKING:
    from flexslew_lab.guarantee.flight import Guarantee
    from flexslew_lab.tuning.tuned import TunedController


@dataclass(frozen=True)
class AfterTuning:
    """What follows the tuning."""

    guarantee: Annotated[
        bool, typer.Option("--guarantee", help="Certify the tuned loop for all parameters.")
    ] = False
    fly: Annotated[
        bool, typer.Option("--fly", help="Fly the tuned trial in process, into the folder.")
    ] = False


@expand_options
def tune_structure(
    file: Annotated[str, typer.Argument(help="A tuning file, or the name of a shipped one.")],
    out: Annotated[
        Path | None,
        typer.Option(help="Folder of the result, from which it goes on; default: runs/NAME."),
    ] = None,
    *,
    after: AfterTuning,
    as_json: Json = False,
) -> None:
    """Tune a controller of a given structure against goals on several models.

    A PID with filters, a state space of fixed order, or numbers of a law. The folder receives the
    tuned trial, the page and every start as it ends; the same command goes on from there. Exit
    code 1: a goal is not met, a loop is not stable or not guaranteed, or the flight has failed.

    Example: `./flexslew tune-structure acc_order_3 --guarantee --fly`
    """
    required("ctrlsys")
    from flexslew_lab.report.page import write_page
    from flexslew_lab.trial.trial import trial_text
    from flexslew_lab.tuning.page import GOAL_COLUMNS, goal_rows, tuning_page
    from flexslew_lab.tuning.tuned import tune_structure as tuned_by
    from flexslew_lab.tuning.tuning_file import read_tuning, tuning_path

    tuning_path(file)
    with display_progress(file, words="linearising"):
        problem = read_tuning(file)
    name = problem.settings.tuning
    folder = check_output_folder(out or RUNS / name, "--out")
    with display_progress(name, "evaluations", "tuning") as update:
        tuned = tuned_by(problem, folder / "starts.json", update)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "trial.yaml").write_text(trial_text(tuned.trial), encoding="utf-8")
    found = _guarantee(tuned) if after.guarantee else None
    sections = []
    if found is not None:
        from flexslew_lab.guarantee.tables import worst_case_sections

        sections = worst_case_sections(found)
    page = write_page(tuning_page(tuned, sections), folder / "report.html")
    report: dict[str, Any] = {} if found is None else {"guarantee": found.plain()}
    flown = _fly(tuned, folder, report) if after.fly else True
    (folder / "tuned.json").write_text(json_text({**tuned.plain(), **report}), encoding="utf-8")
    if as_json:
        print(json_text({**tuned.plain(), **report}))
    else:
        print_verdict(tuned.verdict)
        print_table(GOAL_COLUMNS, goal_rows(tuned))
        if found is not None:
            print_verdict(found.verdict)
    print_message(f"written {link(page)} and {folder / 'trial.yaml'}")
    exit_unless(tuned.met and flown and (found is None or found.holds))


def _guarantee(tuned: "TunedController") -> "Guarantee":
    from flexslew_lab.guarantee.flight import guarantee_of

    with display_progress(tuned.problem.settings.tuning, words="bounding the worst case"):
        vary = tuned.problem.settings.guarantee
        return guarantee_of(tuned.trial, tuned.analysis, vary or None, False)


def _new_run(folder: Path) -> Path:
    """Return a folder for a flight that does not exist yet: flight, flight-2, ..."""
    number = 1
    while (run := folder / ("flight" if number == 1 else f"flight-{number}")).exists():
        number += 1
    return run


def _fly(tuned: "TunedController", folder: Path, report: dict[str, Any]) -> bool:
    """Fly the tuned trial; return whether its run has no error, and add its metrics."""
    from flexslew_lab.run.run_trial import RunFeedback, run_trial

    name = tuned.problem.settings.tuning
    with display_progress(name, "ticks", "flying") as update:
        feedback = RunFeedback(update, print_message)
        result = run_trial(tuned.trial, name, _new_run(folder), True, True, feedback)
    report["flight"] = {"folder": str(result.folder), "metrics": result.metrics}
    if result.exit_code:
        print_message(result.message, "red")
    print_message(f"flown into {result.folder}")
    return not result.exit_code
