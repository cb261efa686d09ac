import math
from typing import Annotated, Literal

from pydantic import Field

from flexslew_plant.keys.settings_fields import describe_fields, describe_section
from flexslew_plant.ros.plant.settings import PlantSettings
from flexslew_plant.settings import section


def test_words_and_ranges_come_from_the_section() -> None:
    found = describe_fields(PlantSettings())
    words, low, high, _ = found["rate_factor"]
    assert words.endswith("0: as fast as possible, 1: real time")
    assert (low, high) == (0.0, math.inf)
    assert found["answer_timeout"].low > 0.0
    assert found["bench.max_missed"].low == 1.0
    assert found["bench.period"].description == "length of a tick [s]; above 0"


@section
class _Extended(PlantSettings):
    """Keys of its own beside those that it extends."""

    # words above it
    # in two lines
    mode: Literal["fast", "slow"] = "fast"
    share: Annotated[float, Field(ge=-1.0, lt=0.5)] = 0.0  # of what: "a # b" [-]
    named: Annotated[int, Field(description="by its type")] = 0


def test_words_stand_behind_a_key_above_it_or_in_its_type() -> None:
    found = describe_section(_Extended)
    assert found["mode"].description == "words above it in two lines; one of fast, slow"
    assert found["share"].description == 'of what: "a # b" [-]; at least -1, below 0.5'
    assert found["named"].description == "by its type"
    assert found["rate_factor"].words
