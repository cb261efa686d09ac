"""Every control of the page in Chromium, at three widths, with and without WebGL."""

import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.browser import Browser, chromium
from tests.fake_bench import FakeLink

from flexslew_lab.console.link import RequestResult, Then
from flexslew_lab.console.page import Page
from flexslew_plant.testbeds.csa import CsaTestbed

SIZES = {1440: 900, 1024: 768, 390: 844}
TABS = ("Run", "Swap", "Tune", "Plan", "Break", "Log", "View", "End")
# what stands on the page that a person can press, write into or choose from
_CONTROLS = """
const seen = e => e.checkVisibility() && e.getBoundingClientRect().width > 0;
const of = "button, input, textarea, [role=checkbox], [role=slider], [role=tab], a[href]";
return [...document.querySelectorAll(of)].filter(seen).map(e => {
  e.scrollIntoView({block: "center"});
  const box = e.getBoundingClientRect();
  const x = (box.left + box.right) / 2, y = (box.top + box.bottom) / 2;
  const hit = document.elementFromPoint(x, y);
  return {
    name: e.ariaLabel || e.innerText || e.type,
    inside: box.left >= -1 && box.right <= innerWidth + 1,
    hit: !!hit && (e.contains(hit) || hit.contains(e) || !!e.closest("label")?.contains(hit)),
  };
});
"""
_BRAKE = """
const box = document.getElementById("brake").getBoundingClientRect();
return [box.left, box.top].map(Math.round);
"""
_FITS = """
const boxes = [...document.querySelectorAll(".bench-grid .bench-chart svg")]
  .map(e => e.getBoundingClientRect());
return boxes.length === 4 && boxes.every(box => box.bottom <= innerHeight && box.width > 250);
"""


class CountingLink(FakeLink):
    """Answers each request with its number."""

    def ask(self, service: str, values: Mapping[str, Any], then: Then) -> None:
        self.asked.append((service, dict(values)))
        then(RequestResult(True, f"answer {len(self.asked)}."))


@pytest.fixture
def served(tmp_path: Path) -> Iterator[tuple[Page, FakeLink]]:
    """Yield a page over a bench that has flown a little, and is served from a thread."""
    link, over = CountingLink(), threading.Event()
    view, time = link.view, np.arange(4000) * 0.01
    rows = 2e-6 * np.column_stack((np.sin(time), np.cos(time)))
    view.truth.add(time, {"position": rows})
    view.controller_state.add(time, {"reference_position": rows})
    view.testbed = CsaTestbed()
    view.time, view.now = 39.99, view.now._replace(state="running", active="pd", rate_factor=1.0)
    page = Page(link, "127.0.0.1", 0, print, layouts=tmp_path / "layouts.json")
    drawing = next(e for e in page.server.gui.all() if e.label == "Drawing")
    drawing.value = "three dimensions"  # by the processor, too

    def work() -> None:
        while not over.wait(page.poll()):
            pass

    thread = threading.Thread(target=work)
    thread.start()
    yield page, link
    over.set()
    thread.join()
    page.close()


@pytest.mark.timeout(600)
@pytest.mark.parametrize("webgl", [True, False])
def test_every_control_can_be_reached_and_the_brake_stays_where_it_is(
    served: tuple[Page, FakeLink], webgl: bool
) -> None:
    page, link = served
    with chromium(*([] if webgl else ["--disable-3d-apis"])) as browser:
        for width, height in SIZES.items():
            browser.open(page.server.address, width, height)
            browser.until("return document.getElementById('bench-state')?.checkVisibility()")
            place = browser.run(_BRAKE)
            drawn = "canvas" if webgl else "svg[aria-label^=testbed]"
            browser.until(f"return document.querySelector('.bench-scene {drawn}') !== null")
            browser.until("return document.querySelectorAll('.bench-grid svg path').length > 4")
            if width == 1440:
                assert browser.until(_FITS)
            for tab in TABS:
                _tab(browser, tab)
                browser.until("return !document.querySelector('.q-tab-panel .q-transition')")
                controls = browser.run(_CONTROLS)
                assert len(controls) > 10, (width, tab)
                wrong = [c["name"] for c in controls if not (c["inside"] and c["hit"])]
                assert not wrong, (width, tab, wrong)
                assert browser.run("return document.documentElement.scrollWidth <= innerWidth")
                browser.run("scrollTo(0, document.body.scrollHeight)")
                assert browser.run(_BRAKE) == place, (width, tab)
            _works(browser, link)
        assert not [c for c in browser.complaints() if "Refused" in c or "Error" in c]


def _works(browser: Browser, link: FakeLink) -> None:
    """Press what the bench is asked by, and look at what the page says then."""
    for tab, button, asked in (
        ("Run", "Start", "operate"),
        ("Run", "Set the rate", "set_rate"),
        ("Swap", "Switch", "switch_controller"),
        ("Break", "Disturb", "inject_fault"),
    ):
        _tab(browser, tab)
        number = len(link.asked) + 1
        browser.click(f"//button[normalize-space()='{button}']")
        _says(browser, ".q-tab-panel", number)
        assert link.asked[-1][0] == asked
    number = len(link.asked) + 1
    browser.press(" ", "Space")
    _says(browser, "header", number)
    assert link.asked[-1][1]["action"] == "brake"
    ticks = browser.run(
        "return [...document.querySelectorAll('.bench-grid svg text')].map(e => e.textContent)"
    )
    assert any("e-6" in tick for tick in ticks)  # not "0, 0, -0"
    assert "40" in ticks or "39.99" in ticks or "35" in ticks


def _says(browser: Browser, place: str, number: int) -> None:
    words = "return document.querySelector(arguments[0]).innerText.includes(arguments[1])"
    browser.until(words, place, f"answer {number}.")


def _tab(browser: Browser, name: str) -> None:
    browser.run("scrollTo(0, 0)")  # from below the header, as a person would
    browser.click(f"//*[@role='tab' and normalize-space()='{name}']")
    browser.until(
        "return [...document.querySelectorAll('[role=tab]')]"
        ".some(e => e.innerText.trim() === arguments[0] && e.ariaSelected === 'true')",
        name,
    )
