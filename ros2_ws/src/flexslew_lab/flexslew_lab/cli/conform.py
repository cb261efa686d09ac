"""Subcommand that examines an external controller."""

import os
import signal
import subprocess
from typing import Annotated

import typer

from flexslew_lab.cli.log import Json
from flexslew_lab.cli.terminal import for_people, print_message, print_table
from flexslew_lab.json_text import json_text
from flexslew_plant.errors import BadInput

# until a controller that received SIGTERM is killed [wall s]; a node may need 10 s to leave the
# graph of Fast DDS (docs/limits.md), and more if other processes use the processors
_EXIT_TIMEOUT = 30.0


def conform(
    context: typer.Context,
    trial: Annotated[
        str, typer.Option(help="Shipped trial, or file, with the testbed to announce.")
    ] = "m1",
    patience: Annotated[
        float, typer.Option(min=0.1, max=600.0, help="Longest wait for an answer [wall s].")
    ] = 10.0,
    as_json: Json = False,
) -> None:
    """Run any controller's process through the lock-step and say what it gets wrong.

    COMMAND starts the controller, in whatever language: first question, repeats, a swap, late
    answers, a stray question, a pause, a reset, a backlog and a new start. The rules are those of
    the page "A controller in any language". Exit code 1: a rule is broken.

    Example: `./flexslew conform -- python docs/examples/any_language.py`
    """
    from flexslew_lab.ros.conformance import InterfaceTest
    from flexslew_lab.run.domain import locked_domain
    from flexslew_lab.trial.sources import read_trial
    from flexslew_lab.trial.trial import bench_settings
    from flexslew_plant.bench.bench import Bench

    if not context.args:
        raise BadInput("COMMAND: give the command that starts the controller, after --")
    bench = Bench(bench_settings(read_trial(trial)[0]))
    with locked_domain("conform", bench=False) as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        process = _started(context.args)

        def restart() -> str:
            nonlocal process
            wrong = _end(process)
            process = _started(context.args)
            return wrong

        def stop(stopped: bool) -> None:
            process.send_signal(signal.SIGSTOP if stopped else signal.SIGCONT)

        try:
            examiner = InterfaceTest(bench, patience, lambda: process.poll() is None, restart, stop)
            try:
                with for_people.status(f"asking {' '.join(context.args)}"):
                    results = examiner.check_rules()
            finally:
                examiner.close()
        finally:
            _end(process)
    wrong = sum(not result.ok for result in results)
    if as_json:
        print(json_text([{"rule": f.rule, "wrong": f.wrong} for f in results]))
    else:
        print_table(("rule", "result"), [(f.rule, f.wrong or "kept") for f in results])
        print_message(f"{len(results) - wrong} of {len(results)} rules kept")
    if wrong:
        raise typer.Exit(1)


def _started(command: list[str]) -> "subprocess.Popen[bytes]":
    """Return the process of a controller.

    Raises:
        BadInput: there is no such command.
    """
    try:
        return subprocess.Popen(command)
    except OSError as error:
        raise BadInput(f"COMMAND: {command[0]}: {error.strerror}") from None


def _end(process: "subprocess.Popen[bytes]") -> str:
    """End a process; return what is wrong if SIGTERM does not end it, else ""."""
    process.terminate()
    try:
        process.wait(_EXIT_TIMEOUT)
        return ""
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        return f"SIGTERM has not ended its process within {_EXIT_TIMEOUT:g} s; it was killed"
