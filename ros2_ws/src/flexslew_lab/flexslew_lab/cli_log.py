"""Subcommands about logs: look, check, mend, export, fly again, check a controller, play, show."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Column, Table

from flexslew_plant.errors import BadInput
from flexslew_plant.settings import load_yaml

log = typer.Typer(no_args_is_help=True, help="Look into bags, check, mend and export them.")
screen = Console(stderr=True)  # for people; standard output is for results

Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
Bag = Annotated[Path, typer.Argument(help="Folder of a run, a bag, or an .mcap file.")]
Out = Annotated[Path | None, typer.Option(help="Folder of the new bag; else in place.")]


def register(app: typer.Typer) -> None:
    """Give the main application what is used often: recover, resim, check, play, live."""
    for command in (recover, resim, check, play, live):
        app.command()(command)


@log.command()
def info(bag: Bag, as_json: Json = False) -> None:
    """Say what a bag holds: topics, plans, controllers, events, how it was recorded.

    Example: `./flexslew log info runs/m1-20260101-120000`
    """
    from flexslew_lab.log_info import log_info

    found = log_info(bag_of(bag))
    if as_json:
        print(json.dumps(found, indent=2))
        return
    bench = found["testbed"] or {"kind": "unknown", "modes": 0, "period": 0.0}
    whole = "whole" if found["complete"] else f"CUT: {found['cut']['reason']}"
    plans = ", ".join(f"{p['method']} {p['hash'][:12]}" for p in found["plans"]) or "none"
    rows = [
        ("file", f"{found['path']}, {found['size'] / 1e6:.3g} MB, {whole}"),
        ("time", f"{found['start']:g} s, {found['duration']:g} s long"),
        ("testbed", f"{bench['kind']}, {bench['modes']} modes, ticks of {bench['period']:g} s"),
        ("plans", plans),
        ("controllers", ", ".join(f"{n} ({law})" for n, law in found["controllers"].items())),
        *((f"  {t['name']}", f"{t['messages']} {t['type']}") for t in found["topics"]),
    ]
    rows += [(f"  {e['time']:.2f} s", f"{e['kind']}: {e['message']}") for e in found["events"][:40]]
    if len(found["events"]) > 40:
        rows.append(("", f"... and {len(found['events']) - 40} events more, see --json"))
    _print_table(("", bag.name), rows)


@log.command("check")
def check_bag(bag: Bag, as_json: Json = False) -> None:
    """Check a bag: checksums, gaps, clock, definitions, index. Exit code 1 if something is wrong.

    Example: `./flexslew log check runs/m1-20260101-120000`
    """
    from flexslew_lab.log_check import check_log

    findings = check_log(bag_of(bag))
    if as_json:
        print(json.dumps([finding._asdict() for finding in findings], indent=2))
    else:
        rows = [("ok" if f.ok else "WRONG", f.what, f.detail) for f in findings]
        _print_table(("", "looked at", "found"), rows)
    _demand(all(finding.ok for finding in findings))


@log.command()
def export(
    bag: Bag,
    out: Annotated[Path, typer.Option(help="Folder of the tables.")] = Path("export"),
    kind: Annotated[str, typer.Option("--format", help="parquet or csv.")] = "parquet",
    topic: Annotated[list[str] | None, typer.Option(help="Only these, again and again.")] = None,
    as_json: Json = False,
) -> None:
    """Write a bag as tables, one a topic, with units in their metadata.

    Example: `./flexslew log export runs/m1-20260101-120000 --out tables --topic /truth`
    """
    from flexslew_lab.log_export import export_log

    done = export_log(bag_of(bag), out, kind, topic)  # type: ignore[arg-type]  # it says what is allowed
    if as_json:
        files = {t: str(path) for t, path in done.files.items()}
        print(json.dumps({"files": files, "rows": done.rows, "skipped": done.skipped}, indent=2))
        return
    rows = [(t, done.rows[t], str(path)) for t, path in done.files.items()]
    _print_table(
        ("topic", "rows", "file"), rows + [(t, "-", why) for t, why in done.skipped.items()]
    )


@log.command()
def recover(bag: Bag, out: Out = None, as_json: Json = False) -> None:
    """Make a bag whole after a kill, a full disk or a cut, and say what is missing.

    In place unless --out names a folder; the old file stays beside it as `*.damaged`.

    Example: `./flexslew recover runs/m1-20260101-120000`
    """
    from flexslew_lab.log_recover import recover as mend

    done = mend(bag_of(bag), out)
    if as_json:
        values = {**done._asdict(), "statement": done.statement}
        print(json.dumps(values | {k: str(values[k]) for k in ("source", "out")}, indent=2))
    else:
        print(done.statement)
        screen.print(f"[bold]{done.out}[/bold]")


def resim(
    bag: Bag,
    elsewhere: Annotated[
        bool, typer.Option(help="Recorded on another build or processor: accept its rounding.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Fly a run again from nothing but its log and compare the trajectory.

    On the same build every bit must be the same, else the exit code is 1; with --elsewhere the
    largest difference of each field may be 1e-9 of its largest magnitude.

    Example: `./flexslew resim runs/m1-20260101-120000`
    """
    from flexslew_lab.resim import TOLERANCE
    from flexslew_lab.resim import resim as fly_again

    with _progress("resim") as advance:
        again = fly_again(bag_of(bag), advance)
    first = again.first_difference
    if as_json:
        values = {**again._asdict(), "first_difference": first and first._asdict()}
        values |= {"within_tolerance": again.within_tolerance, "tolerance": TOLERANCE}
        print(json.dumps(values, indent=2))
    else:
        replayed = ", ".join(f"{count} {kind}" for kind, count in again.replayed.items() if count)
        rows = [
            ("recorded", again.recorded_hash),
            ("again", again.hash),
            ("ticks", f"{again.ticks}"),
            ("from the log", replayed or "no wish of an operator, no missed tick"),
            *((f"largest of {name}", f"{value:.3g}") for name, value in again.largest.items()),
            *(
                (f"version of {n}", f"{a} there, {b} here")
                for n, (a, b) in again.other_versions.items()
            ),
        ]
        _print_table(("", "bit-identical" if again.identical else "DIFFERENT"), rows)
        if first is not None:
            print(
                f"first difference: tick {first.tick} of epoch {first.epoch}, {first.field}: "
                f"recorded {first.recorded!r}, here {first.ours!r}"
            )
    _demand(again.identical or (elsewhere and again.within_tolerance))


