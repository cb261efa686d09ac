"""Numbers of things, in words."""

from flexslew_plant.counted import count_text


def test_one_is_no_plural() -> None:
    assert [count_text(n, "mode") for n in (0, 1, 2)] == ["0 modes", "1 mode", "2 modes"]
    assert [count_text(n, "switch", "switches") for n in (1, 3)] == ["1 switch", "3 switches"]
