"""Subcommands for logs: info, check, recover, export."""

from pathlib import Path
from typing import Annotated

import typer

from flexslew_lab.cli.options.shared import Bag, Json
from flexslew_lab.cli.terminal import print_line, print_message, print_table
from flexslew_lab.json_text import json_text
from flexslew_lab.trial.outputs import bag_folder, check_output_folder
from flexslew_plant.counted import count_text
from flexslew_plant.version import VERSION

log = typer.Typer(
    no_args_is_help=True,
    help="Inspect, check, recover and export bags.\n\n"
    "Example: `./flexslew log info runs/m1-20260101-120000`",
)

Out = Annotated[Path | None, typer.Option(help="Folder of the new bag; default: in place.")]


@log.command()
def info(bag: Bag, as_json: Json = False) -> None:
    """Show what a bag holds: topics, plans, controllers, events, how it was recorded.

    Example: `./flexslew log info runs/m1-20260101-120000`
    """
    from flexslew_lab.log.info import log_info

    found = log_info(bag_folder(bag))
    if as_json:
        print(json_text(found))
        return
    bench = found["testbed"] or {"kind": "unknown", "modes": 0, "period": 0.0}
    whole = "whole" if found["complete"] else f"CUT: {found['cut']['reason']}"
    plans = ", ".join(f"{p['method']} {p['hash'][:12]}" for p in found["plans"]) or "none"
    rows = [
        ("file", f"{found['path']}, {found['size'] / 1e6:.3g} MB, {whole}"),
        ("time", f"{found['start']:g} s, {found['duration']:g} s long"),
        (
            "testbed",
            f"{bench['kind']}, {count_text(bench['modes'], 'mode')}, ticks of {bench['period']:g} "
            "s",
        ),
        ("plans", plans),
        ("controllers", ", ".join(f"{n} ({law})" for n, law in found["controllers"].items())),
        *((f"  {t['name']}", f"{t['messages']} {t['type']}") for t in found["topics"]),
    ]
    rows += [(f"  {e['time']:.2f} s", f"{e['kind']}: {e['message']}") for e in found["events"][:40]]
    if len(found["events"]) > 40:
        rows.append(("", f"... and {len(found['events']) - 40} more events, see --json"))
    print_table(("", bag.name), rows)


@log.command("check")
def check_bag(bag: Bag, as_json: Json = False) -> None:
    """Check a bag: checksums, gaps, clock, definitions, index. The exit code is 1 on any error.

    Example: `./flexslew log check runs/m1-20260101-120000`
    """
    from flexslew_lab.log.checks.check import check_log

    findings = check_log(bag_folder(bag))
    if as_json:
        print(json_text([finding._asdict() for finding in findings]))
    else:
        rows = [("ok" if f.ok else "WRONG", f.what, f.detail) for f in findings]
        print_table(("", "checked", "result"), rows)
    exit_unless(all(finding.ok for finding in findings))


@log.command()
def export(
    bag: Bag,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the tables; else export/ and the run's name.")
    ] = None,
    kind: Annotated[str, typer.Option("--format", help="parquet or csv.")] = "parquet",
    topic: Annotated[
        list[str] | None, typer.Option(help="Topic to export; default: all; may be repeated.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a bag as tables, one per topic: time in seconds, columns named after the joints.

    Units are in the metadata of the Parquet columns; CSV has them in `columns.json` beside it.

    Example: `./flexslew log export runs/m1-20260101-120000 --topic /truth`
    """
    from flexslew_lab.log.export import export_log

    target = check_output_folder(out or Path("export") / run_name(bag), "--out")
    done = export_log(bag_folder(bag), target, kind, topic)  # type: ignore[arg-type]  # it lists the allowed ones
    if as_json:
        files = {t: str(path) for t, path in done.files.items()}
        print(json_text({"files": files, "rows": done.rows, "skipped": done.skipped}))
        return
    rows = [(t, done.rows[t], str(path)) for t, path in done.files.items()]
    print_table(
        ("topic", "rows", "file"), rows + [(t, "-", why) for t, why in done.skipped.items()]
    )


@log.command()
def recover(bag: Bag, out: Out = None, as_json: Json = False) -> None:
    """Repair a bag after a crash, a full disk or a truncated copy, and report what is missing.

    In place unless --out names a folder; the old file is kept as `*.damaged`.

    Example: `./flexslew recover runs/m1-20260101-120000`
    """
    from flexslew_lab.log.recover import recover as mend

    if out is not None:
        check_output_folder(out, "--out")
    done = mend(bag_folder(bag), out)
    if as_json:
        values = {**done._asdict(), "statement": done.statement}
        print(json_text(values | {k: str(values[k]) for k in ("source", "out")}))
    else:
        print_line(done.statement)
        print_message(str(done.out), "bold")


def _version(requested: bool) -> None:
    """Print the version and leave."""
    if requested:
        print_line(f"flexslew {VERSION}")
        raise typer.Exit


def reading_limits(
    largest_chunk: Annotated[
        int, typer.Option(min=1, help="Largest chunk to read [MiB]; memory grows with it.")
    ] = 64,
    version: Annotated[
        bool,
        typer.Option("--version", is_eager=True, callback=_version, help="Print the version."),
    ] = False,
) -> None:
    """Take the options that stand before a subcommand."""
    from flexslew_lab.log.files.read_limits import MIB, read_at_most

    read_at_most(largest_chunk * MIB)


def run_name(path: Path) -> str:
    """Return the name of the run that a bag belongs to."""
    full = path.resolve()
    folder = full if full.is_dir() else full.parent
    return folder.parent.name if folder.name == "bag" else folder.name


def exit_unless(ok: bool) -> None:
    """Leave with exit code 1 unless a check was passed."""
    if not ok:
        raise typer.Exit(1)
