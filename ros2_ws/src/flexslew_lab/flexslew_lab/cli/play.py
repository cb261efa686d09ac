"""Subcommands that show messages to others: play a log onto the topics, and the live view."""

import os
from dataclasses import dataclass
from typing import Annotated

import typer
from rich.progress import BarColumn, Progress, TextColumn

from flexslew_lab.cli.options.option_groups import expand_options
from flexslew_lab.cli.options.quantity import quantity
from flexslew_lab.cli.options.shared import Bag
from flexslew_lab.cli.terminal import for_people, print_message
from flexslew_lab.run.domain import requested_domain
from flexslew_lab.trial.outputs import bag_folder
from flexslew_plant.errors import BadInput


@dataclass(frozen=True)
class PlayOptions:
    """What is played, and how fast."""

    rate: Annotated[
        float, typer.Option(help="Speed relative to real time; 0: as fast as possible.")
    ] = 1.0
    start: Annotated[
        float,
        typer.Option(parser=quantity("s"), help="Simulated time at which to begin [s]."),
    ] = 0.0
    duration: Annotated[
        float | None,
        typer.Option(parser=quantity("s"), help="Simulated time to play [s]; default: all."),
    ] = None
    loop: Annotated[bool, typer.Option("--loop", help="Start over at the end.")] = False
    topics: Annotated[
        list[str] | None, typer.Option(help="Topic to play; default: all; may be repeated.")
    ] = None
    remap: Annotated[list[str] | None, typer.Option(help="old:=new; may be repeated.")] = None
    clock: Annotated[
        float,
        typer.Option(
            parser=quantity("Hz"),
            help="Generate /clock at this rate in place of the recorded one [Hz].",
        ),
    ] = 0.0
    pause: Annotated[bool, typer.Option("--pause", help="Wait for /play/resume.")] = False
    wait_for: Annotated[
        list[str] | None, typer.Option(help="Node that must be listening first; may be repeated.")
    ] = None


@expand_options
def play(
    bag: Bag,
    options: PlayOptions,
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
        "bag": str(bag_folder(bag)),
        "rate": options.rate,
        "start": options.start,
        "duration": options.duration,
        "loop": options.loop,
        "topics": options.topics or (),
        "remap": options.remap or (),
        "clock": options.clock,
        "paused": options.pause,
        "wait_for": options.wait_for or (),
    }
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