def check(
    bag: Bag,
    controller: Annotated[str, typer.Argument(help="Its name in the log; none: the first.")] = "",
    law: Annotated[str | None, typer.Option(help="Instead of the recorded one.")] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="key=value, YAML, instead of the recorded.")
    ] = None,
    figure: Annotated[Path | None, typer.Option(help="Draw the differences, HTML.")] = None,
    as_json: Json = False,
) -> None:
    """Feed recorded measurements into a controller and compare every number that it says.

    The exit code is 1 at the first number that is another one.

    Example: `./flexslew check runs/m1-20260101-120000 pd_feedforward --set "kp=[461.0, 460.0]"`
    """
    from flexslew_lab.bag_reader import BagReader
    from flexslew_lab.crew import logged_laws
    from flexslew_lab.replay_check import check as compare
    from flexslew_lab.replay_check import difference_figure

    place = bag_of(bag)
    name = controller or next(iter(logged_laws(BagReader(place))))
    with _progress("check") as advance:
        result = compare(place, name, law, _settings(settings or []), advance)
    if figure is not None:
        difference_figure(result).write_html(figure)
        screen.print(f"drawn {figure}")
    first = result.first_divergence
    if as_json:
        values = result._asdict()
        del values["curves"]
        values["first_divergence"] = first and {k: _plain(v) for k, v in first._asdict().items()}
        values["rows"] = [row._asdict() for row in result.rows]
        print(json.dumps(values, indent=2))
    else:
        columns = ("field", "compared", "different", "first tick", "largest", "relative")
        rows = [
            (
                *row[:3],
                "-" if row.first_tick is None else row.first_tick,
                f"{row[4]:.3g}",
                f"{row[5]:.3g}",
            )
            for row in result.rows
        ]
        _print_table(columns, rows)
        print(
            f"{result.controller} ({result.law}): {result.ticks} answers compared, "
            f"{result.only_recorded} only in the log, {result.only_ours} only here"
        )
        if first is not None:
            print(
                f"first divergence: tick {first.tick} of epoch {first.epoch}, {first.field}: "
                f"recorded {first.recorded!r}, here {first.ours!r}"
            )
    _demand(result.ok)


