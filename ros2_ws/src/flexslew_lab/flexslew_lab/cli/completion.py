"""The subcommand that prints what a shell needs to complete commands and names of trials."""

import sys

import typer

from flexslew_lab.cli.terminal import print_line

_SCRIPT = """_flexslew() {{
  local word=${{COMP_WORDS[COMP_CWORD]}} known
  if [ "$COMP_CWORD" = 1 ]; then known="{commands}"; else case ${{COMP_WORDS[1]}} in
    {flying}) known="{trials}" ;;
  esac; fi
  COMPREPLY=($(compgen -W "$known" -- "$word"))
}}
complete -o default -F _flexslew flexslew ./flexslew"""
_FLYING = ("trial", "plan", "compare", "console", "analyse", "gains", "model")


def completion(context: typer.Context) -> None:
    """Print a script with which bash or zsh completes commands and names of trials.

    Example: `eval "$(./flexslew completion)"`
    """
    from flexslew_lab.trial.sources import example_trials

    above = context.parent
    commands = sorted(getattr(above.command if above is not None else None, "commands", {}))
    script = _SCRIPT.format(
        commands=" ".join(commands),
        flying="|".join(_FLYING),
        trials=" ".join(trial.name for trial in example_trials()),
    )
    for line in script.splitlines():
        print_line(line)
    sys.stdout.flush()
