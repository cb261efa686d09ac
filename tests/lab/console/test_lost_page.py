"""A page whose console has ended, or was started anew, says so and what to do."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from tests.browser import chromium
from tests.fake_bench import FakeLink

from flexslew_lab.console.page import Page

pytestmark = pytest.mark.browser

_SAYS = "return document.getElementById('popup').innerText.includes(arguments[0])"


@contextmanager
def _console(folder: Path, port: int = 0) -> Iterator[Page]:
    over = threading.Event()
    page = Page(FakeLink(), "127.0.0.1", port, print, layouts=folder / "layouts.json")

    def work() -> None:
        while not over.wait(page.poll()):
            pass

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield page
    finally:
        over.set()
        thread.join()
        page.close()


@pytest.mark.timeout(300)
def test_a_page_whose_console_has_ended_says_what_to_do(tmp_path: Path) -> None:
    with chromium("--disable-3d-apis") as browser:
        with _console(tmp_path) as page:
            port = page.server.port
            browser.open(page.server.address, 1024, 768)
            browser.until("return document.getElementById('bench-state') !== null")
        browser.until(_SAYS, "the console has ended", within=60.0)
        with _console(tmp_path, port):
            browser.until(_SAYS, "Another console answers here now", within=60.0)
