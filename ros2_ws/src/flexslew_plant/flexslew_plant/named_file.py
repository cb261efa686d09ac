"""YAML files that a section names in place of its values."""

from typing import Any

from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import given_text
from flexslew_plant.own_code import Trust, require_file
from flexslew_plant.yaml_data import load_yaml


def data_of_file(path: str, place: str, trust: Trust) -> Any:
    """Return what the YAML file of a key holds.

    Args:
        path: of the file.
        place: file and key that name it, for an error.
        trust: whether files may be read.

    Raises:
        Untrusted: if a log names the file.
        BadInput: it cannot be read, or is not YAML; with place and path.
    """
    require_file(trust, path, place)
    try:
        text = given_text(path)
    except BadInput as error:
        raise BadInput(error.refusal.why, f"{place}: {path}") from None
    return load_yaml(text, f"{place}: {path}")
