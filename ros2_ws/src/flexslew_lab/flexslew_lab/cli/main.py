"""The command line: one subcommand per task, machine-readable output with --json."""

import math
import os
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.main import get_command

from flexslew_lab.cli.analyse import analyse
from flexslew_lab.cli.benchmark import benchmark
from flexslew_lab.cli.budget import budget
from flexslew_lab.cli.checkout import bench, extras, run_tests
from flexslew_lab.cli.compare import compare
from flexslew_lab.cli.completion import completion
from flexslew_lab.cli.conform import conform
from flexslew_lab.cli.console import console
from flexslew_lab.cli.early import OPERATING
from flexslew_lab.cli.export import export
from flexslew_lab.cli.gains import gains
from flexslew_lab.cli.identify import identify
from flexslew_lab.cli.import_model import import_model
from flexslew_lab.cli.interrupt import (
    EXIT_TIMEOUT,
    NODES_EXIT_TIMEOUT,
    SIGNAL_EXIT_CODE,
    exit_timeout,
    interrupts_only,
    while_running,
)
from flexslew_lab.cli.log import exit_unless, log, reading_limits, recover
from flexslew_lab.cli.missing import remedy, require_ros
from flexslew_lab.cli.model import model
from flexslew_lab.cli.operate import COMMANDS
from flexslew_lab.cli.options.shared import Json, RunFolder, Sets, TrialFile, TrustOption
from flexslew_lab.cli.options.with_command import CommandWithProgram
from flexslew_lab.cli.output.open_page import Open, open_page
from flexslew_lab.cli.output.plain_help import without_types
from flexslew_lab.cli.output.reproduced import show_rows
from flexslew_lab.cli.play import live, play
from flexslew_lab.cli.publish import archive, figure
from flexslew_lab.cli.replay import check, resim
from flexslew_lab.cli.runs import runs
from flexslew_lab.cli.schema import schema
from flexslew_lab.cli.study import study
from flexslew_lab.cli.terminal import (
    PIPED,
    link,
    print_line,
    print_message,
    print_table,
    print_verdict,
)
from flexslew_lab.cli.tune_structure import tune_structure
from flexslew_lab.json_text import json_text
from flexslew_lab.progress import CompileReport, display_progress
from flexslew_lab.reproduce import REPRODUCTIONS
from flexslew_lab.short_values import short
from flexslew_lab.trial.outputs import RUNS, WITHOUT, bag_folder, check_output_file, new_file
from flexslew_plant.errors import BadInput, FlexslewError, PlanFailed, RunFault
from flexslew_plant.machine_code.compile_news import add_compile_listener
from flexslew_plant.near_names import spelling_hint
from flexslew_plant.own_code import Trust
from flexslew_plant.processes.interrupted import keep_exit_code

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    help="A lab bench in software: slew a flexible spacecraft testbed on ROS 2 without ringing.",
)
app.add_typer(log, name="log", rich_help_panel="Logs and replay")
app.add_typer(study, name="study", rich_help_panel="Analyse and identify")
app.add_typer(benchmark, name="benchmark", rich_help_panel="Analyse and identify")
app.add_typer(runs, name="runs", rich_help_panel="Look at runs")
app.callback()(reading_limits)

_PIPE_EXIT_CODE = 141  # exit code that a shell has for the signal of a closed pipe
Bags = Annotated[list[Path], typer.Argument(help="Folders of runs, or bags.")]


