"""The option of a replay that names a program: --with "COMMAND", or --with -- COMMAND."""

import shlex
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from flexslew_lab.cli.missing import require_ros
from flexslew_plant.processes.command_words import command_words

if TYPE_CHECKING:
    from flexslew_lab.replay.program import StartProgram

_OPTION = "--with"
With = Annotated[
    str | None,
    typer.Option(
        _OPTION,
        metavar="COMMAND",
        help="Program that answers instead, quoted or after `--with --` at the end.",
    ),
]
Patience = Annotated[
    float,
    typer.Option(min=0.1, max=600.0, help="Longest wait for the program's answer [wall s]."),
]


class CommandWithProgram(TyperCommand):
    """A command with the option --with: `--with -- COMMAND ARGUMENTS` is the same as one word."""

    def parse_args(self, context: Any, args: list[str]) -> list[str]:
        """Join the words after `--with --`."""
        for place, pair in enumerate(pairwise(args)):
            if pair == (_OPTION, "--"):
                args = [*args[: place + 1], shlex.join(args[place + 2 :])]
                break
        return super().parse_args(context, args)


def program_of(command: str | None, patience: float) -> "StartProgram | None":
    """Return what starts the program of the option; None without one.

    Raises:
        BadInput: it names no program, or its quotes do not match.
        FlexslewError: if ROS is not here.
    """
    if command is None:
        return None
    words = command_words(command, _OPTION)
    require_ros()
    from flexslew_lab.ros.lock_step.linked_program import linked_program

    return partial(linked_program, words, patience)
