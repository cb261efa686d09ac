"""Subcommands that replay a log: resimulate, check a controller, play; and the live view."""

import os
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import BarColumn, Progress, TextColumn

from flexslew_lab.cli.log import Bag, Json, exit_unless
from flexslew_lab.cli.terminal import (
    for_people,
    link,
    print_line,
    print_message,
    print_table,
)
from flexslew_lab.json_text import json_text
from flexslew_lab.progress import display_progress
from flexslew_lab.run.domain import requested_domain
from flexslew_lab.trial.outputs import bag_folder, check_output_file
from flexslew_plant.counted import count_text
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import Trust

TrustOption = Annotated[
    list[str] | None,
    typer.Option(
        "--trust", help="Allow this class that is named there: file.py:Class, or all; repeatable."
    ),
]
Partial = Annotated[
    bool, typer.Option("--partial", help="The log holds a part of the run: accept that part.")
]


def resim(
    bag: Bag,
    elsewhere: Annotated[
        bool, typer.Option(help="Recorded on another build or processor: accept rounding.")
    ] = False,
    sets: Annotated[
        list[str] | None,
        typer.Option(
            "--set", help="key.path=value of the trial but its plan: what does it change?"
        ),
    ] = None,
    partial: Partial = False,
    trust: TrustOption = None,
    as_json: Json = False,
) -> None:
    """Simulate a run again from its log alone and compare the trajectory.

    The exit code is 1 unless every bit is the same; --elsewhere accepts a difference of each field
    of up to 1e-9 of its largest magnitude. A law or a testbed from a file or a module runs only if
    --trust names it.

    Example: `./flexslew resim runs/m1-20260101-120000`
    """
    from flexslew_lab.replay.resim import TOLERANCE
    from flexslew_lab.replay.resim import resim as fly_again
    from flexslew_lab.trial.sources import changes_of

    with display_progress("resim", "ticks") as update:
        result = fly_again(bag_folder(bag), update, changes_of(sets), Trust.of(trust or ()))
    first = result.first_difference
    if as_json:
        values = {**result._asdict(), "first_difference": first and first._asdict()}
        values |= {"within_tolerance": result.within_tolerance, "tolerance": TOLERANCE}
        print(json_text(values))
    else:
        replay_counts = ", ".join(
            f"{count} {kind}" for kind, count in result.replayed.items() if count
        )
        rows = [
            ("recorded", result.recorded_hash),
            ("again", result.hash),
            ("ticks", f"{result.ticks}"),
            ("from the log", replay_counts or "no request of an operator, no missed tick"),
            *((f"largest of {name}", f"{value:.3g}") for name, value in result.largest.items()),
            *(
                (f"version of {n}", f"{a} there, {b} here")
                for n, (a, b) in result.other_versions.items()
            ),
        ]
        print_table(("", "bit-identical" if result.identical else "DIFFERENT"), rows)
        if first is not None:
            print_line(
                f"first difference: tick {first.tick} of epoch {first.epoch}, {first.field}: "
                f"recorded {first.recorded!r}, here {first.ours!r}"
            )
    _print_coverage(result.missing, result.changed_code)
    exit_unless(result.identical or (elsewhere and result.within_tolerance))
    exit_unless(partial or not result.missing)


def check(
    bag: Bag,
    controller: Annotated[
        str, typer.Argument(help="Name of the controller in the log; default: the first in it.")
    ] = "",
    law: Annotated[str | None, typer.Option(help="Law instead of the recorded one.")] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set", help="key=value in YAML, replaces the recorded one; may be repeated."
        ),
    ] = None,
    figure: Annotated[Path | None, typer.Option(help="Draw the differences as HTML.")] = None,
    partial: Partial = False,
    trust: TrustOption = None,
    as_json: Json = False,
) -> None:
    """Feed recorded measurements to a controller and compare every number of its answers.

    The exit code is 1 if any number differs.

    Example: `./flexslew check runs/m1-20260101-120000 pd_feedforward`
    """
    from flexslew_lab.log.bag_reader import BagReader
    from flexslew_lab.replay.check import check as compare
    from flexslew_lab.replay.check import difference_page
    from flexslew_lab.replay.logged_code import reading
    from flexslew_lab.replay.logged_controllers import logged_laws

    if figure is not None:
        check_output_file(figure, "--figure")
    place = bag_folder(bag)
    trusted = Trust.of(trust or ())
    with reading(reader := BagReader(place, trust=trusted)):
        name = controller or next(iter(logged_laws(reader)))
    with display_progress("check", "ticks") as update:
        result = compare(place, name, law, _settings(settings or []), update, trusted)
    if figure is not None:
        from flexslew_lab.report.page import write_page

        print_message(f"drawn {link(write_page(difference_page(result), figure))}")
    first = result.first_divergence
    if as_json:
        values = result._asdict()
        del values["curves"]
        values["first_divergence"] = first and {k: _plain(v) for k, v in first._asdict().items()}
        values["rows"] = [row._asdict() for row in result.rows]
        print(json_text(values))
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
        print_table(columns, rows)
        print_line(
            f"{result.controller} ({result.law}): {count_text(result.ticks, 'answer')} compared, "
            f"{result.only_recorded} only in the log, {result.only_ours} only from this controller"
        )
        if first is not None:
            print_line(
                f"first divergence: tick {first.tick} of epoch {first.epoch}, {first.field}: "
                f"recorded {first.recorded!r}, here {first.ours!r}"
            )
    _print_coverage(result.missing, result.changed_code)
    exit_unless(result.ok and (partial or not result.missing))