def trial(
    file: TrialFile = None,
    sets: Sets = None,
    in_process: Annotated[
        bool, typer.Option("--in-process", help="Without ROS: the same ticks and bits.")
    ] = False,
    out: RunFolder = None,
    no_report: Annotated[
        bool, typer.Option("--no-report", help="Do not write report.html.")
    ] = False,
    rate: Annotated[
        float | None, typer.Option(help="Replaces the file's rate_factor; 1: real time.")
    ] = None,
    open_it: Open = False,
    as_json: Json = False,
) -> None:
    """Fly a trial and leave a folder with the bag, metrics.json and report.html.

    Example: `./flexslew trial swap_demo --rate 1`
    """
    from dataclasses import replace

    from flexslew_lab.cli.output.summary import metric_rows
    from flexslew_lab.metrics.own import keys_of, load_user_metrics
    from flexslew_lab.report.verdict import run_summary
    from flexslew_lab.run.run_trial import RunFeedback, run_trial
    from flexslew_lab.trial.sources import read_trial

    if no_report and open_it:
        raise BadInput("there is no page to open with --no-report", key="--open")
    if not in_process:
        require_ros()
    requested, source = read_trial(file, sets)
    if rate is not None:
        if not 0.0 <= rate < math.inf:
            raise BadInput("0 is as fast as possible, 1 real time", key="--rate", value=rate)
        requested = replace(requested, rate_factor=rate)
    with (
        display_progress(requested.name, "ticks", "flying") as update,
        exit_timeout(EXIT_TIMEOUT if in_process else NODES_EXIT_TIMEOUT),
    ):
        feedback = RunFeedback(update, print_message)
        result = run_trial(requested, source, out, in_process, not no_report, feedback)
    if result.exit_code == SIGNAL_EXIT_CODE:
        print_message(f"interrupted; what was recorded until then is in {result.folder}")
        sys.exit(SIGNAL_EXIT_CODE)
    if as_json:
        print(json_text(result.metrics))
    else:
        units = requested.testbed.model().units_by_joint
        user_keys = keys_of(
            load_user_metrics(requested.metrics, f"{source}: metrics", requested.trust)
        )
        words = run_summary(
            result.metrics, result.bare_metrics, requested.goal_tolerance, result.changes, units
        )
        print_verdict(words)
        rows = metric_rows(result.metrics, units, user_keys)
        print_table(("metric", "value", "unit"), rows, PIPED)
        if result.metrics:
            print_line(f"trajectory_hash {result.metrics['trajectory_hash']}")
    page = result.folder / "report.html"
    print_message(f"{link(page)}" if page.exists() else str(result.folder))
    if out is None and result.metrics:
        from flexslew_lab.report.runs_index import write_index

        write_index(RUNS)
    if open_it and page.exists():
        open_page(page)
    if result.exit_code:
        print_message(result.message, "red")
        raise typer.Exit(result.exit_code)


def trials(as_json: Json = False) -> None:
    """List the trials that come with the bench; each can be flown by its name.

    Example: `./flexslew trial swap_demo --in-process`
    """
    from flexslew_lab.trial.sources import example_trials

    shipped = example_trials()
    if as_json:
        rows = [{"name": t.name, "about": t.about, "file": str(t.path)} for t in shipped]
        print(json_text(rows))
    else:
        print_table(("trial", "about"), [(trial.name, trial.about) for trial in shipped])


def plan(
    file: TrialFile = None,
    sets: Sets = None,
    method: Annotated[str | None, typer.Option(help="Replaces the file's plan.method.")] = None,
    out: Annotated[Path | None, typer.Option(help="Save the plan as YAML.")] = None,
    figure: Annotated[Path | None, typer.Option(help="Draw the plan as HTML.")] = None,
    as_json: Json = False,
) -> None:
    """Plan the manoeuvre of a trial without flying it.

    Example: `./flexslew plan --out plan.yaml --figure plan.html`
    """
    from flexslew_control.planners import make_plan, other_method, plan_settings
    from flexslew_control.plans.plan_file import plan_hash, save_plan
    from flexslew_lab.report.verdict import plan_verdict
    from flexslew_lab.trial.angles import doubtful_angles
    from flexslew_lab.trial.sources import read_trial
    from flexslew_lab.trial.trial import (
        feedback_of,
        law_in_charge,
        plan_section_of,
        plant_of,
        with_law_statement,
    )

    for path, option in ((out, "--out"), (figure, "--figure")):
        if path is not None:
            check_output_file(path, option, file)
    if out is not None and figure is not None and out.resolve() == figure.resolve():
        raise BadInput(f"--figure: {figure} is the file of --out, too; give another name")
    requested, source = read_trial(file, sets)
    for words in doubtful_angles(requested):
        print_message(f"warning: {words}")
    settings = plan_section_of(requested, source)
    if method is not None:
        if settings is None:
            settings = plan_settings({"method": method}, f"{source}: plan", requested.trust)
        else:
            settings = other_method(settings, method, f"{source}: plan")
    if settings is None:
        raise BadInput("plan: is missing; add one or give --method", source)

    def iteration(update: Any) -> None:
        size = f"  |Y| {update.norm_terminal_error:.3e}  |U| {update.norm_input:.4f}"
        known = not math.isnan(update.norm_input)  # a start of a multistart has none
        print_message(f"  {update.number:3d}  J {update.objective:.6e}{size if known else ''}")

    callback = None if as_json else iteration
    law = law_in_charge(requested)
    try:
        with display_progress(requested.name, words=f"planning by {settings.method}"):
            made = make_plan(settings, plant_of(requested), feedback_of(requested), callback, law)
        made = with_law_statement(requested, made)
    except BadInput as error:  # the error names its key
        raise BadInput(str(error), source) from None
    except PlanFailed as error:
        raise PlanFailed(f"{source}: plan: {error}") from None
    efforts = zip(made.joint_names, made.effort.T, strict=True)
    effort_names = [
        name for name, effort in efforts if effort.any()
    ]  # that the plan itself commands
    facts = {"duration": made.duration, "drives": effort_names, "hash": plan_hash(made)}
    summary = {**made.summary, **facts}
    hidden = ("weights", "history", "shaper_ranking")
    rows = [(k, short(v)) for k, v in summary.items() if k not in hidden]
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        save_plan(made, out)
        print_message(f"saved {out}")
    if figure is not None:
        from flexslew_lab.report.report import write_plan

        units = requested.testbed.model().joint_units
        write_plan(made, units, tuple(requested.testbed.effort_limit), rows, figure)
        print_message(f"drawn {link(figure)}")
    if as_json:
        print(json_text(summary))
    else:
        print_verdict(plan_verdict(made, requested.testbed.effort_limit))
        print_table(("", made.method), rows)
        _print_shapers(made.summary.get("shaper_ranking", ()))


