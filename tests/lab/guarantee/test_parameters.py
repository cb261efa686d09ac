"""Ranges of parameters as they are written."""

import pytest

from flexslew_lab.guarantee.model.parameters import Spread, vary_of
from flexslew_plant.errors import BadInput


@pytest.mark.parametrize(
    ("text", "spread"),
    [
        ("20%", "20%"),
        ("0.5..2", [0.5, 2.0]),
        ("1e-3..2e-3", [0.001, 0.002]),
        ("1..9 ms", ["1 ms", "9 ms"]),
        ("-1e-2..1e-2 rad", ["-1e-2 rad", "1e-2 rad"]),
        ("1 ms..2 s", ["1 ms", "2 s"]),
    ],
)
def test_a_unit_at_the_end_of_a_range_is_that_of_both_ends(text: str, spread: Spread) -> None:
    assert vary_of([f"delay={text}"]) == {"delay": spread}


@pytest.mark.parametrize("given", ["delay", "=1..2", "delay="])
def test_what_is_no_range_is_refused(given: str) -> None:
    with pytest.raises(BadInput, match="give name=20%"):
        vary_of([given])
