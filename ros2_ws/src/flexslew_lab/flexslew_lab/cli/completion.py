"""The subcommand that prints what a shell needs to complete commands, options and trials."""

import sys
from collections.abc import Iterator
from typing import Annotated, Any, Literal

import typer

from flexslew_lab.cli.terminal import print_line

_SCRIPT = """_flexslew() {{
  local word=${{COMP_WORDS[COMP_CWORD]}} known
  if [ "$COMP_CWORD" = 1 ]; then known="{commands}"; else case ${{COMP_WORDS[1]}} in
{cases}
  esac; fi
  COMPREPLY=($(compgen -W "$known" -- "$word"))
}}
complete -o default -F _flexslew flexslew ./flexslew"""
_HEADS = {"bash": "", "zsh": "autoload -U +X bashcompinit && bashcompinit\n"}
_FLYING = ("trial", "plan", "compare", "console", "analyse", "budget", "gains", "model")


def completion(
    context: typer.Context,
    shell: Annotated[
        Literal["bash", "zsh"], typer.Argument(help="The shell that shall complete.")
    ] = "bash",
) -> None:
    """Print a script with which bash or zsh completes commands, options and names of trials.

    Example: `eval "$(./flexslew completion bash)"`
    """
    from flexslew_lab.trial.sources import example_trials

    above = context.parent
    commands = getattr(above.command if above is not None else None, "commands", {})
    trials = [trial.name for trial in example_trials()]
    known = {
        name: [*_words(commands[name]), *(trials if name in _FLYING else ())]
        for name in sorted(commands)
    }
    cases = [f'    {name}) known="{" ".join(words)}" ;;' for name, words in known.items()]
    script = _HEADS[shell] + _SCRIPT.format(commands=" ".join(known), cases="\n".join(cases))
    for line in script.splitlines():
        print_line(line)
    sys.stdout.flush()


def _words(command: Any) -> Iterator[str]:
    """Yield the commands below a command, then its long options."""
    yield from getattr(command, "commands", {})
    for parameter in command.params:
        yield from (option for option in parameter.opts if option.startswith("--"))
