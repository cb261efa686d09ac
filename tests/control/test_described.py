"""What a /testbed record may say, and what it may not."""

import pytest

from flexslew_control.law import plant_description
from flexslew_plant.errors import BadInput


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (text, "does not name its testbed")
        for text in ("", "1", "[]", "soon", "{}", "{bench: 3}", "{bench: {period: 0.01}}")
    ]
    + [
        (f"{{testbed: {{kind: csa}}, period: {period}}}", "period: ")
        for period in ("0.0", "-1", ".nan", ".inf", "soon", "[1.0]", "null")
    ],
)
def test_a_record_that_describes_no_plant_is_refused(settings: str, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        plant_description(settings, "the log")


def test_a_plant_is_described_by_its_bench_or_by_its_node() -> None:
    bench = "testbed: {kind: csa, modes: 3}, period: 0.02"
    for settings in (f"{{{bench}}}", f"{{bench: {{{bench}}}, rate_factor: 1.0}}"):
        plant = plant_description(settings, "the log")
        assert (plant.period, plant.testbed.model().modes) == (0.02, 3)
