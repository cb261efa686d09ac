"""Which code of the user's own a trial runs, and its hashes, for the log."""

from collections.abc import Iterator
from typing import Any

from flexslew_control.controllers import CONTROLLERS
from flexslew_control.planners import PLANNERS
from flexslew_lab.trial.trial import Trial, law_of
from flexslew_plant.own_code import code_hash
from flexslew_plant.settings import plain
from flexslew_plant.testbeds import TESTBEDS

HASH_KEY = "own_code"  # key in the metadata of a log: JSON, SHA-256 by name


def user_code_names(trial: Trial) -> list[str]:
    """Return the names of the laws, testbeds, planners and metrics that are not built in."""
    values = plain(trial)
    names = {law_of(name, settings or {})[0] for name, settings in values["controllers"].items()}
    names -= set(CONTROLLERS)
    names |= {*_values_of_key("kind", [values["testbed"], values["plan"], values["controllers"]])}
    names |= {*_values_of_key("method", [values["plan"]])} - set(PLANNERS)
    return sorted(names - set(TESTBEDS) | set(trial.metrics))


def user_code_hash(trial: Trial) -> dict[str, str]:
    """Return the SHA-256 of the files of laws, testbeds, planners and metrics not built in."""
    return {name: code_hash(name) for name in user_code_names(trial)}


def _values_of_key(key: str, values: Any) -> Iterator[str]:
    """Yield the texts under a key of a testbed, or of a `model` that changes one."""
    for part in values.values() if isinstance(values, dict) else values:
        if isinstance(part, dict):
            if isinstance(part.get(key), str):
                yield part[key]
            yield from _values_of_key(
                key, [part[k] for k in ("model",) if isinstance(part.get(k), dict)]
            )
