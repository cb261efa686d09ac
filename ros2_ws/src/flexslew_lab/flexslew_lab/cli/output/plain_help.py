"""Help in which a flag has no type: it is given or not."""

from typing import Any


def without_types(command: Any) -> Any:
    """Return a command of Click after taking the type of its flags, and of those below it, away."""
    for parameter in command.params:
        _plain(parameter)
    make_help = command.get_help_option

    def plain_help(context: Any) -> Any:
        """Return the option --help, which is made when it is needed."""
        return _plain(make_help(context))

    command.get_help_option = plain_help
    for below in getattr(command, "commands", {}).values():
        without_types(below)
    return command


def _plain(option: Any) -> Any:
    """Return an option after taking its type away if it is a flag."""
    if getattr(option, "is_bool_flag", False):
        option.display_type_rich = _no_type
    return option


def _no_type(ctx: Any) -> None:
    """Return nothing to show."""
