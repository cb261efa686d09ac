"""A whole session at the bench in a real browser, and its log flown again.

It takes a browser that draws in software minutes on a busy machine:
`FLEXSLEW_BROWSER=1 ./flexslew test tests/ros/test_console.py`.
"""

import os
from pathlib import Path

import pytest

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.replay.resim import resim
from tests.browser import chromium

from .console_page import Page, console, trial_file

pytest.importorskip("viser")
pytestmark = [
    pytest.mark.timeout(1200),
    pytest.mark.skipif("FLEXSLEW_BROWSER" not in os.environ, reason="set FLEXSLEW_BROWSER=1"),
]


def test_a_session_worked_by_hand_flies_again_with_the_same_bits(tmp_path: Path) -> None:
    run = tmp_path / "run"
    with (
        console(str(trial_file(tmp_path, 200.0)), "--out", str(run), "--rate", "0.1") as (
            _,
            address,
        ),
        chromium() as browser,
    ):
        browser.open(address, 1300, 1000, scale=0.25)
        page = Page(browser)
        page.state("paused")
        page.click("Step")
        page.says("100 ticks from tick 0 on")
        page.state("tick\t100 ")
        page.write("Ticks", "-3")
        page.click("Step")
        page.says("Ticks: -3 is not allowed")
        page.click("Start")
        page.state("running")
        page.tab("Swap")
        page.choose("Controller", "lqr")
        page.click("Switch")
        page.says("pd_feedforward -> lqr, effort step")
        page.state("in charge\tlqr")
        page.click("Switch")
        page.says("refused: lqr is already in charge")
        browser.press(" ", "Space")
        page.state("LATCHED")
        page.click("Release the brake")
        page.state("nobody is in charge")
        page.choose("Controller", "pd_feedforward")
        page.click("Switch")
        page.state("in charge\tpd_feedforward")
        tune(page)
        disturb(page)
        fast(page)
        page.state("finished")
        assert not [c for c in browser.complaints() if "Refused" in c]
    kinds = ["step", "started", "resumed", "switch_requested", "brake_requested"]
    kinds += ["brake_requested", "switch_requested", "tuned", "injected", "fault_ended", "rate"]
    assert asked(run) == kinds
    assert resim(run / "bag").identical


def test_a_plan_is_made_and_flown_and_the_end_shows_what_is_left(tmp_path: Path) -> None:
    run = tmp_path / "run"
    with (
        console(str(trial_file(tmp_path, 30.0)), "--out", str(run)) as (_, address),
        chromium() as browser,
    ):
        browser.open(address, 1300, 1000, scale=0.25)
        page = Page(browser)
        page.state("paused")
        page.click("Step")
        page.state("tick\t100 ")
        plan(page)
        note(page)
        fast(page)
        page.click("Start")
        page.state("finished")
        page.tab("End")
        page.says("Open the report")  # all is written
        page.write("Earlier run", str(run))
        page.click("Overlay it")
        page.says("largest difference: position 0")
        page.click("Open the report")
        browser.until("return document.querySelector('iframe')?.contentDocument?.body?.innerText")
        assert not [c for c in browser.complaints() if "Refused" in c]
    assert asked(run) == ["step", "started", "planned", "note", "rate", "resumed"]
    assert resim(run / "bag").identical


def asked(run: Path) -> list[str]:
    """Return what pages have asked for, from the log."""
    events = BagReader(run / "bag").overview.events
    return [e.kind for e in events if ", page " in str(e.data.get("who", ""))]


def fast(page: Page) -> None:
    page.tab("Run")
    page.choose("Rate", "fast")
    page.click("Set the rate")


def tune(page: Page) -> None:
    page.tab("Tune")
    page.choose("Tuned controller", "pd_feedforward")
    page.write("kp", "[-1.0, 460.0]")
    page.click("Tune")
    page.says("kp.0: -1.0 is not allowed")
    page.write("kp", "[500.0, 500.0]")
    page.click("Tune")
    page.says("kp: [500.0, 500.0] from tick")


def disturb(page: Page) -> None:
    page.tab("Break")
    page.write("constant effort", "much")
    page.click("Disturb")
    page.says("constant effort: 'much' is not allowed: give a number")
    page.write("constant effort", "2.0")
    page.click("Disturb")
    page.browser.until(
        "return [...document.querySelectorAll('input')].some(e => e.value.startsWith('0: '))"
    )
    page.click("End it")
    page.says("ends at tick")


def plan(page: Page) -> None:
    page.tab("Plan")
    page.choose("Method", "reference_only")
    page.write("goal of hub_pitch", "0.2")
    page.write("start", "0.5")
    page.click("Plan and fly it from its start on")
    page.says("start: 0.5 is over")
    page.write("start", "20.0")
    page.write("duration", "5.0")
    page.click("Plan and fly it from its start on")
    page.says("reference_only: 5 s from 20 s on is published")
    page.says("planned hub_pitch")


def note(page: Page) -> None:
    page.tab("Log")
    page.write("Remark", "the beams ring")
    page.click("Note it")
    page.says("the beams ring")
