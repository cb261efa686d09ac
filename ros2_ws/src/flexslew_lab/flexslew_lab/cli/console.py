"""The subcommand for the console: a page in the browser over a bench, or over a log."""

import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import Event as Signal
from threading import Thread
from typing import IO, TYPE_CHECKING, Annotated

import typer

from flexslew_lab.cli.interrupt import NODES_EXIT_TIMEOUT, SIGNAL_EXIT_CODE, exit_timeout
from flexslew_lab.cli.missing import require_ros
from flexslew_lab.cli.operate import Namespace
from flexslew_lab.cli.options.option_groups import expand_options
from flexslew_lab.cli.options.shared import RunFolder, Sets, TrustOption
from flexslew_lab.cli.terminal import link, print_message
from flexslew_lab.progress import display_progress
from flexslew_lab.run.domain import bench_domain
from flexslew_lab.trial.outputs import bag_folder
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import Trust

if TYPE_CHECKING:
    from flexslew_lab.run.run_trial import Result
    from flexslew_lab.trial.trial import Trial

_GRACE = 10.0  # for the page to end [wall s]
_NO_END = 1e9  # of a run without an end [s]


@dataclass(frozen=True)
class PageOptions:
    """Where the page listens."""

    port: Annotated[int, typer.Option(help="Port of the page; 0: any free one.")] = 8080
    host: Annotated[
        str, typer.Option(help="Listening address; not loopback: other machines can connect.")
    ] = "127.0.0.1"


@dataclass(frozen=True)
class RunOptions:
    """The run of a trial on the page."""

    sets: Sets = None
    out: RunFolder = None
    rate: Annotated[float, typer.Option(help="Rate at the start; 1: real time, 0: fast.")] = 1.0
    open_ended: Annotated[
        bool, typer.Option("--open-ended", help="Run until Ctrl-C, without an end.")
    ] = False
    in_process: Annotated[
        bool, typer.Option("--in-process", help="Without ROS 2, in one process.")
    ] = False


@expand_options
def console(
    file: Annotated[
        str | None, typer.Argument(help="Trial file, or the name of a shipped one; default: m1.")
    ] = None,
    attach: Annotated[bool, typer.Option("--attach", help="Join a running bench.")] = False,
    replay: Annotated[
        Path | None, typer.Option(help="A run's folder or bag, with a time slider.")
    ] = None,
    *,
    page: PageOptions,
    run: RunOptions,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Only print the address of the page.")
    ] = False,
    namespace: Namespace = "",
    trust: TrustOption = None,
) -> None:
    """Operate a bench from the browser: start, pause, switch controllers, inject faults, watch.

    Without --attach and --replay it opens the bench of a trial, which waits for its start.

    Example: `./flexslew console swap_demo`
    """
    if not 0 <= page.port <= 65535:
        raise BadInput("0 to 65535", key="--port", value=page.port)
    if not 0.0 <= run.rate < float("inf"):
        raise BadInput("0 is as fast as possible, 1 real time", key="--rate", value=run.rate)
    if sum((file is not None, attach, replay is not None)) > 1:
        raise BadInput("console: give one of a trial, --attach and --replay")
    for option, given in (("--open-ended", run.open_ended), ("--in-process", run.in_process)):
        if given and (attach or replay is not None):
            raise BadInput(f"console: {option} is for a trial, not for --attach or --replay")
    if namespace and not attach:
        raise BadInput("console: --namespace is for --attach")
    if replay is not None:
        from flexslew_lab.console.replay_page import serve

        trusted = Trust.of(trust or ())
        serve(bag_folder(replay), page.host, page.port, print_message, trusted, not no_browser)
        return
    at = page.host, page.port, not no_browser
    if not run.in_process:
        require_ros()
    if attach:
        _attach(at, namespace, tuple(trust or ()))
    else:
        fly = _run_in_process if run.in_process else _run
        raise typer.Exit(fly(file, run, at))


def _attach(at: tuple[str, int, bool], namespace: str, trust: tuple[str, ...]) -> None:
    domain, _ = bench_domain()
    os.environ["ROS_DOMAIN_ID"] = str(domain)
    from flexslew_lab.ros.console_node import ConsoleSettings
    from flexslew_lab.ros.console_node import console as serve

    print_message(f"ROS_DOMAIN_ID {domain}; Ctrl-C ends the page, not the bench")
    host, port, browser = at
    serve(
        ConsoleSettings(host=host, port=port, browser=browser, trust=trust),
        print_message,
        namespace,
    )


