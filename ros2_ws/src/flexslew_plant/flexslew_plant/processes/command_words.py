"""The command of a program, as a shell reads it."""

import shlex

from flexslew_plant.errors import BadInput


def command_words(command: str, key: str) -> list[str]:
    """Return program and arguments of a command.

    Args:
        command: as typed in a shell.
        key: option that gives it, for errors.

    Raises:
        BadInput: if it is empty, or its quotes do not match.
    """
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise BadInput(f"{error}; quote it as for a shell", key=key, value=command) from None
    if not words:
        raise BadInput("give the command that starts the controller", key=key, value=command)
    return words
