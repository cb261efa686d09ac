"""The subcommands that list the runs of a folder, write the page over them, and sort them."""

import os
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from flexslew_lab.cli.options.shared import Json
from flexslew_lab.cli.output.open_page import Open, open_page
from flexslew_lab.cli.terminal import link, print_message, print_table
from flexslew_lab.json_text import json_text
from flexslew_lab.short_values import short
from flexslew_lab.trial.outputs import RUNS
from flexslew_plant.errors import BadInput

Run = Annotated[Path, typer.Argument(help="Folder of the run.")]


class _ListsByDefault(TyperGroup):
    """A group that lists where no command is named: `flexslew runs --law lqr`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Return the arguments with the default command before them."""
        if not args or (args[0] not in self.commands and args[0] != "--help"):
            args = ["list", *args]
        return super().parse_args(ctx, args)


runs = typer.Typer(
    cls=_ListsByDefault,
    rich_markup_mode="markdown",
    help="""List runs with their verdicts; write a page to search, sort and compare them.

    Without a command: `list`. Notes and tags stand in notes.yaml in the folder of a run.

    Example: `./flexslew runs --law output_feedback --open`
    """,
)


@runs.command("list")
def list_runs(
    folder: Annotated[Path, typer.Argument(help="Folder with one folder per run.")] = RUNS,
    trial: Annotated[str, typer.Option(help="Only runs of this trial.")] = "",
    law: Annotated[str, typer.Option(help="Only runs that began with this law.")] = "",
    testbed: Annotated[str, typer.Option(help="Only runs on this kind of testbed.")] = "",
    tag: Annotated[str, typer.Option(help="Only runs with this tag.")] = "",
    open_it: Open = False,
    as_json: Json = False,
) -> None:
    """List all runs with their key figures; write index.html, to search, sort and compare them.

    Example: `./flexslew runs list --tag paper --open`
    """
    from flexslew_lab.report.runs_index import runs_in, write_index

    if not os.path.isdir(folder):
        raise BadInput("no such folder; a first run makes it", folder)
    found, skipped = runs_in(folder, trial, law, testbed)
    found = [run for run in found if not tag or tag in run.tags]
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
    columns = ("run", "law", "testbed", "tip [m]", "settled [s]", "tags", "verdict")
    keys = ("residual_tip_deflection", "settling_time")
    print_table(
        columns,
        [
            (r.folder.name, r.law, r.testbed, *(short(r.figures[k], 3) for k in keys),
             ", ".join(r.tags), r.verdict)
            for r in found
        ],
    )  # fmt: skip
    if page is not None:
        print_message(f"{link(page)}")
        if open_it:
            open_page(page)


@runs.command()
def serve(
    folder: Annotated[Path, typer.Argument(help="Folder with one folder per run.")] = RUNS,
    port: Annotated[int, typer.Option(help="Port on loopback; 0: any free one.")] = 0,
    open_it: Open = False,
) -> None:
    """Serve the page on this machine, so that its buttons act, until Ctrl-C.

    Example: `./flexslew runs serve --open`
    """
    import webbrowser

    from flexslew_lab.report.runs_server import runs_server

    if not os.path.isdir(folder):
        raise BadInput("no such folder; a first run makes it", folder)
    server, address = runs_server(folder, port)
    with server:
        print_message(address)
        if open_it:
            webbrowser.open_new_tab(address)
        server.serve_forever()


@runs.command()
def note(
    run: Run, text: Annotated[str, typer.Argument(help="The note; empty: removes it.")]
) -> None:
    """Write a note on a run; it replaces the one before.

    Example: `./flexslew runs note runs/m1-20260101-120000 "figure 3"`
    """
    from flexslew_lab.report.run_notes import set_note

    set_note(run, text)
    _changed(run)


@runs.command("tag")
def tag_run(
    run: Run,
    tags: Annotated[list[str] | None, typer.Argument(help="All its tags; none: no tags.")] = None,
) -> None:
    """Give a run tags; they replace those before.

    Example: `./flexslew runs tag runs/m1-20260101-120000 paper robust`
    """
    from flexslew_lab.report.run_notes import set_tags

    set_tags(run, tags or ())
    _changed(run)


@runs.command()
def trash(run: Run) -> None:
    """Move a run to the trash, the folder .trash beside it; restore takes it back.

    Example: `./flexslew runs trash runs/m1-20260101-120000`
    """
    from flexslew_lab.report.run_notes import move_to_trash

    print_message(f"moved to {move_to_trash(run)}")
    _changed(run)


@runs.command()
def restore(run: Annotated[Path, typer.Argument(help="Where the run was.")]) -> None:
    """Take a run back from the trash to where it was.

    Example: `./flexslew runs restore runs/m1-20260101-120000`
    """
    from flexslew_lab.report.run_notes import restore as restored

    print_message(f"restored {restored(run)}")
    _changed(run)


def _changed(run: Path) -> None:
    """Write the page over the runs of the folder again."""
    from flexslew_lab.report.runs_index import write_index

    print_message(link(write_index(Path(os.path.abspath(run)).parent)))
