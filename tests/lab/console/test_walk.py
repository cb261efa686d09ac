"""Every control of the page in Chromium, at four widths, with and without WebGL."""

from math import sin
from time import monotonic, sleep

import pytest
from tests.browser import PALE, Browser, chromium
from tests.console_walk import CONTROLS, SIZES, TABS, open_tab
from tests.fake_bench import FakeLink

from flexslew_lab.console.page import Page
from flexslew_plant.events import OperatorNote
from flexslew_plant.events.event import event_of

pytestmark = pytest.mark.browser

# what moves for longer than anybody sees
_MOVES = """
return [...document.querySelectorAll("*")].map(e => [e.className, getComputedStyle(e)])
  .filter(([, style]) => `${style.transitionDuration}, ${style.animationDuration}`.split(", ")
    .some(time => parseFloat(time) > 0.01)).map(([name]) => String(name));
"""
_BRAKE = """
const box = document.getElementById("brake").getBoundingClientRect();
return [box.left, box.top].map(Math.round);
"""
# fields and charts of the tabs that do not fill them
_NARROW = """
return [...document.querySelectorAll(".bench-right .bench-field, .bench-right .bench-chart")]
  .filter(e => e.checkVisibility())
  .filter(e => e.getBoundingClientRect().width < 0.85 * e.closest(".bench-right").clientWidth)
  .map(e => e.innerText || e.ariaLabel);
"""
# every time of the log stands in one line
_WHOLE = """
const times = [...document.querySelectorAll(".bench-table td:first-child")]
  .filter(e => e.innerText);
return times.length && times.every(e => {
  const range = document.createRange();
  range.selectNodeContents(e);
  return new Set([...range.getClientRects()].map(box => Math.round(box.top))).size === 1;
});
"""
_NO_PALE = f"return (() => {{ {PALE} }})().length === 0"  # once the colours have changed
_FITS = """
const boxes = [...document.querySelectorAll(".bench-grid .bench-chart svg")]
  .map(e => e.getBoundingClientRect());
return boxes.length === 4 && boxes.every(box => box.bottom <= innerHeight && box.width > 200);
"""


@pytest.mark.timeout(600)
@pytest.mark.parametrize("webgl", [True, False])
def test_every_control_can_be_reached_and_the_brake_stays_where_it_is(
    served: tuple[Page, FakeLink], webgl: bool
) -> None:
    page, link = served
    note = OperatorNote("the beams ring on after the slew " * 20, "ann, page 2")
    link.view.events.append(event_of(note, 123456, 1234.56, 0, "plant"))
    link.view.received += 1
    with chromium(*([] if webgl else ["--disable-3d-apis"])) as browser:
        for width, height in SIZES.items():
            browser.open(page.server.address, width, height)
            browser.until("return document.getElementById('bench-state')?.checkVisibility()")
            place = browser.run(_BRAKE)
            drawn = "canvas" if webgl else "svg[aria-label^=testbed]"
            browser.until(f"return document.querySelector('.bench-scene {drawn}') !== null")
            browser.until("return document.querySelectorAll('.bench-grid svg path').length > 4")
            if width >= 1024:
                assert browser.until(_FITS)
            browser.run("document.querySelectorAll('details').forEach(e => { e.open = true; })")
            for number, tab in enumerate(TABS):
                scheme = {"name": "prefers-color-scheme", "value": ("light", "dark")[number % 2]}
                browser.devtools("Emulation.setEmulatedMedia", {"features": [scheme]})
                open_tab(browser, tab)
                browser.until("return !document.querySelector('.q-tab-panel .q-transition')")
                controls = browser.run(CONTROLS)
                assert len(controls) > 10, (width, tab)
                wrong = [c["name"] for c in controls if not (c["inside"] and c["hit"])]
                assert not wrong, (width, tab, wrong)
                assert browser.run(_NARROW) == [], (width, tab)
                assert browser.until(_NO_PALE, within=20.0), (width, tab, browser.run(PALE))
                if tab == "Log":
                    assert browser.until(_WHOLE, within=20.0), width
                assert browser.run("return document.documentElement.scrollWidth") == width
                browser.run("scrollTo(0, document.body.scrollHeight)")
                assert browser.run(_BRAKE) == place, (width, tab)
            _works(browser, link)
            _chooses_curves(browser, page)
        assert not [c for c in browser.complaints() if "Refused" in c or "Error" in c]


# of the first chart
_TEXTS = (
    "return [...document.querySelector('.bench-grid svg').querySelectorAll('text')]"
    ".map(e => e.textContent)"
)


def test_the_page_is_read_aloud_in_its_language_and_a_row_chosen_without_a_mouse(
    served: tuple[Page, FakeLink],
) -> None:
    page, link = served

    def noted(words: str, tick: int) -> None:
        link.view.events.append(event_of(OperatorNote(words, "ann"), tick, tick * 0.01, 0, "plant"))
        link.view.received += 1

    noted("it rings", 1200)
    held = next(e for e in page.server.gui.all() if e.label == "Pause the view")
    with chromium() as browser:
        browser.open(page.server.address, 1440)
        browser.until("return document.getElementById('bench-state')?.checkVisibility()")
        assert browser.run("return document.documentElement.lang") == "en-US"
        assert browser.run("return document.querySelectorAll('main').length") == 1
        still = [{"name": "prefers-reduced-motion", "value": "reduce"}]
        assert browser.run(_MOVES)
        browser.devtools("Emulation.setEmulatedMedia", {"features": still})
        assert browser.run(_MOVES) == []
        open_tab(browser, "Log")
        row = "return document.querySelector('.bench-table tbody tr[tabindex]')"
        browser.until(f"{row} !== null")
        browser.run(f"{row.removeprefix('return ')}.focus()")
        noted("it rests", 1300)  # above it, while it has the focus
        rows = "[...document.querySelectorAll('.bench-table tbody tr')].map(e => e.innerText)"
        browser.until(f"return {rows}.some(text => text.includes('it rests'))")
        assert "it rings" in browser.run("return document.activeElement.innerText")
        assert not held.value
        browser.press("Enter", "Enter")
        ticked = "[role=checkbox][aria-label='Pause the view'][aria-checked=true]"
        browser.until("return document.querySelector(arguments[0]) !== null", ticked)


