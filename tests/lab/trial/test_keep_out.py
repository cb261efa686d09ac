"""A flight past a cone in the sky: measured, checked and drawn."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.fake_bench import FakeLink

from flexslew_lab.console.page import Page
from flexslew_lab.console.panels.sky import SkyPanel
from flexslew_lab.console.view import COORDINATES
from flexslew_lab.report.sky_map import projected
from flexslew_lab.run.run_trial import CHECK_FAILED, Result, run_trial
from flexslew_lab.trial.trial import trial_of_values
from flexslew_plant.errors import PlanFailed
from flexslew_plant.testbeds import read_testbed

CRAFT: dict[str, Any] = {
    "kind": "spacecraft",
    "platform": {"mass": 50.0, "inertia": {"xx": 10.0, "yy": 12.0, "zz": 14.0}},
    "actuators": {
        "roll": {"kind": "torque", "direction": [1.0, 0.0, 0.0], "limit": 2.0},
        "pitch": {"kind": "torque", "direction": [0.0, 1.0, 0.0], "limit": 2.0},
        "yaw": {"kind": "torque", "direction": [0.0, 0.0, 1.0], "limit": 2.0},
    },
}


# ends of what was planned, in units of the drawing
DASHED = r'<path d="M(\S+) ([^"L]+)L[^"]*L(\S+) ([^"L]+)" fill="none" stroke="\S+" stroke-dasharray'


def flown(folder: Path, method: str, half_angle: float) -> Result:
    """Return a turn of the z axis by 1 rad past a cone 0.3 rad beside its middle."""
    beside = [np.sin(0.3), -np.sin(0.5) * np.cos(0.3), np.cos(0.5) * np.cos(0.3)]
    values = {
        "name": "past_a_cone", "duration": 40.0, "period": 0.05,
        "testbed": {**CRAFT, "keep_out": {"<sun>": {"direction": beside,
                                                    "half_angle": half_angle}}},
        "plan": {"method": method, "goal": {"roll": 1.0}},
        "controllers": {"pd_feedforward": {"kp": [3.0], "kd": [8.0]}}, "active": "pd_feedforward",
    }  # fmt: skip
    return run_trial(trial_of_values(values, "cone.yaml"), "cone.yaml", folder, in_process=True)


def test_the_margin_is_measured_and_the_sky_is_drawn(tmp_path: Path) -> None:
    result = flown(tmp_path / "run", "time_optimal", 0.2)
    assert result.exit_code == 0
    assert result.metrics["keep_out_margin"]["<sun>"] == pytest.approx(0.1, abs=1e-3)
    page = (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    [drawn] = re.findall(r'<svg role="img" aria-label="sphere.*?</svg>', page)
    assert "&lt;sun&gt;" in drawn
    assert "<sun>" not in drawn
    assert "z axis" in drawn
    [(x0, y0, x1, y1)] = re.findall(DASHED, drawn)
    ends = 120.0 * projected(np.array([[0.0, 0.0, 1.0], [0.0, -np.sin(1.0), np.cos(1.0)]]))
    np.testing.assert_allclose(np.array([[x0, y0], [x1, y1]], dtype=float), ends, atol=0.1)


def test_a_flight_through_a_cone_is_a_failed_check(tmp_path: Path) -> None:
    with pytest.raises(PlanFailed, match="looks into keep_out"):
        flown(tmp_path / "plan", "time_optimal", 0.4)
    result = flown(tmp_path / "run", "none", 0.4)  # a step, whose reference jumps over it
    assert result.exit_code == CHECK_FAILED
    assert "looked into keep_out <sun> by" in result.message
    assert -0.4 < result.metrics["keep_out_margin"]["<sun>"] < -0.05


def test_the_projection_keeps_areas_and_the_sheet_holds_the_whole_sphere() -> None:
    rng = np.random.default_rng(1)
    looks = rng.standard_normal((40000, 3))
    x, y = projected(looks).T
    assert np.all((x / (2.0 * np.sqrt(2.0))) ** 2 + (y / np.sqrt(2.0)) ** 2 <= 1.0 + 1e-12)
    # uniform directions fill each quarter of the half axes' rectangle as its ellipse does
    inside = np.mean((abs(x) < np.sqrt(2.0)) & (abs(y) < 0.5 * np.sqrt(2.0)))
    assert inside == pytest.approx(1.0 / np.pi, abs=0.01)  # 4 a b / 4 of pi a b
    np.testing.assert_allclose(projected(np.eye(3)[[0]]), 0.0, atol=1e-15)


def test_the_console_shows_the_sky_of_a_craft_that_has_one(tmp_path: Path) -> None:
    link = FakeLink()
    page = Page(link, "127.0.0.1", 0, lambda words: None, layouts=tmp_path / "layouts.json")
    try:
        [panel] = [panel for panel in page._panels if isinstance(panel, SkyPanel)]
        sky = panel._sky_element
        page.refresh()
        assert not sky.visible
        testbed = link.view.testbed = read_testbed(CRAFT, "here")
        model = testbed.model()
        rows = np.array([model.rest({"roll": angle}) for angle in np.linspace(0.0, 1.0, 50)])
        link.view.truth.add(np.arange(50, dtype=float) * 0.1, {COORDINATES: rows})
        panel._next = 0.0
        page.refresh()
        assert "sphere of boresights" in sky.content
        assert sky.visible
    finally:
        page.close()
