"""A `model` section that names a file: what an identification has found."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from flexslew_plant.errors import BadInput
from flexslew_plant.yaml_data import load_yaml

FILE = "file"  # key of a `model` section


def with_model_file(changes: Mapping[str, Any], source: str) -> dict[str, Any]:
    """Return a `model` section with what its `file` holds under `model` in place of its name.

    Keys that stand beside the file's name win.

    Args:
        changes: the section, with or without a `file`.
        source: who names it, for an error.

    Raises:
        BadInput: the file cannot be read, or holds no model.
    """
    given = dict(changes)
    if FILE not in given:
        return given
    path = given.pop(FILE)
    if not isinstance(path, str) or not path:
        raise BadInput("the path of an identified.yaml", source, FILE, path)
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError, ValueError) as error:
        why = getattr(error, "strerror", None) or "it is not a text file"
        raise BadInput(f"{FILE}: {path}: cannot be read: {why}", source) from None
    values = load_yaml(text, f"{source}: {path}")
    model = values.get("model") if isinstance(values, dict) else None
    if not isinstance(model, dict):
        raise BadInput(
            f"{FILE}: {path}: holds no model; `flexslew identify` writes one where it found all "
            "of it",
            source,
        )
    return {**model, **given}
