"""The console's page over a bench that answers everything, for tests that walk over it."""

import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from flexslew_lab.console.link import RequestResult, Then
from flexslew_lab.console.page import Page
from flexslew_plant.graph.topics import STEP
from flexslew_plant.testbeds.csa import CsaTestbed
from tests.browser import Browser
from tests.fake_bench import FakeLink

SIZES = {1440: 900, 1024: 768, 768: 1024, 390: 844}
TABS = ("Plan", "Faults", "Experiment", "Analysis", "Log", "End")
# what stands on the page that a person can press, write into or choose from
CONTROLS = """
const seen = e => e.checkVisibility() && e.getBoundingClientRect().width > 0;
const of = "button, input, textarea, summary, [role=checkbox], [role=slider], [role=tab], a[href]";
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


class CountingLink(FakeLink):
    """Answers each request with its number, and refuses a step."""

    def ask(self, service: str, values: Mapping[str, Any], then: Then) -> None:
        self.request.append((service, dict(values)))
        then(RequestResult(service != STEP, f"answer {len(self.request)}."))


@contextmanager
def served_page(folder: Path) -> Iterator[tuple[Page, FakeLink]]:
    """Yield a page over a bench that has flown a little, and is served from a thread."""
    link, over = CountingLink(), threading.Event()
    view, time = link.view, np.arange(4000, dtype=float) * 0.01
    rows = 2e-6 * np.column_stack((np.sin(time), np.cos(time)))
    view.truth.add(time, {"position": rows})
    view.controller_state.add(time, {"reference_position": rows})
    view.testbed = CsaTestbed()
    view.controllers["lqr"] = view.controllers["pd"]._replace(name="lqr")
    view.time, view.now = 39.99, view.now._replace(state="running", active="pd", rate_factor=1.0)
    page = Page(link, "127.0.0.1", 0, print, layouts=folder / "layouts.json")
    drawing = next(e for e in page.server.gui.all() if e.label == "Drawing")
    drawing.value = "three dimensions"  # by the processor, too

    def work() -> None:
        while not over.wait(page.poll()):
            pass

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield page, link
    finally:
        over.set()
        thread.join()
        page.close()


def open_tab(browser: Browser, name: str) -> None:
    browser.run("scrollTo(0, 0)")  # from below the header, as a person would
    browser.click(f"//*[@role='tab' and normalize-space()='{name}']")
    browser.until(
        "return [...document.querySelectorAll('[role=tab]')]"
        ".some(e => e.innerText.trim() === arguments[0] && e.ariaSelected === 'true')",
        name,
    )
