"""The page over a log in a real browser: the slider moves all of it, and nothing can be asked."""

import os
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.browser import Browser, chromium

from flexslew_lab.console.page import Page
from flexslew_lab.console.replay import Replay
from flexslew_lab.trial.run import run_trial
from flexslew_lab.trial.sources import read_trial

PICTURE = "FLEXSLEW_PICTURE"  # environment variable: where the picture of the README goes


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("replay") / "run"
    trial, source = read_trial("swap_demo")
    run_trial(trial, source, folder, in_process=True, report=False)
    return folder


@pytest.fixture
def page(run: Path) -> Iterator[Page]:
    """Yield a page that is served from a thread."""
    log = Replay(run / "bag")
    found, over = Page(log, "127.0.0.1", 0, lambda words: None, log), threading.Event()

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
        time = "//label[normalize-space()='Time [s]']"
        browser.write(f"{time}/following::input[not(@type='hidden')][1]", "60")
        browser.press("Enter", "Enter")
        browser.until(state, "60.00 s")
        browser.until(state, "proportional_integral")
        browser.click("//*[@role='tab' and normalize-space()='Log']")
        click(browser, "12.50 s pd_feedforward -> output_feedback, e...")
        browser.until(shown, "effort step")
        assert not browser.run(shown, "Brake (space bar)")
        if PICTURE in os.environ:
            browser.click("//*[contains(@class, 'Notification-closeButton')]")
            browser.until("return !document.querySelector('.mantine-Notification-root')")
            browser.picture(Path(os.environ[PICTURE]), whole=False)
        click(browser, "Play")
        browser.until(state, "replaying")


def test_the_page_draws_what_has_come_and_more_only_for_a_hand_on_it(page: Page) -> None:
    state = "return document.getElementById('bench-state')?.innerText.includes(arguments[0])"
    # how long the page waits after a frame before it asks the screen for the next [ms]; how many
    # frames come of it is the machine's
    pauses = """
    const [seconds, moves] = arguments, wait = window.setTimeout, pauses = [];
    window.setTimeout = (then, pause, ...more) => {
      if (String(then).includes("screenFrame")) pauses.push(pause);
      return wait(then, pause, ...more);
    };
    const move = () => dispatchEvent(new PointerEvent("pointermove"));
    move();
    const hand = moves ? setInterval(move, 100) : 0;
    return new Promise(then => wait(() => {
      window.setTimeout = wait;
      clearInterval(hand);
      then(pauses);
    }, 1000 * seconds));
    """
    with chromium() as browser:
        browser.open(page.server.address, 1400, 950)
        browser.until(state, "paused")
        click(browser, "Play")  # a slew begins
        browser.until(state, "replaying")
        browser.until("return !document.getElementById('bench-state').innerText.includes(' 0.')")
        alone = browser.run(pauses, 5.0, False)
        assert len(alone) > 10
        assert any(pause > 50.0 for pause in alone)
        held = browser.run(pauses, 5.0, True)
        # a timer that comes late finds the last move more than half a second old
        assert sum(pause <= 0.0 for pause in held) > 0.9 * len(held) > 10