def _print_shapers(ranking: Sequence[Mapping[str, Any]]) -> None:
    """Print what each shaper costs, where a plan has compared them."""
    rows = [
        (one["shaper"], f"{one['delay']:.3g}", f"{one['smoothing']:.3g}",
         f"{100.0 * one['residual']:.2g}")
        for one in ranking
    ]  # fmt: skip
    if rows:
        print_table(("shaper", "delay [s]", "smoothing [s]", "residual [%]"), rows)


def report(
    bags: Bags,
    out: Annotated[Path | None, typer.Option(help="The HTML file.")] = None,
    trust: TrustOption = None,
    open_it: Open = False,
) -> None:
    """Write the report of one run, or of several overlaid.

    A testbed of the user's own that a log names is drawn only if --trust names it.

    One run's report goes into its folder, an overlay into a new file below runs/.

    Example: `./flexslew report runs/m1-20260101-120000`
    """
    from flexslew_lab.log.bag_reader import BagReader
    from flexslew_lab.report.report import write_report
    from flexslew_lab.report.run_data import read_run

    for path in bags:
        if not os.path.exists(path):
            raise BadInput("no such run", path)
    folder = bags[0] if bags[0].is_dir() else bags[0].parent
    folder = folder.parent if folder.name == "bag" else folder
    target = out or (folder / "report.html" if len(bags) == 1 else new_file("overlay.html"))
    check_output_file(target, "--out")
    bare, comparison = folder / WITHOUT, None
    logs = [BagReader(bag_folder(path), trust=Trust.of(trust or ())) for path in bags]
    if len(bags) == 1 and bare.is_dir():
        try:
            comparison = read_run(bare)
        except BadInput as error:  # for example after a full disk
            print_message(f"without the comparison: {error}", "red")
    write_report(logs, target, comparison)
    print_message(f"written {link(target)}")
    if open_it:
        open_page(target)


