"""Subcommands of studies: run, look at, report, fly one trial again, join shards."""

import os
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexslew_lab.cli.interrupt import NODES_EXIT_TIMEOUT, exit_timeout
from flexslew_lab.cli.log import exit_unless
from flexslew_lab.cli.options.shared import Json, RunFolder, TrustOption, Workers
from flexslew_lab.cli.output.study_results import print_summary, side_by_side
from flexslew_lab.cli.terminal import print_message, print_table
from flexslew_lab.json_text import json_text
from flexslew_lab.progress import display_progress
from flexslew_lab.short_values import short
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import ANY_CODE, Trust

if TYPE_CHECKING:
    from flexslew_lab.run.pool import Executor
    from flexslew_lab.studies.cases import Case
    from flexslew_lab.studies.flight import FlightResult
    from flexslew_lab.studies.run import PreparedStudy, Shard
    from flexslew_lab.studies.store import Store
    from flexslew_lab.studies.study import Study

study = typer.Typer(
    no_args_is_help=True,
    help="Fly thousands of trials and summarise the results.\n\n"
    "Example: `./flexslew study run csa_robustness --workers 2`",
)

File = Annotated[str, typer.Argument(help="A study file, or the name of a shipped one.")]
Place = Annotated[str, typer.Argument(help="A study file, a shipped name, or a study's folder.")]
Out = Annotated[Path | None, typer.Option(help="Folder of the study; else runs/study-NAME.")]


