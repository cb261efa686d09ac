"""A `model` section that names a file: what an identification has found."""

from collections.abc import Mapping
from typing import Any

from flexslew_plant.errors import BadInput
from flexslew_plant.named_file import data_of_file
from flexslew_plant.near_names import spelling_hint
from flexslew_plant.own_code import NO_CODE, Trust

FILE = "file"  # key of a `model` section
_MODEL = "model"  # key of the file
# what an identification writes; only the model is read
_KEYS = (_MODEL, "source", "band", "confidence", "modes", "inertia", "appendage")


def with_model_file(
    changes: Mapping[str, Any], source: str, trust: Trust = NO_CODE
) -> dict[str, Any]:
    """Return a `model` section with what its `file` holds under `model` in place of its name.

    Keys next to the file's name win.

    Args:
        changes: the section, with or without a `file`.
        source: place of the section, for an error.
        trust: whether files may be read.

    Raises:
        Untrusted: if a log names the file.
        BadInput: the file cannot be read, or holds no model.
    """
    given = dict(changes)
    if FILE not in given:
        return given
    path = given.pop(FILE)
    if path is None and "kind" in given:  # a whole section of a testbed with such a key of its own
        return given
    if not isinstance(path, str) or not path:
        raise BadInput("the path of an identified.yaml", source, FILE, path)
    values = data_of_file(path, f"{source}: {FILE}", trust)
    return {**model_of(values, f"{source}: {FILE}: {path}"), **given}


def model_of(values: Any, place: str) -> dict[str, Any]:
    """Return the section `model` of what an identified.yaml holds.

    Raises:
        BadInput: if it holds no model, or a key that no identification writes.
    """
    given = values if isinstance(values, dict) else {}
    for key in map(str, given):
        if key not in _KEYS:
            words = f"unknown key; {spelling_hint(key, _KEYS)}allowed: {', '.join(_KEYS)}"
            raise BadInput(words, place, key)
    model = given.get(_MODEL)
    if not isinstance(model, dict):
        words = "holds no model; `flexslew identify` writes one where it found all of it"
        raise BadInput(words, place)
    return model