def reproduce(
    name: Annotated[
        str,
        typer.Argument(
            help="; ".join(f"{name}: {one.about}" for name, one in REPRODUCTIONS.items())
            + "; left out: all."
        ),
    ] = "",
    figures: Annotated[
        Path | None, typer.Option(help="Draw the figures of the paper as HTML.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Compute a paper's numbers again: the printed value, an independent reference, and ours.

    A row that is not reproduced says why and does not fail; one off its tolerance does.

    Example: `./flexslew reproduce csa --figures csa.html`
    """
    from flexslew_lab.reproduce import write_figures

    if name and name not in REPRODUCTIONS:
        hint = spelling_hint(name, REPRODUCTIONS)
        raise BadInput(f"unknown reproduction {name}; {hint}allowed: {', '.join(REPRODUCTIONS)}")
    if figures is not None:
        if not name:
            raise BadInput("--figures: give the name of the paper whose figures are drawn")
        check_output_file(figures, "--figures")
    found = {}
    for one in [name] if name else REPRODUCTIONS:
        with display_progress(one, words="computing"):
            found[one] = REPRODUCTIONS[one].rows()
        if not as_json:
            show_rows(one, found[one])
    if figures is not None:
        figures.parent.mkdir(parents=True, exist_ok=True)
        with display_progress(name, words="drawing"):
            write_figures(name, figures)
    if as_json:
        print(json_text(found[name] if name else found))
    exit_unless(all(row["ok"] is not False for rows in found.values() for row in rows))


_GROUPS: dict[str, tuple[Callable[..., Any], ...]] = {
    "Fly and plan": (trial, trials, schema, plan, console),
    "Look at runs": (report, compare, figure, archive),
    "Operate a running bench": (*COMMANDS, live),
    "Logs and replay": (resim, check, play, recover),
    "Analyse and identify": (
        analyse,
        budget,
        gains,
        tune_structure,
        model,
        export,
        identify,
        reproduce,
    ),
    "The bench itself": (bench, extras, completion),
}
for _group, _commands in _GROUPS.items():
    for _command in _commands:
        kind = CommandWithProgram if _command in (resim, check) else None
        app.command(cls=kind, rich_help_panel=_group)(_command)
_OTHERS = {"allow_extra_args": True, "ignore_unknown_options": True}
app.command(context_settings=_OTHERS, rich_help_panel="Analyse and identify")(conform)
app.command("import", rich_help_panel="Analyse and identify")(import_model)
app.command("test", context_settings=_OTHERS, rich_help_panel="The bench itself")(run_tests)


def _called() -> str:
    """Return the command as it was typed; pip puts it on the PATH."""
    return "flexslew" if Path(sys.argv[0]).name == "flexslew" else "./flexslew"


@while_running()
def main() -> None:
    """Run the command line; every known error is one line, any other one a traceback and code 3."""
    try:
        sys.exit(_exit_code())
    finally:
        keep_exit_code()


def _require_text(words: list[str]) -> None:
    """Refuse a name that is no text: no log, page or message could hold it.

    Raises:
        BadInput: it has bytes that the encoding of this process does not know.
    """
    for word in words:
        try:
            word.encode()
        except UnicodeEncodeError:
            known = sys.getfilesystemencoding()
            remedy = "rename it" if known == "utf-8" else "set PYTHONUTF8=1, or rename it"
            raise BadInput(f"{word}: is no name in {known}; {remedy}") from None


def _exit_code() -> int:
    code = 0
    if "--json" not in sys.argv:  # with a reader that may take both outputs for one
        add_compile_listener(CompileReport())
    try:
        _require_text(sys.argv[1:])
        command = without_types(get_command(app))
        with interrupts_only():
            try:
                code = command(prog_name=_called(), standalone_mode=False) or 0
            except typer.Exit as leave:
                code = leave.exit_code
        if code == SIGNAL_EXIT_CODE:  # how typer passes a KeyboardInterrupt on
            print_message("interrupted")
    except (typer.Abort, KeyboardInterrupt):
        print_message("interrupted")
        code = SIGNAL_EXIT_CODE
    except SystemExit as leave:
        if not isinstance(leave.__context__, BrokenPipeError):
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = _PIPE_EXIT_CODE  # the reader of our output has left, of which typer makes a 1
    except RunFault as error:
        print_message(str(error), head="error: ")
        code = 3
    except FlexslewError as error:
        print_message(str(error), head="error: ")
        code = 2
    except MemoryError as error:
        print_message(f"out of memory: {error}", head="error: ")
        code = 3
    except OSError as error:  # a disk that is full, a file that went away
        where = f"{error.filename}: " if error.filename else ""
        print_message(f"{where}{error.strerror or error}", head="error: ")
        code = 2
    except Exception as error:
        code = 2
        if hasattr(error, "format_message"):  # click's usage errors have it
            print_message(str(error.format_message()), head="error: ")
        elif isinstance(error, ModuleNotFoundError) and remedy(error):
            print_message(remedy(error), head="error: ")
        else:  # Python would end with 1, which means a check that failed
            traceback.print_exc()
            code = 3
    return code


if __name__ == "__main__":
    try:
        main()
    except SystemExit as leave:
        if sys.argv[1:] and sys.argv[1] in OPERATING and leave.code in (0, 1):
            # the node has left the graph; to take all modules apart, too, takes a fifth of a second
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(leave.code)
        raise