def play(
    bag: Bag,
    rate: Annotated[
        float, typer.Option(help="Speed relative to real time; 0: as fast as possible.")
    ] = 1.0,
    start: Annotated[float, typer.Option(help="Simulated time at which to begin [s].")] = 0.0,
    duration: Annotated[
        float | None, typer.Option(help="Simulated time to play [s]; default: all.")
    ] = None,
    loop: Annotated[bool, typer.Option("--loop", help="Start over at the end.")] = False,
    topics: Annotated[
        list[str] | None, typer.Option(help="Topic to play; default: all; may be repeated.")
    ] = None,
    remap: Annotated[list[str] | None, typer.Option(help="old:=new; may be repeated.")] = None,
    clock: Annotated[
        float, typer.Option(help="Generate /clock at this rate in place of the recorded one [Hz].")
    ] = 0.0,
    pause: Annotated[bool, typer.Option("--pause", help="Wait for /play/resume.")] = False,
    wait_for: Annotated[
        list[str] | None, typer.Option(help="Node that must be listening first; may be repeated.")
    ] = None,
    namespace: Annotated[
        str, typer.Option(help="Namespace of the topics; default: as recorded.")
    ] = "",
) -> None:
    """Publish the messages of a bag again, in order, with their stamps.

    Services: /play/pause, /play/resume (Trigger), /play/step (flexslew_msgs/Step) and /play/seek
    (flexslew_msgs/Seek).

    Example: `./flexslew play runs/m1-20260101-120000 --rate 10`
    """
    from flexslew_lab.replay.player import PlaySettings
    from flexslew_lab.ros.play_node import play as run
    from flexslew_plant.settings import validated

    values = {
        "bag": str(bag_folder(bag)), "rate": rate, "start": start, "duration": duration,
        "loop": loop,
        "topics": topics or (), "remap": remap or (), "clock": clock, "paused": pause,
        "wait_for": wait_for or (),
    }  # fmt: skip
    settings: PlaySettings = validated(PlaySettings, values, "play")
    print_message(f"playing on ROS_DOMAIN_ID {requested_domain() or 0}; Ctrl-C ends it")
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[at]}"))
    hidden = not for_people.is_terminal
    with Progress(*columns, console=for_people, transient=True, disable=hidden) as bar:
        task = bar.add_task("play", total=None, at="")

        def report(time: float, end: float) -> None:
            bar.update(task, completed=time, total=end, at=f"{time:.2f} of {end:.2f} s")

        run(settings, report, namespace)


def live(
    port: Annotated[int, typer.Option(help="Port on 127.0.0.1; 0: any free one.")] = 8765,
    namespace: Annotated[str, typer.Option(help="Namespace of the bench, if it has one.")] = "",
    operate: Annotated[
        bool, typer.Option("--operate", help="Clients may command the bench, too.")
    ] = False,
    origin: Annotated[
        list[str] | None,
        typer.Option(help="Origin of another page that may connect; may be repeated."),
    ] = None,
) -> None:
    """Show a running bench in the Foxglove app, over a WebSocket server on this machine only.

    The address that it prints is opened in Foxglove.

    Example: `./flexslew live`
    """
    from flexslew_lab.ros.live_node import LiveSettings
    from flexslew_lab.ros.live_node import live as run
    from flexslew_lab.run.domain import bench_domain

    if not 0 <= port <= 65535:
        raise BadInput("0 to 65535", key="--port", value=port)
    domain, _ = bench_domain()
    os.environ["ROS_DOMAIN_ID"] = str(domain)
    print_message(f"ROS_DOMAIN_ID {domain}")
    settings = LiveSettings(port=port, operate=operate, origins=tuple(origin or ()))
    run(settings, print_message, namespace)


def _print_coverage(missing: str, changed: dict[str, tuple[str, str]]) -> None:
    """Print what a comparison does not cover, and the code that differs from the recorded one."""
    for name, (recorded, here) in changed.items():
        print_message(
            f"{name} is another file: SHA-256 {recorded[:16]} in the log, {here[:16]} here"
        )
    if missing:
        print_message(missing, head="partial: ")


def _settings(pairs: list[str]) -> dict[str, Any]:
    """Return `key=value` texts as settings; dots nest."""
    from flexslew_plant.yaml_data import load_yaml

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
