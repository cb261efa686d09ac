"""A walk that works every control of the page in Chromium: the console hears of each."""

import threading
from collections.abc import Callable
from time import monotonic

import pytest
from tests.browser import FOUND, Browser, chromium
from tests.console_walk import CONTROLS, SIZES, TABS, open_tab
from tests.fake_bench import FakeLink

from flexslew_lab.console.gui import Element
from flexslew_lab.console.page import Page
from flexslew_plant.events import OperatorNote
from flexslew_plant.events.event import event_of


@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("width", "webgl"),
    [
        pytest.param(1440, True, marks=pytest.mark.browser),
        (390, False),  # the one walk of every run of the tests
    ],
)
def test_every_control_does_what_it_is_for(
    served: tuple[Page, FakeLink], width: int, webgl: bool
) -> None:
    page, link = served
    link.view.events.append(event_of(OperatorNote("the beams ring", "ann"), 100, 1.0, 0, "plant"))
    link.view.received += 1
    link.view.now = link.view.now._replace(faults=((3, "gain of a"),), state="paused")
    last = {("", "button", "Close")}  # of the gains, whose fields are worked first
    pressed: set[tuple[str, str, str]] = set()  # tab, or "" of what is always there; kind; label
    with chromium(*([] if webgl else ["--disable-3d-apis"])) as browser:
        browser.open(page.server.address, width, SIZES[width])
        browser.until("return document.getElementById('bench-state')?.checkVisibility()")
        for place in (1, 2):
            browser.click(f"(//summary)[{place}]")
        for tab in TABS:
            open_tab(browser, tab)
            browser.until("return !document.querySelector('.q-tab-panel .q-transition')")
            hands = _Hands(browser, page, tab)
            if tab == "Plan":
                pressed |= _decided(hands)
            for kinds in (("button", "brake"), tuple(_FIELDS)):  # as it stands, then changed
                while found := [
                    e for e in hands.seen(kinds) if hands.name(e) not in pressed | last
                ]:
                    hands.work(found[0])
                    pressed.add(hands.name(found[0]))
            for again in [e for e in hands.seen(("button",)) if e.label in _AFTER_WRITING]:
                hands.work(again)
            named = {name.split("\n")[0] for name in (c["name"] for c in browser.run(CONTROLS))}
            done = {label for _, _, label in pressed}
            assert named <= done | {*TABS, "Open the report", *_WITHOUT}, (tab, named - done)
        assert not [c for c in browser.complaints() if "Refused" in c or "Error" in c]
    assert {
        "Switch to lqr",
        "Tune pd",
        "Apply the gains",
        "Plan",
        "Adopt the draft",
        "Disturb",
        "Note it",
        "Start",
        "Step",
        "End 3",
    } <= {label for _, kind, label in pressed if kind == "button"}
    services = {service for service, _ in link.request}
    assert services >= {
        "operate", "step", "set_rate", "switch_controller", "lqr/tune", "draft_plan", "decide_plan",
        "inject_fault", "note",
    }  # fmt: skip


def _decided(hands: "_Hands") -> set[tuple[str, str, str]]:
    """Have a draft made twice, refuse it and adopt it; return what was pressed."""
    start = next(e for e in hands.seen(("text",)) if e.label.startswith("start"))
    hands.work(start, "60.0")
    found = {e.label: e for e in hands.trust_all() if e.kind == "button"}
    decisions = [found[f"{word} the draft"] for word in ("Refuse", "Adopt")]
    for decision in decisions:
        hands.work(found["Plan"])
        hands.until(lambda: all(d.visible for d in decisions), decision)
        hands.work(decision)
        hands.until(lambda: not any(d.visible for d in decisions), decision)
        hands.gone(decision)
    return {hands.name(e) for e in (found["Plan"], *decisions)}


_TO_THE_MIDDLE = f"{FOUND}?.scrollIntoView({{block: 'center'}})"  # from below the header
_ALONG = f"""
const slider = {FOUND};
slider.scrollIntoView({{block: "center"}});
const box = slider.getBoundingClientRect();
return [box.left + 0.8 * box.width, (box.top + box.bottom) / 2];
"""
_WITHOUT = (
    "How to switch",
    "Drawing and layouts",
    "Close",
    "Reset",
    "Save",
    "?",
    "Models and measurements",  # an upload, see test_uploads
)  # of the page itself, or with a dialog
_AFTER_WRITING = ("Apply the gains", "Note it")  # before there is nothing to send
_WITHIN = 60.0  # for the page to say what it was told [wall s]
_FIELDS = ("check", "choice", "text", "lines", "number", "slider", "table")


