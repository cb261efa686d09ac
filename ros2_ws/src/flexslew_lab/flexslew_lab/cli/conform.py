"""Subcommand that examines an external controller or plant."""

from typing import Annotated

import typer

from flexslew_lab.cli.log import exit_unless
from flexslew_lab.cli.options.shared import Json
from flexslew_lab.cli.terminal import for_people, print_message, print_table
from flexslew_lab.json_text import json_text
from flexslew_plant.errors import BadInput


def conform(
    context: typer.Context,
    trial: Annotated[
        str, typer.Option(help="Shipped trial, or file, with the testbed or period to announce.")
    ] = "m1",
    patience: Annotated[
        float, typer.Option(min=0.1, max=600.0, help="Longest wait for an answer [wall s].")
    ] = 10.0,
    plant: Annotated[
        bool, typer.Option("--plant", help="COMMAND is a plant instead of a controller.")
    ] = False,
    serial: Annotated[
        str,
        typer.Option(
            metavar="PORT", help="Check a board, or with --plant a plant, on this serial port."
        ),
    ] = "",
    baud: Annotated[int, typer.Option(min=1, help="Rate of the serial line [bit/s].")] = 921_600,
    as_json: Json = False,
) -> None:
    """Run any controller's or plant's process through the lock-step and list the broken rules.

    COMMAND starts the controller, in whatever language: first question, repeats, a swap, late
    answers, a stray question, a pause, a reset, a backlog and a new start. The rules are those of
    the page "A controller in any language"; with --plant, those of "A plant of your own"; with
    --serial, those of "From the bench to the rig", where a plant with its own clock gets zero
    efforts.
    Exit code 1: a rule is broken.

    Example: `./flexslew conform -- python docs/examples/any_language.py`
    """
    if bool(serial) == bool(context.args):
        what = "plant" if plant else "controller"
        raise BadInput(f"COMMAND: give the command that starts the {what}, after --, or --serial")
    if plant:
        pairs = _plant_rules(tuple(context.args), serial, baud, patience, trial)
    elif serial:
        pairs = _board_rules(serial, baud, trial, patience)
    else:
        pairs = _controller_rules(context.args, trial, patience)
    _report(pairs, as_json)


def _report(pairs: list[tuple[str, str]], as_json: bool) -> None:
    """Print rules and what is wrong with each; exit with 1 if one is broken."""
    wrong = sum(bool(words) for _, words in pairs)
    if as_json:
        print(json_text([{"rule": rule, "wrong": words} for rule, words in pairs]))
    else:
        print_table(("rule", "result"), [(rule, words or "kept") for rule, words in pairs])
        print_message(f"{len(pairs) - wrong} of {len(pairs)} rules kept")
    exit_unless(not wrong)


def _plant_rules(
    command: tuple[str, ...], serial: str, baud: int, patience: float, trial: str
) -> list[tuple[str, str]]:
    """Return the rules for plants, and what is wrong with each; print the times of the steps."""
    from flexslew_lab.trial.sources import read_trial
    from flexslew_plant.events import message_of
    from flexslew_plant.external.plant_rules import PlantRules
    from flexslew_plant.testbeds.black_box.plant_address import PlantAddress

    period = read_trial(trial)[0].period
    address = PlantAddress(command, serial, baud, patience)
    with for_people.status(f"asking {address.name}"):
        rules = PlantRules(address.connect, period)
        results = rules.check()
    for fact in rules.facts:
        print_message(message_of(fact))
    return [(result.rule, result.wrong) for result in results]


def _board_rules(device: str, baud: int, trial: str, patience: float) -> list[tuple[str, str]]:
    """Return the rules for boards, and what is wrong with each; print the times of the steps."""
    from flexslew_control.external_controller import controller_hello
    from flexslew_lab.board_rules import BoardRules
    from flexslew_lab.trial.sources import read_trial
    from flexslew_lab.trial.trial import plant_of
    from flexslew_plant.serial_line.exchange import Exchange, Patience
    from flexslew_plant.serial_line.port import SerialPort

    hello = controller_hello(plant_of(read_trial(trial)[0]))
    port = SerialPort(device, baud)
    try:
        rules = BoardRules(port, Exchange(port, Patience(patience)), hello)
        with for_people.status(f"asking {device}"):
            results = rules.check()
    finally:
        port.close()
    if rules.times is not None:
        print_message(str(rules.times))
    return [(result.rule, result.wrong) for result in results]


def _controller_rules(command: list[str], trial: str, patience: float) -> list[tuple[str, str]]:
    """Return the rules for controllers, and what is wrong with each; empty: nothing."""
    from flexslew_lab.ros.lock_step.conformance import InterfaceTest
    from flexslew_lab.run.controller_process import controller_process
    from flexslew_lab.trial.sources import read_trial
    from flexslew_lab.trial.trial import bench_settings
    from flexslew_plant.bench.bench import Bench

    bench = Bench(bench_settings(read_trial(trial)[0]))
    with controller_process(command, "conform") as process:
        examiner = InterfaceTest(bench, patience, process)
        try:
            with for_people.status(f"asking {' '.join(command)}"):
                results = examiner.check_rules()
        finally:
            examiner.close()
    return [(result.rule, result.wrong) for result in results]
