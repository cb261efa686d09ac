"""Which code of the user's own a trial runs, and its hashes, for the log."""

from flexslew_control.controllers import CONTROLLERS
from flexslew_lab.trial.trial import Trial, law_of
from flexslew_plant.own_code import code_hash
from flexslew_plant.testbeds import TESTBEDS

HASHES = "own_code"  # key in the metadata of a log: JSON, SHA-256 by name


def own_code_of(trial: Trial) -> dict[str, str]:
    """Return the SHA-256 of the files of laws, testbeds and metrics not built in, by name."""
    names = {law_of(name, values or {})[0] for name, values in trial.controllers.items()}
    names -= set(CONTROLLERS)
    names |= {trial.testbed.kind} - set(TESTBEDS) | set(trial.metrics)
    return {name: code_hash(name) for name in sorted(names)}