class _Hands:
    """Work what stands on the page, and wait until the console has heard of it."""

    def __init__(self, browser: Browser, page: Page, tab: str) -> None:
        self._browser, self._gui, self._tab = browser, page.server.gui, tab

    def seen(self, kinds: tuple[str, ...]) -> list[Element]:
        """Return the elements of these kinds that stand on the page and can be worked."""
        return [e for e in self.trust_all() if e.kind in kinds and e.enabled and self._shown(e)]

    def trust_all(self) -> list[Element]:
        """Return all elements of the page, also those that nobody sees now."""
        return self._gui.all()

    def name(self, element: Element) -> tuple[str, str, str]:
        """Return what tells a control from others; of fields that are made anew it is the same."""
        place = element.parent
        while place is not None and place.kind != "tab":
            place = place.parent
        return place.label if place else "", element.kind, element.label

    def _shown(self, element: Element) -> bool:
        if not element.visible or (element.kind == "tab" and element.label != self._tab):
            return False
        return element.parent is None or self._shown(element.parent)

    def work(self, element: Element, text: str = "7.0") -> None:
        """Press, choose, write or draw it.

        Args:
            element: that stands on the page.
            text: to write into a field of text.
        """
        alike = [e for e in self.seen((element.kind,)) if e.label == element.label]
        place = f"[{alike.index(element) + 1}]"
        path = f"({_path(element)}){place}"
        before = element.value
        self._browser.run(_TO_THE_MIDDLE, path)
        if element.kind in ("button", "brake", "table"):
            if element.kind == "table" and not element.data:
                return
            told: list[int] = []
            element.on_click.append(told.append)
            self._browser.click(path)
            self.until(lambda: bool(told), element)
            return
        if element.kind == "check":
            self._browser.click(path)
            self.until(lambda: element.value is (not before), element)
        elif element.kind == "choice":
            others = [option for option in element.options if option != before] or [before]
            self._browser.click(f"{path}/ancestor::label")
            self._browser.click(f"//*[@role='option' and normalize-space()='{others[-1]}']")
            self._browser.until("return !document.querySelector('[role=option]')")
            self.until(lambda: element.value == others[-1], element)
        elif element.kind == "slider":
            moved: list[int] = []  # a slider may scale something and come back
            element.changed.append(moved.append)
            x, y = self._browser.run(_ALONG, path)
            for kind in ("mousePressed", "mouseReleased"):
                at = {"type": kind, "x": x, "y": y, "button": "left", "clickCount": 1}
                self._browser.devtools("Input.dispatchMouseEvent", at)
            self.until(lambda: bool(moved), element)
        else:
            text = "7" if element.kind == "number" else text
            self._browser.write(path, text)
            expected = 7.0 if element.kind == "number" else text
            self.until(lambda: element.value == expected, element)

    def gone(self, element: Element) -> None:
        """Wait until the page has removed an element, and what stood below it has moved."""
        self._browser.until(
            f"const found = {FOUND}; return !found?.checkVisibility()", _path(element)
        )

    def until(self, heard: Callable[[], bool], element: Element) -> None:
        """Wait until the console has heard of what was done with an element."""
        end = monotonic() + _WITHIN
        while not heard():
            if monotonic() > end:
                focus = self._browser.run("return document.activeElement.outerHTML.slice(0, 500)")
                raise AssertionError((self.name(element), element.value, focus))
            threading.Event().wait(0.01)


def _path(element: Element) -> str:
    """Return the XPath of what shows an element."""
    if element.kind in ("button", "brake"):
        return f"//button[not(@role='tab') and normalize-space()='{element.label}']"
    if element.kind == "table":
        return "//*[contains(@class, 'bench-table')]//tbody/tr/td[2]"
    kind = {"check": "@role='checkbox'", "slider": "@role='slider'"}
    what = kind.get(element.kind, "self::input or self::textarea")
    return f"//*[({what}) and @aria-label='{element.label}']"
