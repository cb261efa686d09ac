import pytest

from flexslew_plant.near_names import spelling_hint

KNOWN = ("m1", "swap_demo", "pd_feedforward", "optimized_feedforward")


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        ("m2", "m1"),
        ("M1", "m1"),
        ("swapdemo", "swap_demo"),
        ("optimised_feedforward", "optimized_feedforward"),
        ("pd_feedfoward", "pd_feedforward"),
    ],
)
def test_a_mistyped_name_is_recognised(given: str, meant: str) -> None:
    assert spelling_hint(given, KNOWN) == f"did you mean {meant}? "


@pytest.mark.parametrize("given", ["xy", "", "something else", 3, "x" * 10_000])
def test_of_what_is_near_to_nothing_nothing_is_said(given: object) -> None:
    assert spelling_hint(given, KNOWN) == ""
