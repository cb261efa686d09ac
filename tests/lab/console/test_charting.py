"""Charts as ECharts takes them: colours, windows, holes."""

import json

import numpy as np

from flexslew_lab.console.charting import ChartData, chart_update, full_chart, options
from flexslew_lab.console.history import Curve

NOTHING = np.zeros(0)


def test_a_reference_is_dashed_in_the_colour_of_its_joint() -> None:
    curves = [
        Curve("a", NOTHING, NOTHING, color=0), Curve("b", NOTHING, NOTHING, color=1),
        Curve("reference a", NOTHING, NOTHING, True, color=0),
    ]  # fmt: skip
    a, b, reference, _ = options(curves)["series"]
    assert a["color"] == reference["color"] != b["color"]
    assert (a["lineStyle"]["type"], reference["lineStyle"]["type"]) == ("solid", "dashed")


def test_the_window_is_the_axis_and_what_is_not_known_is_a_hole() -> None:
    row = np.array([np.nan, 1e-9, np.inf, 4.0])
    found = chart_update(np.array([80.0, 90.0, 100.0, 110.0]), [row], np.array([95.0]))
    assert found["xAxis"] == {"min": 80.0, "max": 110.0}
    assert found["dataset"]["source"]["0"] == [None, 1e-9, None, 4.0]
    assert found["series"][-1]["markLine"]["data"] == [{"xAxis": 95.0}]
    json.dumps(found, allow_nan=False)


def test_lines_of_events_lie_below_the_curves() -> None:
    below = full_chart(ChartData(options([]), chart_update(NOTHING, [], np.array([95.0]))))[
        "series"
    ][-1]
    assert below["markLine"]["z"] < 2  # the layer of curves, where nothing else is said


def test_a_browser_that_comes_late_gets_looks_and_rows_and_neither_is_changed() -> None:
    axes = options([Curve("a", NOTHING, NOTHING)], "course")
    rows = chart_update(np.array([0.0, 1.0]), [np.array([1.0, 2.0])], NOTHING)
    before = json.dumps([axes, rows])
    found = full_chart(ChartData(axes, rows))
    assert found["xAxis"]["type"] == "value"
    assert (found["xAxis"]["min"], found["xAxis"]["max"]) == (0.0, 1.0)
    assert found["dataset"]["source"]["0"] == [1.0, 2.0]
    assert found["series"][0]["name"] == "a"
    assert json.dumps([axes, rows]) == before


def test_a_chart_names_time_with_its_unit_and_says_in_words_what_it_shows() -> None:
    axes = options([Curve("a [rad]", NOTHING, NOTHING), Curve("limit 150 N m", NOTHING, NOTHING)])
    assert axes["title"]["text"] == "time [s]"
    spoken = axes["aria"]["label"]["description"]
    assert spoken == "chart of a [rad], limit 150 N m over time [s]"
