"""A session at the bench in a real browser: every row of the page, and its log flown again.

A browser that draws in software takes all of the machine: no other test runs beside it.
"""

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.replay.resim import resim
from tests.browser import FOUND, chromium

from .console_page import Page, console, trial_file


@pytest.mark.browser
@pytest.mark.alone
@pytest.mark.timeout(1200)
def test_a_session_worked_by_hand_flies_again_with_the_same_bits(tmp_path: Path) -> None:
    run = tmp_path / "run"
    trial = trial_file(tmp_path, 30.0)
    trial.write_text(trial.read_text().replace("lqr: {}", "lqr: {}, linear: {}"))
    law = tmp_path / "law.npz"
    np.savez(law, D=[[400.0, 0.0, 900.0, 0.0], [0.0, 400.0, 0.0, 900.0]])
    bench = console(str(trial), "--out", str(run), "--rate", "0.1")
    with chromium() as browser, bench as (_, address):
        browser.open(address, 1300, 1000, scale=0.25)
        page = Page(browser)
        page.state("paused")
        for work in (step, swap, brake, tune, partial(load, law), disturb, plan):
            work(page)
        for work in (analyse, note, look, fly):
            work(page)
        another_page(page, address)
        end(page, run)
        assert not [c for c in browser.complaints() if "Refused" in c]
    assert asked(run) == [
        "step", "started", "resumed", "switch_requested", "brake_requested", "brake_requested",
        "switch_requested", "tuned", "tuned", "injected", "fault_ended", "plan_drafted",
        "plan_refused", "plan_drafted", "planned", "note", "rate",
    ]  # fmt: skip
    assert resim(run / "bag").identical


_STATE = "return document.getElementById('bench-state').innerText"

_SHOWN, _CHECKED = f"return {FOUND}?.checkVisibility()", f"return {FOUND}?.ariaChecked === 'true'"


def asked(run: Path) -> list[str]:
    """Return what pages have asked for, from the log."""
    events = BagReader(run / "bag").overview.events
    return [e.kind for e in events if ", page " in str(e.data.get("who", ""))]


def step(page: Page) -> None:
    page.write("Ticks", "10")
    page.click("Step")
    page.state("tick 10 ")
    page.write("Ticks", "-3")
    page.click("Step")
    page.says("Ticks: -3 is not allowed")
    page.click("Start")
    page.state("running")


def swap(page: Page) -> None:
    page.click("Switch to lqr")
    page.says("pd_feedforward -> lqr, effort step")
    page.state("lqr")


def brake(page: Page) -> None:
    page.browser.press(" ", "Space")
    page.says("The brake is latched: ticks pass under the brake")
    page.click("Release the brake")
    page.says("No controller is active; choose one:")
    page.click("pd_feedforward")
    page.state("pd_feedforward")


def tune(page: Page) -> None:
    page.click("Tune pd_feedforward")
    page.write("kp", "[-1.0, 460.0]")
    page.click("Apply the gains")
    page.says("kp.0: -1.0 is not allowed")
    page.write("kp", "[500.0, 500.0]")
    page.click("Apply the gains")
    page.says("kp: [500.0, 500.0] from tick")


def load(law: Path, page: Page) -> None:
    page.click("Tune linear")
    page.write("file", str(law.with_name("nowhere.npz")))
    page.click("Apply the gains")
    page.says("nowhere.npz: cannot be read")
    page.write("file", str(law))
    page.click("Apply the gains")
    page.says("[400.0, 0.0, 900.0, 0.0]")
    page.says("from tick")


def disturb(page: Page) -> None:
    page.tab("Faults")
    page.write("constant effort", "much")
    page.click("Disturb")
    page.says("constant effort: 'much' is not allowed: give a number")
    page.write("constant effort", "2.0")
    page.click("Disturb")
    page.browser.until("return document.body.innerText.includes('0: ')")
    page.click("End 0")
    page.says("ends at tick")


def plan(page: Page) -> None:
    page.tab("Plan")
    page.choose("Method", "reference_only")
    page.write("goal of hub_pitch", "0.2")
    page.write("start", "0.5")
    page.write("duration", "5.0")
    page.click("Plan")
    page.says("start: 0.5 is past")
    page.write("start", "20.0")
    for decision, answer in (
        ("Refuse the draft", "reference_only from 20 s on is dropped"),
        ("Adopt the draft", "reference_only: flown from 20 s on, tick 2000"),
    ):
        page.click("Plan")
        page.says("reference_only: 5 s from 20 s on is drafted")
        page.says("draft, not flown: reference_only, from 20 s on")
        page.says("planned hub_pitch")
        page.click(decision)
        page.says(answer)
    page.says("plan: reference_only, from 20 s on")


def analyse(page: Page) -> None:
    page.tab("Analysis")
    page.choose("Analysed controller", "linear")
    page.click("Analyse")
    page.says("disk margin, input")
    page.browser.until(
        "return fetch(document.querySelector('a[href$=\"analysis.html\"]').href)"
        ".then(answer => answer.ok && answer.text()).then(text => text.includes('Nichols'))"
    )


def note(page: Page) -> None:
    page.tab("Log")
    page.write("Remark", "the beams ring")
    page.click("Note it")
    page.says("noted at tick")
    page.write("Filter", "ring")
    page.browser.until(_SHOWN, "//tr[contains(., 'the beams ring')]")


def look(page: Page) -> None:
    """Charts and the view from above; none of it is asked of the bench."""
    page.browser.click("//tr[contains(., 'the beams ring')]/td[2]")
    page.browser.until(_CHECKED, "//*[@role='checkbox' and @aria-label='Pause the view']")
    page.choose("Window", "10 s")
    page.choose("Chart", "estimate minus truth")
    page.click("Clear the charts")
    page.browser.click("//summary[.='Drawing and layouts']")
    page.click("View from above")


def fly(page: Page) -> None:
    page.choose("Rate", "fast")
    page.state("finished")
    page.state("30.00 s")  # the last ticks come after the word


def another_page(page: Page, address: str) -> None:
    """Open a second page, and close it; it says what the first one says."""
    said = page.browser.run(_STATE)
    with page.browser.another_window():
        page.browser.open(address, 1300, 1000, scale=0.25)
        page.state("finished")
        assert page.browser.run(_STATE) == said


def end(page: Page, run: Path) -> None:
    page.tab("End")
    page.says("Open the report")  # all is written
    page.write("Earlier run", str(run))
    page.click("Overlay it")
    page.says("largest difference: position 0")
    page.browser.until(
        "return fetch(document.querySelector('a[href$=\"report.html\"]').href)"
        ".then(answer => answer.ok && answer.text()).then(text => text && text.includes('<html'))"
    )
