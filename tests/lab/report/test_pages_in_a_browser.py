"""Pages as a person sees them: looked at in Chromium, on a phone, a tablet and a screen."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.browser import PALE, Browser, chromium, looked_at
from tests.plants import plant

from flexslew_control.planners import make_plan, plan_settings
from flexslew_lab.report.report import write_plan, write_report
from flexslew_lab.report.sections import Table, page_of_sections
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import parse_trial

pytestmark = pytest.mark.browser

TRIAL = """
name: a_trial_with_a_long_name
duration: 6.0
testbed: {modes: 3}
plan: {method: reference_only, goal: {base_yaw: 0.05, hub_pitch: 0.02}, duration: 4.0}
controllers: {pd_feedforward: {}, output_feedback: {}}
allow_faults: true
schedule:
  - {at: 1.0, until: 2.0, fault: {kind: sensor_bias, channel: joint_velocity, bias: 0.001}}
  - at: 1.1
    until: 5.0
    disturbance: {base_yaw: 5.0, hub_pitch: {sine: {amplitude: 3.0, frequency: 0.5}}}
  - {at: 1.2, switch: output_feedback}
  - {at: 4.0, fault: {kind: command_lost, probability: 0.02}}
"""
ROWS = [("hash", "ab" * 32), ("peak_effort", "77.9, 37.8")]
PAGES = ("one", "compared", "several", "plan")


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as found:
        yield found


def test_a_browser_without_javascript_says_why_there_are_no_figures(
    browser: Browser, pages: dict[str, Path]
) -> None:
    browser.devtools("Emulation.setScriptExecutionDisabled", {"value": True})
    try:
        browser.show(pages["one"])
        tree = browser.devtools("Accessibility.getFullAXTree", {})["nodes"]
    finally:
        browser.devtools("Emulation.setScriptExecutionDisabled", {"value": False})
    said = [node["name"]["value"] for node in tree if "name" in node]
    assert any("JavaScript is off here" in words for words in said)
    assert "Metrics" in said


def test_a_table_of_many_columns_is_printed_whole(browser: Browser, tmp_path: Path) -> None:
    names = [f"seen by tip.beam_{k}" for k in range(17)]
    table = Table("Modes", "", names, [["-0.013"] * len(names)] * 3)
    page = tmp_path / "page.html"
    page.write_text(page_of_sections("analysis", "wide", "", [table]))
    browser.open(page, 760)
    browser.devtools("Emulation.setEmulatedMedia", {"media": "print"})
    clipped = browser.run(
        "return [...document.querySelectorAll('.scroll')].filter("
        "e => e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).overflowX !== 'visible')"
    )
    right = browser.run("return document.querySelector('table').getBoundingClientRect().right")
    browser.devtools("Emulation.setEmulatedMedia", {"media": ""})
    assert clipped == []
    assert right <= 1.3 * 760  # as far as a browser shrinks a page to the paper


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory, bag: Path) -> dict[str, Path]:
    """Return every kind of page, by name."""
    folder = tmp_path_factory.mktemp("pages")
    trial = parse_trial(TRIAL, "t.yaml")
    run = run_trial(trial, "t.yaml", folder / "run", in_process=True, report=False).folder / "bag"
    settings = plan_settings({"method": "reference_only"}, "t.yaml")
    plan = make_plan(settings, plant())
    return {
        "one": write_report([run], folder / "one.html"),
        "compared": write_report([bag], folder / "compared.html", comparison=run),
        "several": write_report([run, bag, run], folder / "several.html"),
        "plan": write_plan(plan, ("rad", "rad"), (150.0, 150.0), ROWS, folder / "plan.html"),
    }


@pytest.mark.parametrize("width", [360, 820, 1440])
@pytest.mark.parametrize("name", PAGES)
def test_text_neither_collides_nor_leaves_the_page_nor_breaks_inside_words(
    browser: Browser, pages: dict[str, Path], name: str, width: int
) -> None:
    browser.open(pages[name], width)
    seen = looked_at(browser)
    assert seen["boxes"] > 50
    assert seen["overlaps"] == []
    assert seen["outside"] == []
    assert seen["broken"] == []
    assert seen["scroll"] <= 0
    assert browser.complaints() == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_text_stands_out_from_its_ground(
    browser: Browser, pages: dict[str, Path], scheme: str
) -> None:
    asked = [{"name": "prefers-color-scheme", "value": scheme}]
    browser.devtools("Emulation.setEmulatedMedia", {"features": asked})
    try:
        browser.open(pages["one"], 820)
        assert browser.run(PALE) == []
    finally:
        browser.devtools("Emulation.setEmulatedMedia", {"features": []})


def test_the_look_at_a_page_finds_what_it_looks_for(browser: Browser, tmp_path: Path) -> None:
    page = tmp_path / "bad.html"
    page.write_text(
        "<body style='margin: 0'><p style='position: absolute; top: 0; left: 0'>one over</p>"
        "<p style='position: absolute; top: 4px; left: 10px'>another</p>"
        "<p style='position: absolute; top: 90px; left: 95vw; white-space: nowrap'>too far out</p>"
        "<p style='margin-top: 200px; width: 30px; word-break: break-all'>unbreakable</p>"
        "<script>missing()</script>"
    )
    browser.open(page, 820)
    seen = looked_at(browser)
    assert seen["overlaps"] == ["one over | another"]
    assert seen["outside"] == ["too far out"]
    assert seen["broken"] == ["unbreakable"]
    assert len(browser.complaints()) == 1


def test_every_panel_is_drawn_and_a_click_hides_a_curve(
    browser: Browser, pages: dict[str, Path]
) -> None:
    browser.open(pages["several"], 1440)
    plots = browser.run("return document.querySelectorAll('.plot').length")
    drawn = browser.run("return document.querySelectorAll('.plot svg.main-svg').length")
    assert plots > 20
    assert drawn >= plots
    lines = "return document.querySelectorAll('#the-manoeuvre-0 .scatterlayer .trace').length"
    before = browser.run(lines)
    browser.run("document.querySelector('.legend button').click()")
    assert browser.run(lines) == before - 1
    browser.run("return Plotly.relayout('modes-0', {'xaxis.range': [1, 2]})")
    others = "return document.getElementById('modes-1').layout.xaxis.range"
    assert browser.run(others) == [1, 2]
