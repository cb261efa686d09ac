"""Subcommand that prints the JSON schema of a trial file."""

import json


def schema() -> None:
    """Print the JSON schema of a trial file, for editors that complete and check what you type.

    Example: `./flexslew schema > trial.schema.json`
    """
    from flexslew_lab.trial.schema import trial_schema

    print(json.dumps(trial_schema(), indent=1))
