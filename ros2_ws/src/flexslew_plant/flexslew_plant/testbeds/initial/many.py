"""Many testbeds at once, as a study has them: what takes long for each is done for all."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

from flexslew_plant.errors import FlexslewError
from flexslew_plant.testbeds.contract import ManyModels, Testbed
from flexslew_plant.testbeds.model import Model


def models_of(testbeds: Sequence[Testbed]) -> list[Model | FlexslewError]:
    """Return the model of each of many testbeds, or why it has none."""
    kinds: Any = {type(testbed) for testbed in testbeds}
    if len(kinds) == 1 and implements(*kinds, ManyModels):
        models: list[Model | FlexslewError] = [*kinds.pop().many_models(testbeds)]
        return models
    return [_model_or_error(testbed) for testbed in testbeds]


def _model_or_error(testbed: Testbed) -> Model | FlexslewError:
    try:
        return testbed.model()
    except FlexslewError as error:
        return error


@lru_cache
def implements(kind: Any, protocol: Any) -> bool:
    """Return whether testbeds of a kind implement a protocol; cached, for it takes long."""
    return issubclass(kind, protocol)
