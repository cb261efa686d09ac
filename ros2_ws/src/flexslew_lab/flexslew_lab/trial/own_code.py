"""Which code of the user's own a trial runs and which data it reads, with hashes for the log."""

import shlex
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from flexslew_control.controllers import CONTROLLERS
from flexslew_control.planners import PLANNERS
from flexslew_lab.trial.trial import Trial, law_of
from flexslew_plant.own_code import code_hash
from flexslew_plant.settings import plain
from flexslew_plant.testbeds import TESTBEDS
from flexslew_plant.testbeds.spacecraft.finite_elements.readers import files_of

HASH_KEY = "own_code"  # key in the metadata of a log: JSON, SHA-256 by name


def user_code_names(trial: Trial) -> list[str]:
    """Return the names of the laws, testbeds, planners and metrics that are not built in.

    The name of a program that is the plant or a controller is its command.
    """
    values = plain(trial)
    names = {law_of(name, settings or {})[0] for name, settings in values["controllers"].items()}
    names -= set(CONTROLLERS)
    names |= {*_values_of_key("kind", [values["testbed"], values["plan"], values["controllers"]])}
    names |= {*_values_of_key("method", [values["plan"]])} - set(PLANNERS)
    programs = {getattr(trial.testbed, "code_name", "")} - {""}
    programs |= {
        shlex.join(map(str, command))
        for settings in values["controllers"].values()
        if isinstance(command := (settings or {}).get("command"), list | tuple) and command
    }
    return sorted(names - set(TESTBEDS) | set(trial.metrics) | programs)


def user_file_hashes(trial: Trial) -> dict[str, str]:
    """Return the SHA-256 of what is not built in: files of classes and programs, by their names.

    Files of data, as of finite element models, and those that are read beside them, by their paths.
    """
    names = [*user_code_names(trial), *_data_files(trial)]
    return {name: code_hash(name) for name in names}


def _data_files(trial: Trial) -> list[str]:
    """Return the paths of the files that testbed, models of laws and plan name."""
    values = plain(trial)
    found = set[str]()
    for name in texts_in([values[key] for key in ("testbed", "controllers", "plan")]):
        with suppress(OSError, ValueError):  # of a text that could be no file's name
            if Path(name).is_file():
                found |= {str(file) for file in files_of(Path(name)) if file.is_file()}
    return sorted(found)


def texts_in(values: Any) -> Iterator[str]:
    """Yield every text in plain data."""
    if isinstance(values, str):
        yield values
    elif isinstance(values, dict | list | tuple):
        for value in values.values() if isinstance(values, dict) else values:
            yield from texts_in(value)


def _values_of_key(key: str, values: Any) -> Iterator[str]:
    """Yield the texts under a key of a testbed, or of a `model` that changes one."""
    for part in values.values() if isinstance(values, dict) else values:
        if isinstance(part, dict):
            if isinstance(part.get(key), str):
                yield part[key]
            yield from _values_of_key(
                key, [part[k] for k in ("model",) if isinstance(part.get(k), dict)]
            )