def test_a_chart_is_saved_as_a_table_and_as_a_picture(served: tuple[Page, FakeLink]) -> None:
    page, _ = served
    with chromium("--disable-3d-apis") as browser:
        browser.open(page.server.address, 1440)
        browser.until("return document.querySelectorAll('.bench-grid svg path').length > 4")
        browser.run(_CATCH)
        for number, kind in enumerate(("CSV", "PNG", "SVG"), 1):
            browser.click("(//button[normalize-space()='Save'])[1]")
            browser.click(f"//*[@role='menu']//*[normalize-space()='{kind}' and @tabindex]")
            browser.until("return saved.length === arguments[0]", number)
            browser.until("return !document.querySelector('[role=menu]')")
        found = browser.run(
            "return Promise.all(saved.map(async one => [one.type, await one.text()]))"
        )
        assert [kind for kind, _ in found] == ["text/csv", "image/png", "image/svg+xml"]
        head, *rows = found[0][1].splitlines()
        assert head == '"time [s]","a [rad]","b [m]","reference a [rad]","reference b [m]"'
        cells = [[float(cell or "nan") for cell in row.split(",")] for row in rows]
        known = [row for row in cells if row[1] == row[1]]
        assert len(known) > 100
        assert all(abs(row[1] - 2e-6 * sin(row[0])) < 1e-7 for row in known)  # as drawn
        assert found[2][1].startswith("<svg xmlns=")


def test_a_chart_is_dragged_onto_another(served: tuple[Page, FakeLink]) -> None:
    page, _ = served
    with chromium("--disable-3d-apis") as browser:
        browser.open(page.server.address, 1440)
        browser.until("return document.querySelectorAll('.bench-grid svg path').length > 4")
        browser.run(_DRAG)
        names = "return [...document.querySelectorAll('.bench-grid .q-field__native')]"
        order = f"{names}.map(e => e.innerText.trim()).join() === 'tips,error,effort,position'"
        browser.until(order)
        assert browser.complaints() == []


_DRAG = """
const dataTransfer = new DataTransfer(), more = {dataTransfer, bubbles: true, cancelable: true};
const tiles = document.querySelectorAll(".bench-grid .bench-folder");
tiles[0].querySelector("[draggable]").dispatchEvent(new DragEvent("dragstart", more));
tiles[3].dispatchEvent(new DragEvent("dragover", more));
tiles[3].dispatchEvent(new DragEvent("drop", more));
"""
_CATCH = """
window.saved = [];
const make = URL.createObjectURL;
URL.createObjectURL = blob => { saved.push(blob); return make.call(URL, blob); };
"""


def _works(browser: Browser, link: FakeLink) -> None:
    """Press what the bench is asked by, and look at what the page says then."""
    open_tab(browser, "Faults")
    for button, place, asked in (
        ("Step", "header", "step"),
        ("Switch to lqr", ".bench-left", "switch_controller"),
        ("Disturb", ".q-tab-panel", "inject_fault"),
    ):
        number = len(link.request) + 1
        browser.run("scrollTo(0, 0)")  # from below the header
        browser.click(f"//button[normalize-space()='{button}']")
        _says(browser, place, number)
        assert link.request[-1][0] == asked
    for key, code, action in ((" ", "Space", "brake"), ("p", "KeyP", "pause")):
        number = len(link.request) + 1
        browser.press(key, code)
        _asked(link, number)
        assert link.request[-1][1]["action"] == action
    browser.press("r", "KeyR")
    browser.click("//*[contains(@class, 'q-dialog')]//button[normalize-space()='Reset now']")
    _asked(link, number + 1)
    assert link.request[-1][1]["action"] == "reset"
    browser.until("return !document.querySelector('.q-dialog')")
    browser.press("?", "Slash")
    keys = "return document.querySelector('.q-dialog')?.innerText.includes('switch to the first')"
    browser.until(keys)
    assert browser.run(PALE) == []
    browser.click("//*[contains(@class, 'q-dialog')]//button[normalize-space()='Close']")
    browser.until("return !document.querySelector('.q-dialog')")
    ticks = browser.run(_TEXTS)
    assert any("e-6" in tick for tick in ticks)  # not "0, 0, -0"
    assert "40" in ticks or "39.99" in ticks or "35" in ticks


def _chooses_curves(browser: Browser, page: Page) -> None:
    """Show other curves in the first chart, as at the start of a flight, and those from before."""
    choice = next(e for e in page.server.gui.all() if e.label == "Chart")
    for quantity, small in (("velocity", False), ("position", True)):
        choice.value = quantity
        browser.until(f"{_TEXTS}.some(text => text.includes('e-6')) === arguments[0]", small)


def _asked(link: FakeLink, number: int) -> None:
    end = monotonic() + 60.0
    while len(link.request) < number:
        assert monotonic() < end, link.request[-1]
        sleep(0.02)


def _says(browser: Browser, place: str, number: int) -> None:
    words = "return document.querySelector(arguments[0]).innerText.includes(arguments[1])"
    browser.until(words, place, f"answer {number}.")
