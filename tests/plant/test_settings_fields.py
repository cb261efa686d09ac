import math

from flexslew_plant.ros.plant.settings import PlantSettings
from flexslew_plant.settings_fields import meanings


def test_words_and_ranges_come_from_the_section() -> None:
    found = meanings(PlantSettings())
    assert found["rate_factor"] == ("0: as fast as possible, 1: real time", 0.0, math.inf)
    assert found["answer_timeout"].low > 0.0
    assert found["bench.max_missed"].low == 1.0
    assert found["bench.period"].words == "one tick [s]"
