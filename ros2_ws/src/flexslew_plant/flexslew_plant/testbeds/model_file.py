"""A `model` section that names a file: what an identification has found."""

from collections.abc import Mapping
from typing import Any

from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import given_text
from flexslew_plant.own_code import NO_CODE, Trust, require_file
from flexslew_plant.yaml_data import load_yaml

FILE = "file"  # key of a `model` section


def with_model_file(
    changes: Mapping[str, Any], source: str, trust: Trust = NO_CODE
) -> dict[str, Any]:
    """Return a `model` section with what its `file` holds under `model` in place of its name.

    Keys that stand beside the file's name win.

    Args:
        changes: the section, with or without a `file`.
        source: of the section, for an error.
        trust: whether files may be read.

    Raises:
        Untrusted: if a log names the file.
        BadInput: the file cannot be read, or holds no model.
    """
    given = dict(changes)
    if FILE not in given:
        return given
    path = given.pop(FILE)
    if not isinstance(path, str) or not path:
        raise BadInput("the path of an identified.yaml", source, FILE, path)
    require_file(trust, path, f"{source}: {FILE}")
    try:
        text = given_text(path)
    except BadInput as error:
        raise BadInput(error.refusal.why, f"{source}: {FILE}: {path}") from None
    values = load_yaml(text, f"{source}: {path}")
    model = values.get("model") if isinstance(values, dict) else None
    if not isinstance(model, dict):
        raise BadInput(
            f"{FILE}: {path}: holds no model; `flexslew identify` writes one where it found all "
            "of it",
            source,
        )
    return {**model, **given}
