"""Text of a page: where a line may break."""

import pytest

from flexslew_lab.report.page import wrapped


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("0.000 -0.013 1e-05 5.948", "0.000 -0.013 1e-05 5.948"),
        ("effort.base_yaw", "effort.<wbr>base_<wbr>yaw"),
        ("runs/m1-a", "runs/<wbr>m1-<wbr>a"),
    ],
)
def test_names_may_go_on_in_the_next_line_and_numbers_may_not(text: str, shown: str) -> None:
    assert wrapped(text) == shown
