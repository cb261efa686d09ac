"""Text of a page: where a line may break."""

import pytest

from flexslew_lab.report.page import wrapped
from flexslew_lab.report.sections import Text, page_of_sections
from flexslew_lab.short_values import in_columns, one_format


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("0.000 -0.013 1e-05 5.948", "0.000 -0.013 1e-05 5.948"),
        ("effort.base_yaw", "effort.<wbr>base_<wbr>yaw"),
        ("runs/m1-a", "runs/<wbr>m1-<wbr>a"),
        ("5 N m at 2 rad/s", "5\xa0N\xa0m at 2\xa0rad/s"),
        ("peak effort [N m or N]", "peak effort [N\xa0m\xa0or\xa0N]"),
    ],
)
def test_names_may_go_on_in_the_next_line_and_numbers_and_units_may_not(
    text: str, shown: str
) -> None:
    assert wrapped(text) == shown


def test_the_verdict_stands_above_all_else_on_a_page() -> None:
    page = page_of_sections("study", "one", "about it", [Text("More", "words")], "refuted: x.y")
    body = page[page.index("<body>") :]
    places = [body.index(words) for words in ("Refuted: x.<wbr>y.", "about it", ">More<")]
    assert places == sorted(places)


def test_numbers_of_a_column_have_one_format() -> None:
    assert one_format([0.5, 12.25, 0.125], 3) == ["0.500", "12.250", "0.125"]
    assert one_format([1e-9, 12.5], 3) == ["1.00e-09", "1.25e+01"]
    assert one_format([float("inf"), 2.0, "lost", 7], 3) == ["-", "2.00", "lost", 7]
    assert in_columns([("a", 0.25), ("b", 100.0)], 2) == [["a", "0.25"], ["b", "100.00"]]
