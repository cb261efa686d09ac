"""A whole session at the bench in a real browser, and its log flown again."""

from pathlib import Path

import pytest

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.replay.resim import resim
from tests.browser import chromium

from .console_page import Page, console, trial_file

pytest.importorskip("viser")


@pytest.mark.timeout(1200)
def test_a_session_worked_by_hand_flies_again_with_the_same_bits(tmp_path: Path) -> None:
    run = tmp_path / "run"
    with (
        console(str(trial_file(tmp_path, 60.0)), "--out", str(run), "--rate", "0.1") as (
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
        page.tab("Run")
        page.choose("Rate", "fast")
        page.click("Set the rate")
        page.state("finished")
        assert not [c for c in browser.complaints() if "Refused" in c or "SEVERE" in c]
    events = BagReader(run / "bag").overview.events
    asked = [e for e in events if "page" in str(e.data.get("who", ""))]
    kinds = ["step", "started", "switch_requested", "brake_requested", "brake_requested"]
    kinds += ["switch_requested", "rate"]
    assert [e.kind for e in asked] == kinds
    assert all(", page 0" in e.data["who"] for e in asked)
    assert resim(run / "bag").identical
