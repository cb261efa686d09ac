"""The page over a log in a real browser: the slider moves all of it, and nothing can be asked."""

import os
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.browser import Browser, chromium

from flexslew_lab.console.page import Page
from flexslew_lab.console.replay import Replay
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.sources import read_trial

pytestmark = pytest.mark.browser

PAUSED = (
    "return document.querySelector('[role=checkbox][aria-label=\"Pause the view\"]')"
    "?.ariaChecked === 'true'"
)
# all charts show the 15 s before and after the first swap, at 12.5 s
JUMPED = (
    "return [...document.querySelectorAll('.bench-grid svg')].every(chart =>"
    " [...chart.querySelectorAll('text')].some(e => e.textContent === '27.5'))"
)
PICTURE = "FLEXSLEW_PICTURE"  # environment variable: where the picture of the README goes


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("replay") / "run"
    trial, source = read_trial("swap_demo")
    run_trial(trial, source, folder, in_process=True, report=False)
    return folder


@pytest.fixture
def page(run: Path, tmp_path: Path) -> Iterator[Page]:
    """Yield a page that is served from a thread."""
    log = Replay(run / "bag")
    found = Page(log, "127.0.0.1", 0, lambda words: None, log, tmp_path / "layouts.json")
    over = threading.Event()

    def work() -> None:
        while not over.wait(found.poll()):
            pass

    thread = threading.Thread(target=work)
    thread.start()
    yield found
    over.set()
    thread.join()
    found.close()


def click(browser: Browser, name: str) -> None:
    browser.click(f"//button[normalize-space()='{name}']")


def test_a_log_is_moved_through_and_its_events_move_the_charts(page: Page, run: Path) -> None:
    state = "return document.getElementById('bench-state')?.innerText.includes(arguments[0])"
    shown = "return document.body.innerText.includes(arguments[0])"
    with chromium() as browser:
        browser.open(page.server.address, 1400, 950)
        browser.until(state, "paused")
        browser.write("//input[@aria-label='Go to [s]']", "60")
        browser.until(state, "60.00 s")
        browser.until(state, "proportional_integral")
        browser.click("//*[@role='tab' and normalize-space()='Log']")
        browser.click("//tr[contains(., 'pd_feedforward -> output_feedback, effort step')]/td[2]")
        browser.until(PAUSED)
        browser.until(JUMPED)
        assert not browser.run(shown, "Brake (space bar)")
        if PICTURE in os.environ:
            browser.picture(Path(os.environ[PICTURE]), whole=False)
        click(browser, "Play")
        browser.until(state, "replaying")