@study.command()
def run(
    file: File,
    workers: Workers = None,
    dask: Annotated[str | None, typer.Option(help="Address of a Dask scheduler.")] = None,
    shard: Annotated[
        str | None, typer.Option(help="I/N: this part of N, for batch queues.")
    ] = None,
    retry: Annotated[str | None, typer.Option(help="failed: fly these again.")] = None,
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Fly what is missing of a study, from its start or from where it was interrupted.

    Exit code 1 if a criterion is not passed.

    Example: `./flexslew study run csa_robustness --workers 2`
    """
    from flexslew_lab.run.pool import Pool
    from flexslew_lab.studies.batch.check import bench_job, check_batch
    from flexslew_lab.studies.findings.criteria import needed
    from flexslew_lab.studies.findings.summary import passed
    from flexslew_lab.studies.finish import finished, keep_worst
    from flexslew_lab.studies.run import default_folder, prepare, run_study
    from flexslew_lab.studies.store import Store
    from flexslew_lab.studies.study import load_study, study_path
    from flexslew_lab.trial.outputs import check_output_folder

    if retry not in (None, "failed"):
        raise BadInput("failed", key="--retry", value=retry)
    if workers is not None and dask is not None:
        raise BadInput("--workers and --dask: choose one of them")
    part = _shard(shard)
    requested = load_study(study_path(file), ANY_CODE)
    folder = out or default_folder(requested, part)
    check_output_folder(folder, "--out" if out else "--out (default)")
    with display_progress(requested.settings.study, words="preparing"):
        ready = prepare(requested)
    for line in needed(requested, ready.samples):
        print_message(line)
    executor = _executor(ready, workers, dask)
    if Store(folder).exists:
        _print_invalid_parts(Store(folder))
    with display_progress(requested.settings.study):
        with closing(executor), exit_timeout(NODES_EXIT_TIMEOUT):
            store = run_study(ready, folder, executor, part, retry is not None)
        if part.of == 1 and requested.settings.batch:
            with closing(Pool(bench_job(ready), workers or os.cpu_count() or 1)) as pool:
                check_batch(ready, store, pool)
        found = finished(requested, store) if part.of == 1 else None
    if found is None:
        print_message(
            ": join all shards with ./flexslew study merge", head=str(folder), head_style="bold"
        )
        return
    print_summary(found, as_json)
    with display_progress(requested.settings.study):
        keep_worst(ready, store, print_message)
    exit_unless(passed(found))


@study.command()
def status(file: Place, out: Out = None, trust: TrustOption = None, as_json: Json = False) -> None:
    """Show the progress of a study.

    Example: `./flexslew study status csa_robustness`
    """
    _, store = _opened(file, out, trust)
    total = store.samples.num_rows * len(store.identity["variants"])
    statuses = store.statuses(total)
    counts = {
        "folder": str(store.folder),
        "planned": int(total),
        "ok": int((statuses == 1).sum()),
        "failed": int((statuses == 2).sum()),
        "missing": int((statuses == 0).sum()),
        "damaged": store.damaged,
    }
    if as_json:
        print(json_text(counts))
    else:
        count_rows = [(k, v) for k, v in counts.items() if k != "damaged"]
        print_table(("", store.identity["study"]["study"]), count_rows)
    _print_invalid_parts(store)
    exit_unless(not store.damaged)


@study.command()
def report(
    places: Annotated[list[str], typer.Argument(help="One study, or two to compare.")],
    out: Annotated[Path | None, typer.Option(help="The HTML file.")] = None,
    trust: TrustOption = None,
    as_json: Json = False,
) -> None:
    """Summarise a study again, or compare two. Exit code 1 if a criterion is not passed.

    Example: `./flexslew study report runs/study-before runs/study-after`
    """
    from flexslew_lab.report.page import write_page
    from flexslew_lab.studies.findings.page import comparison_page, names_of, study_page
    from flexslew_lab.studies.findings.summary import passed, summary
    from flexslew_lab.studies.run import flight_records

    if len(places) > 2:
        raise BadInput(f"report: {len(places)} studies are not allowed: give one or two")
    opened = [_opened(place, None, trust) for place in places]
    for _, store in opened:
        store.write_table()
    found = [summary(one, store, flight_records(store)) for one, store in opened]
    if len(opened) == 1:
        (one, store), page = opened[0], out or opened[0][1].folder / "report.html"
        write_page(study_page(one, store, found[0]), page)
    else:
        page = out or Path("studies.html")
        write_page(comparison_page(opened, found), page)
    print_message(f"written {page}")
    for _, store in opened:
        _print_invalid_parts(store)
    if len(found) == 1:
        print_summary(found[0] | {"report": str(page)}, as_json)
    elif as_json:
        print(json_text(found))
    else:
        side_by_side(names_of(opened), found)
    exit_unless(all(map(passed, found)) and not any(store.damaged for _, store in opened))


@study.command()
def fly(
    file: Place,
    index: Annotated[int, typer.Argument(help="Number of the trial in the study's table.")],
    out: RunFolder = None,
    trust: TrustOption = None,
    as_json: Json = False,
) -> None:
    """Fly one trial of a study again with its full log, as an ordinary run.

    Exit code 1 if its trajectory is not that of the study's table.

    Example: `./flexslew study fly csa_robustness 17`
    """
    from flexslew_lab.studies.finish import repeat_trial
    from flexslew_lab.studies.run import default_folder
    from flexslew_lab.studies.store import Store
    from flexslew_lab.studies.study import load_study, study_path

    store: Store | None
    if os.path.isdir(file):
        requested, store = _opened(file, None, trust)
    else:
        requested = load_study(study_path(file), ANY_CODE)
        store = Store(default_folder(requested))
        store = store if store.exists else None
    result, difference = repeat_trial(requested, store, index, out, print_message)
    if as_json:
        print(json_text(result.metrics))
    else:
        print_table(("metric", "value"), [(k, short(v)) for k, v in result.metrics.items()])
    print_message(str(result.folder), "bold")
    if difference:
        print_message(difference, "red")
    exit_unless(not difference)


@study.command()
def merge(
    folders: Annotated[list[Path], typer.Argument(help="Folders of the shards.")],
    out: Annotated[Path, typer.Option(help="Folder of the whole study, new or with a part.")],
    trust: TrustOption = None,
    as_json: Json = False,
) -> None:
    """Join the shards of a study into one folder and sum it up.

    The exit code is 1 while trials are missing.

    Example: `./flexslew study merge runs/study-m1-shard-* --out runs/study-m1`
    """
    from flexslew_lab.studies.findings.summary import passed
    from flexslew_lab.studies.finish import finished
    from flexslew_lab.studies.merge import merged

    study_and_store = merged(folders, out, Trust.of(trust or ()))
    found = finished(*study_and_store)
    print_summary(found, as_json)
    exit_unless(passed(found) and found["complete"])


@study.command("list")
def list_studies(as_json: Json = False) -> None:
    """List the shipped studies and those below runs/.

    Example: `./flexslew study list`
    """
    from flexslew_lab.studies.identity_file import IDENTITY, kept_identity
    from flexslew_lab.studies.study import EXAMPLES, example_names
    from flexslew_lab.trial.outputs import RUNS

    rows: list[dict[str, Any]] = []
    for name in example_names():
        first = (EXAMPLES / f"{name}.yaml").read_text().splitlines()[0]
        rows.append({"study": name, "where": "shipped", "about": first.removeprefix("# ")})
    for path in sorted(RUNS.glob(f"*/{IDENTITY}")):
        name, description = path.parent.name, ""
        try:
            name = kept_identity(path.parent).identity["study"].get("study", name)
        except BadInput as error:
            description = str(error)
        rows.append({"study": name, "where": str(path.parent), "about": description})
    if as_json:
        print(json_text(rows))
    else:
        print_table(("study", "where", "about"), [row.values() for row in rows])


def _print_invalid_parts(store: "Store") -> None:
    for name in store.damaged:
        print_message(
            f"{store.folder}: {name} is damaged; its trials count as not flown until the study runs"
        )


def _opened(place: str, out: Path | None, trust: list[str] | None) -> tuple["Study", "Store"]:
    """Return the study of a folder, or of a file with its usual folder.

    A file is the user's own word; of a folder, only what is trusted may name classes.
    """
    from flexslew_lab.studies.run import default_folder
    from flexslew_lab.studies.store import Store
    from flexslew_lab.studies.study import load_study, study_path

    if os.path.isdir(place):
        store = Store(Path(place))
        if not store.exists:
            raise BadInput("holds no study", place)
        return load_study(store.description, Trust.of(trust or ())), store
    requested = load_study(study_path(place), ANY_CODE)
    store = Store(out or default_folder(requested))
    if not store.exists:
        raise BadInput("holds no study; run it first, or name its folder", store.folder)
    return requested, store


def _executor(
    ready: "PreparedStudy", workers: int | None, dask: str | None
) -> "Executor[Case, FlightResult]":
    from flexslew_lab.run.pool import Pool

    if dask is not None:
        from flexslew_lab.studies.execution.cluster import Cluster

        return Cluster(ready.job, dask)
    return Pool(ready.job, workers or os.cpu_count() or 1)


def _shard(text: str | None) -> "Shard":
    from flexslew_lab.studies.run import Shard

    if text is None:
        return Shard()
    number, separator, of = text.partition("/")
    if not (separator and number.isdigit() and of.isdigit() and 1 <= int(number) <= int(of)):
        raise BadInput("I/N with I from 1 to N, such as 1/4", key="--shard", value=text)
    return Shard(int(number), int(of))
