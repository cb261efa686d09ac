"""A page that draws more slowly than the bench flies: it falls behind by one picture, no more."""

from time import monotonic, sleep

import numpy as np
import pytest
from tests.browser import chromium
from tests.fake_bench import FakeLink

from flexslew_lab.console.drawing import _HIDDEN_TIMEOUT
from flexslew_lab.console.page import Page

pytestmark = pytest.mark.browser

_THERE = "return document.querySelectorAll('.bench-grid svg path').length > 4"
# what is drawn waits until it is let go; what comes for charts is counted
_HOLD = """
window.pictures = 0;
socket.onAny((event, what) => { pictures += what?.code?.includes("run_chart_method") || 0; });
window.held = [];
window.drawing = requestAnimationFrame;
window.requestAnimationFrame = then => held.push(then);
"""
_LET_GO = """
window.requestAnimationFrame = drawing;
held.forEach(then => requestAnimationFrame(then));
"""
_LATER = """
const texts = [...document.querySelectorAll(".bench-grid svg text")].map(e => e.textContent);
return texts.some(text => Number(text) >= arguments[0]);
"""
CHARTS = 4


@pytest.mark.timeout(600)
def test_charts_wait_for_a_page_that_draws_slowly(served: tuple[Page, FakeLink]) -> None:
    page, link = served

    def fly(now: float) -> None:
        view, time = link.view, link.view.time + 0.05
        view.truth.add(np.array([time]), {"position": np.full((1, 2), 2e-6)})
        view.time = time

    with chromium("--disable-3d-apis") as browser:
        browser.open(page.server.address, 1024, 768)
        browser.until(_THERE)
        link.poll = fly  # type: ignore[method-assign]
        browser.until(_LATER, 45.0)  # it is connected
        browser.run(_HOLD)
        began, flown = monotonic(), link.view.time + 4.0
        while link.view.time < flown:
            sleep(0.1)
        asleep = (monotonic() - began) / _HIDDEN_TIMEOUT  # on a machine that is busy for so long
        # one on its way, one that is not drawn
        assert browser.run("return pictures") <= CHARTS * (2 + asleep)
        browser.run(_LET_GO)
        browser.until(_LATER, flown - 10.0)
        browser.until("return pictures > arguments[0]", 6 * CHARTS, within=60.0)
