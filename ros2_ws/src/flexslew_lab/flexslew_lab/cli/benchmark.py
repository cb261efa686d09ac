"""Subcommands of the benchmark: list the tasks, fly an entry, verify and compare results."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexslew_lab.cli.log import exit_unless
from flexslew_lab.cli.options.option_groups import expand_options
from flexslew_lab.cli.options.shared import Json, TrustOption, Workers
from flexslew_lab.cli.terminal import print_message, print_table, print_verdict
from flexslew_lab.json_text import json_text
from flexslew_lab.progress import display_progress
from flexslew_lab.trial.outputs import check_output_file, new_file
from flexslew_plant.own_code import Trust

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexslew_lab.benchmark.task import Allowed

benchmark = typer.Typer(
    no_args_is_help=True,
    help="Score a controller on frozen tasks and compare it with the built-in ones.\n\n"
    "Example: `./flexslew benchmark run csa-slew --law my_law.py:MyLaw`",
)

TaskName = Annotated[str, typer.Argument(metavar="TASK", help="See `benchmark list`.")]


@benchmark.command("list")
def list_tasks(
    name: Annotated[
        str | None, typer.Argument(metavar="TASK", help="Show what its controllers may see.")
    ] = None,
    as_json: Json = False,
) -> None:
    """List the tasks, or show one.

    Example: `./flexslew benchmark list csa-slew`
    """
    from flexslew_lab.benchmark.task import load_task, task_hash, task_names

    tasks = [load_task(one) for one in ([name] if name else task_names())]
    if as_json:
        rows = [
            {"task": t.name, "version": t.version, "hash": task_hash(t)} | t.allowed._asdict()
            for t in tasks
        ]
        print(json_text(rows))
    elif name is None:
        print_table(("task", "version", "about"), [(t.name, t.version, t.about) for t in tasks])
    else:
        print_verdict(tasks[0].about)
        print_table(("", name), _allowed_rows(tasks[0].allowed))


@dataclass(frozen=True)
class EntryOptions:
    """The controller and plan that are entered."""

    law: Annotated[
        str | None,
        typer.Option(help="Built-in law, file.py:Class, or file of a linear controller or policy."),
    ] = None
    command: Annotated[
        str | None, typer.Option(help="Program that is the controller, with its arguments.")
    ] = None
    plan: Annotated[str | None, typer.Option(help="Planner, or file.py:Class.")] = None
    entry: Annotated[
        str | None, typer.Option(help="YAML file with controllers, active and plan.")
    ] = None
    sets: Annotated[
        list[str] | None,
        typer.Option("--set", help="key.path=value of controllers, active or plan."),
    ] = None
    name: Annotated[str | None, typer.Option(help="Name of the entry in tables.")] = None


@dataclass(frozen=True)
class SeedOptions:
    """The members that are flown."""

    seeds: Annotated[str, typer.Option(help="development or evaluation.")] = "development"
    round_name: Annotated[
        str, typer.Option("--round", help="Published text of an evaluation round.")
    ] = ""
    members: Annotated[
        int | None, typer.Option(min=1, help="First members of the set; default: all.")
    ] = None


@benchmark.command()
@expand_options
def run(
    task: TaskName,
    *,
    options: EntryOptions,
    set_of_seeds: SeedOptions,
    workers: Workers = None,
    out: Annotated[
        Path | None, typer.Option(help="Result file; default: a new one below runs/.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Fly an entry on a task's ensemble and write its result file.

    Without --law, --command, --plan and --entry, the baseline of the task flies.

    Example: `./flexslew benchmark run csa-slew --law lqr --out result.json`
    """
    from flexslew_lab.benchmark.baselines import shipped_results
    from flexslew_lab.benchmark.entry import read_entry
    from flexslew_lab.benchmark.flight import failures, fly_entry
    from flexslew_lab.benchmark.result import SeedSet, result_of, result_text, score_in
    from flexslew_lab.benchmark.task import load_task
    from flexslew_lab.log.files.whole_file import write_whole

    problem = load_task(task)
    given = set_of_seeds
    which = SeedSet(given.seeds, given.round_name, given.members or problem.count)
    numbers = which.seeds(problem)
    o = options
    requested = read_entry(problem, o.law, o.plan, o.entry, o.sets, o.name, o.command)
    target = check_output_file(out or new_file(f"{problem.name}.json"), "--out", o.entry)
    with display_progress(problem.name):
        study, flown = fly_entry(problem, requested, numbers, workers)
    result = result_of(problem, requested, which, study, flown)
    target.parent.mkdir(parents=True, exist_ok=True)
    write_whole(target, result_text(result))
    if as_json:
        print(json_text(result))
    else:
        score = score_in(result)
        words = f"{problem.name}: score {score.mean:.2f}, {score.low:.2f} to {score.high:.2f}"
        print_verdict(words)
        _print_results([result, *shipped_results(problem)])
        for reason, count in failures(flown):
            print_message(f"{count} failed: {reason}")
    print_message(f"written {target}")


