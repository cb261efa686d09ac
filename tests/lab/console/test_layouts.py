"""Layouts of the charts: kept in a file, whatever stands in it."""

import json
from pathlib import Path

import pytest

from flexslew_lab.console import quantities
from flexslew_lab.console.layouts import CHART_COUNT, Layouts
from flexslew_plant.errors import BadInput


def test_a_layout_is_there_the_next_time(tmp_path: Path) -> None:
    file, shown = tmp_path / "own" / "layouts.json", [quantities.TIPS] * CHART_COUNT
    Layouts(file, quantities.NAMES).save("beams", shown)
    again = Layouts(file, quantities.NAMES)
    assert (again.last, again.active_plots()) == ("beams", tuple(shown))
    again.choose("flight")
    assert Layouts(file, quantities.NAMES).last == "flight"


@pytest.mark.parametrize("name", ["", "  ", "flight", "x" * 61])
def test_a_name_that_is_none_is_refused_and_nothing_is_kept(tmp_path: Path, name: str) -> None:
    layouts = Layouts(tmp_path / "layouts.json", quantities.NAMES)
    with pytest.raises(BadInput, match="Name of the layout"):
        layouts.save(name, [quantities.TIPS] * CHART_COUNT)
    assert not (tmp_path / "layouts.json").exists()


@pytest.mark.parametrize(
    "text",
    ["", "{", "[]", "null", '{"layouts": 3}', '{"last": 7}', "\udcff",
     json.dumps({"layouts": {"a": ["no such thing"] * 4, "b": [], "c": 7}, "last": "a"})],
)  # fmt: skip
def test_a_file_that_holds_something_else_holds_no_layout(tmp_path: Path, text: str) -> None:
    file = tmp_path / "layouts.json"
    file.write_bytes(text.encode(errors="surrogateescape"))
    found = Layouts(file, quantities.NAMES)
    assert found.last == "flight"
    assert "a" not in found.known
