"""The curves of an earlier run: drawn next to those of now, compared by their own names."""

from pathlib import Path

import numpy as np
from tests.fake_bench import FakeLink

from flexslew_lab.console.history import Curve
from flexslew_lab.console.page import Page
from flexslew_lab.console.panels import compare
from flexslew_lab.console.panels.charts import ChartsPanel
from flexslew_plant.events import OperatorNote
from flexslew_plant.events.event import event_of


def test_curves_are_compared_by_their_own_names_on_common_ticks() -> None:
    now = {"position": [Curve("yaw", np.array([0.0, 0.1, 0.2]), np.array([0.0, 1.0, 2.0]))]}
    earlier = {"position": [Curve("yaw", np.array([0.1, 0.2, 0.3]), np.array([1.5, 2.0, 9.0]))]}
    assert compare.largest_difference(now, earlier) == "largest difference: position 0.5 (yaw)"
    assert "no common tick" in compare.largest_difference(now, {})


def test_a_run_whose_joint_is_called_earlier_is_compared_too() -> None:
    curve = Curve("earlier yaw", np.array([0.0]), np.array([1.0]))
    same = {"position": [curve]}
    assert compare.largest_difference(same, same) == "largest difference: position 0 (earlier yaw)"
    overlay = compare.as_overlay(curve)
    assert (overlay.label, overlay.dashed) == ("earlier earlier yaw", True)


def test_another_overlay_is_drawn_though_nothing_moves(tmp_path: Path) -> None:
    page = Page(FakeLink(), "127.0.0.1", 0, print, layouts=tmp_path / "layouts.json")
    try:
        charts = next(panel for panel in page._panels if isinstance(panel, ChartsPanel))
        times = np.array([0.0, 1.0])
        for height in (1.0, 2.0):
            charts.overlay({"position": [Curve("earlier a", times, np.full(2, height))]})
            page.refresh()
            drawn = charts._charts[0]._plot.data.updates["dataset"]["source"]
            assert drawn["0"][0] == height
    finally:
        page.close()


def test_events_before_a_reset_are_no_lines_in_the_charts_after_it(tmp_path: Path) -> None:
    link = FakeLink()
    for epoch, time in ((0, 7.0), (1, 0.0), (1, 3.0)):
        event = event_of(OperatorNote("look", "somebody"), round(100 * time), time, epoch, "plant")
        link.view.events.append(event)
    page = Page(link, "127.0.0.1", 0, print, layouts=tmp_path / "layouts.json")
    try:
        charts = next(panel for panel in page._panels if isinstance(panel, ChartsPanel))
        page.refresh()
        words = str(charts._charts[0]._plot.data.updates)
        assert "3.0" in words
        assert "7.0" not in words
    finally:
        page.close()
