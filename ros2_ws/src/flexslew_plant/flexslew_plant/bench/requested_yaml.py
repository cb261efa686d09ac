"""What operators write, as YAML that a log can hold."""

from typing import Any

from flexslew_plant.errors import BadInput
from flexslew_plant.events import too_long
from flexslew_plant.yaml_data import load_yaml, require_no_anchor


def requested_yaml(text: str, source: str) -> Any:
    """Return the content of an operator's text, which becomes part of an event.

    Raises:
        BadInput: it is not YAML, is too long for an event, or has anchors: no log is read that
            has one, see settings.require_no_anchor.
    """
    if words := too_long(text):
        raise BadInput(words, source)
    require_no_anchor(text, source)
    return load_yaml(text, source)