def _run(file: str | None, options: RunOptions, at: tuple[str, int, bool]) -> int:
    """Fly a trial together with its page; return the exit code."""
    from flexslew_lab.run.domain import locked_domain
    from flexslew_lab.run.run_trial import RunFeedback, run_trial
    from flexslew_lab.trial.own_code import user_code_names

    requested, source, folder, command = _requested(file, options)
    page = partial(_page, folder, command, at, user_code_names(requested))
    with locked_domain(requested.name) as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        with exit_timeout(NODES_EXIT_TIMEOUT), page() as child:
            with display_progress(requested.name, "ticks", "flying") as on_progress:
                result = run_trial(
                    requested,
                    source,
                    folder,
                    feedback=RunFeedback(on_progress, print_message),
                    autostart=False,
                )
            if _print_result(result) != SIGNAL_EXIT_CODE:
                child.wait()
    return result.exit_code


def _run_in_process(file: str | None, options: RunOptions, at: tuple[str, int, bool]) -> int:
    """Fly a trial in this process, which serves its page too; return the exit code."""
    from flexslew_lab.console.in_process.link import InProcessLink
    from flexslew_lab.console.page import Page
    from flexslew_lab.run.run_trial import RunFeedback, finished, run_trial

    requested, source, folder, command = _requested(file, options)
    host, port, browser = at
    bench = InProcessLink(str(folder.resolve()), command, requested.trust)
    page, over = Page(bench, host, port, print_message), Signal()
    if browser:
        page.server.open_browser()
    pages = Thread(target=page.serve, args=(over,))
    pages.start()
    exit_code = SIGNAL_EXIT_CODE
    try:
        with display_progress(requested.name, "ticks", "flying") as on_progress:
            result = run_trial(
                requested,
                source,
                folder,
                in_process=bench.fly,
                feedback=RunFeedback(on_progress, print_message),
            )
        exit_code = _print_result(result)
        over.wait()
    except KeyboardInterrupt:
        if exit_code == SIGNAL_EXIT_CODE and (folder / "bag").exists():  # before its end
            finished(folder, requested.trust, report=False)
            print_message(str(folder))
    finally:
        over.set()
        pages.join()
    return exit_code


def _requested(file: str | None, options: RunOptions) -> tuple["Trial", str, Path, str]:
    """Return the trial, its file, the folder of its run, and the command that repeats it."""
    from dataclasses import replace

    from flexslew_lab.trial.outputs import new_folder
    from flexslew_lab.trial.sources import read_trial

    requested, source = read_trial(file, options.sets)
    duration = _NO_END if options.open_ended else requested.duration
    requested = replace(requested, rate_factor=options.rate, duration=duration)
    words = ["./flexslew", "trial", file or "m1", *(f"--set={one}" for one in options.sets or ())]
    return requested, source, new_folder(requested.name, options.out), shlex.join(words)


def _print_result(result: "Result") -> int:
    """Print what a run left behind; return its exit code."""
    report = result.folder / "report.html"
    print_message(f"{link(report)}" if report.exists() else str(result.folder))
    if result.exit_code != SIGNAL_EXIT_CODE:
        if result.message:
            print_message(result.message)
        print_message("the run is over; Ctrl-C ends the page")
    return result.exit_code


@contextmanager
def _page(
    folder: Path, command: str, at: tuple[str, int, bool], trust: list[str]
) -> Iterator["subprocess.Popen[str]"]:
    """Yield the process of the page as soon as it has printed its address; end it afterwards."""
    settings: dict[str, object] = {"folder": str(folder.resolve()), "command": command}
    settings |= dict(zip(("host", "port", "browser"), at, strict=True))
    settings |= {"trust": trust} if trust else {}  # ROS has no list without entries
    words = [sys.executable, "-P", "-m", "flexslew_lab.ros.console_node", "--ros-args"]
    for key, value in settings.items():
        words += [
            "-p",
            f"{key}:={value!r}" if isinstance(value, str) else f"{key}:={value}".lower(),
        ]
    child = subprocess.Popen(  # a session of its own: Ctrl-C is ours
        words,
        env=os.environ | {"PYTHONUNBUFFERED": "1", "FLEXSLEW_SUPERVISOR": str(os.getpid())},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert child.stdout is not None
    try:
        for line in child.stdout:
            print_message(line.rstrip())
            if line.startswith("open "):
                break
        else:
            raise BadInput(f"console: the page ended with exit code {child.wait()}")
        Thread(target=_pass_on, args=(child.stdout,), daemon=True).start()
        yield child
    finally:
        child.send_signal(signal.SIGINT)
        try:
            child.wait(_GRACE)
        except subprocess.TimeoutExpired:
            child.kill()


def _pass_on(lines: IO[str]) -> None:
    for line in lines:
        print_message(line.rstrip())