@benchmark.command()
def score(
    files: Annotated[list[Path], typer.Argument(help="Result files.")], as_json: Json = False
) -> None:
    """Compare result files, the best first.

    Example: `./flexslew benchmark score result.json`
    """
    from flexslew_lab.benchmark.result import read_result

    results = [read_result(path) for path in files]
    if as_json:
        print(json_text([{k: v for k, v in one.items() if k != "members"} for one in results]))
        return
    for task in dict.fromkeys(result["task"] for result in results):
        print_verdict(task)
        _print_results([result for result in results if result["task"] == task])


@benchmark.command()
def verify(
    file: Annotated[Path, typer.Argument(help="Result file.")],
    trust: TrustOption = None,
    workers: Workers = None,
) -> None:
    """Fly the members of a result file again and compare. Exit code 1 if anything differs.

    Example: `./flexslew benchmark verify result.json`
    """
    from flexslew_lab.benchmark.result import read_result, verify_result

    result = read_result(file)
    with display_progress(result["task"]):
        differences = verify_result(result, str(file), Trust.of(trust or ()), workers)
    for words in differences:
        print_message(words, "red")
    if not differences:
        print_message(f"{file}: confirmed, {len(result['members'])} members")
    exit_unless(not differences)


@benchmark.command()
def baselines(
    tasks: Annotated[
        list[str] | None, typer.Argument(metavar="TASKS", help="Default: all tasks.")
    ] = None,
    members: Annotated[
        int | None, typer.Option(min=1, help="First development members; default: all.")
    ] = None,
    workers: Workers = None,
    out: Annotated[
        Path | None, typer.Option(help="JSON file; rows of other tasks in it stay.")
    ] = None,
    page: Annotated[
        Path | None, typer.Option(help="HTML page with a figure: score over effort.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Fly every built-in law on tasks with a planner that suits it.

    Example: `./flexslew benchmark baselines acc --page leaderboard.html`
    """
    from flexslew_lab.benchmark.baselines import fly_baselines, merged, read_rows
    from flexslew_lab.benchmark.leaderboard import leaderboard_page
    from flexslew_lab.benchmark.task import load_task, task_names
    from flexslew_lab.log.files.whole_file import write_whole
    from flexslew_lab.report.page import write_page

    problems = [load_task(name) for name in tasks or task_names()]
    for file, option in ((out, "--out"), (page, "--page")):
        if file is not None:
            check_output_file(file, option)
    rows = read_rows(out) if out is not None and out.is_file() else []
    for problem in problems:
        with display_progress(problem.name):
            found, refused = fly_baselines(problem, members or problem.count, workers)
        rows = merged(found, rows)
        if not as_json:
            print_verdict(problem.name)
            _print_results(found)
        for words in refused:
            print_message(f"not flown: {words}")
        if out is not None:
            write_whole(out, json_text(rows) + "\n")
    if as_json:
        print(json_text(rows))
    if page is not None:
        print_message(f"written {write_page(leaderboard_page(rows), page)}")


def _allowed_rows(allowed: "Allowed") -> list[tuple[str, str]]:
    """Return what a controller receives and may answer, a row for each part."""
    joints = zip(allowed.joints, allowed.units, strict=True)
    return [
        ("measured joints", ", ".join(f"{joint} [{unit}]" for joint, unit in joints)),
        ("measured tips", ", ".join(allowed.tips)),
        ("limits of the efforts", ", ".join(f"{limit:g}" for limit in allowed.effort_limit)),
        ("period [s]", f"{allowed.period:g}"),
    ]


def _print_results(results: "Sequence[dict[str, Any]]") -> None:
    """Print results of one task, the best first."""
    from flexslew_lab.benchmark.leaderboard import COLUMNS, cells

    ranked = sorted(results, key=lambda result: -result["score"]["mean"])
    print_table(COLUMNS, [cells(one) for one in ranked])
