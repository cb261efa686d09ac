"""The parameters of the `recorder` node."""

import json
from typing import Annotated

from pydantic import AfterValidator

from flexslew_plant.settings import section


def _object(words: str) -> str:
    """Return JSON that is an object; raise a ValueError otherwise."""
    try:
        given = json.loads(words)
    except ValueError:
        given = None
    if not isinstance(given, dict):
        raise ValueError('a JSON object of texts, for example {"operator": "ann"}')
    return words


@section
class RecorderSettings:
    """The parameters of the node."""

    # of the bag; must not hold one yet, but one that a killed recorder of this run left goes on
    folder: str = "flexslew_bag"
    # of the run (trial, versions, ...), JSON, text to text
    metadata: Annotated[str, AfterValidator(_object)] = "{}"
    exit_with_plant: bool = False  # close the bag and end the process when the plant is gone