def play(
    bag: Bag,
    rate: Annotated[float, typer.Option(help="Of real time; 0: as fast as it goes.")] = 1.0,
    start: Annotated[float, typer.Option(help="Simulated time to begin at [s].")] = 0.0,
    duration: Annotated[float | None, typer.Option(help="Simulated [s].")] = None,
    loop: Annotated[bool, typer.Option("--loop", help="Again and again.")] = False,
    topics: Annotated[list[str] | None, typer.Option(help="Only these, again and again.")] = None,
    remap: Annotated[list[str] | None, typer.Option(help="old:=new, again and again.")] = None,
    clock: Annotated[float, typer.Option(help="Own /clock instead of the recorded [Hz].")] = 0.0,
    pause: Annotated[bool, typer.Option("--pause", help="Wait for /play/resume.")] = False,
    wait_for: Annotated[list[str] | None, typer.Option(help="Nodes that must listen.")] = None,
) -> None:
    """Publish a bag on its topics again, in order, with its stamps.

    Services: /play/pause, /play/resume (Trigger), /play/step (flexslew_msgs/Step) and /play/seek
    (flexslew_msgs/Seek).

    Example: `./flexslew play runs/m1-20260101-120000 --rate 10 --topics /truth --topics /events`
    """
    from flexslew_lab.play_node import play as run
    from flexslew_lab.player import PlaySettings
    from flexslew_plant.settings import validated

    values = {
        "bag": str(bag_of(bag)), "rate": rate, "start": start, "duration": duration, "loop": loop,
        "topics": topics or (), "remap": remap or (), "clock": clock, "paused": pause,
        "wait_for": wait_for or (),
    }  # fmt: skip
    settings: PlaySettings = validated(PlaySettings, values, "play")
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[at]}"))
    with Progress(*columns, console=screen, transient=True) as bar:
        task = bar.add_task("play", total=None, at="")

        def report(time: float, end: float) -> None:
            bar.update(task, completed=time, total=end, at=f"{time:.2f} of {end:.2f} s")

        run(settings, report)


def live(
    port: Annotated[int, typer.Option(help="On 127.0.0.1; 0: any free one.")] = 8765,
) -> None:
    """Show a running bench in the Foxglove app: a WebSocket server on this machine only.

    Example: `ROS_DOMAIN_ID=1 ./flexslew live`, then open ws://127.0.0.1:8765 in Foxglove
    """
    from flexslew_lab.live_node import live as run

    run(port, screen.print)


def bag_of(path: Path) -> Path:
    """Return the bag of a run's folder, or the path itself."""
    return path / "bag" if (path / "bag").is_dir() else path


def _settings(pairs: list[str]) -> dict[str, Any]:
    """Return `key=value` texts as settings; dots nest."""
    settings: dict[str, Any] = {}
    for pair in pairs:
        key, sign, text = pair.partition("=")
        if not (key and sign):
            raise BadInput(f"--set: {pair!r} is not of the form key=value")
        place = settings
        *path, last = key.split(".")
        for part in path:
            place = place.setdefault(part, {})
        place[last] = load_yaml(text, f"--set {key}")
    return settings


def _plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else value


def _demand(ok: bool) -> None:
    if not ok:
        raise typer.Exit(1)


@contextmanager
def _progress(name: str) -> Iterator[Any]:
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=screen, transient=True) as bar:
        task = bar.add_task(name, total=None)
        yield lambda tick, last: bar.update(task, completed=tick, total=last)


def _print_table(columns: Any, rows: Any) -> None:
    table = Table(
        *(Column(name, overflow="fold") for name in columns), box=None, header_style="bold"
    )
    for row in rows:
        table.add_row(*map(str, row))
    Console().print(table)
