"""What axe-core finds on the page: contrast, names, roles, order of headings and focus."""

from pathlib import Path

import pytest
from tests.browser import chromium
from tests.console_walk import SIZES, TABS, open_tab
from tests.fake_bench import FakeLink

from flexslew_lab.console.page import Page

pytestmark = pytest.mark.browser

AXE = Path(__file__).parents[3] / ".venv" / "axe.min.js"
_RUN = """
return axe.run({animations: false}).then(found => found.violations.flatMap(rule =>
  rule.nodes.map(node => `${rule.id}: ${node.target.join(" ")}: ${node.failureSummary}`)));
"""


@pytest.mark.timeout(600)
@pytest.mark.skipif(not AXE.exists(), reason="no axe-core: .ci/tools installs it where npm is")
@pytest.mark.parametrize("width", [1440, 390])
def test_axe_finds_nothing(served: tuple[Page, FakeLink], width: int) -> None:
    page, link = served
    link.view.now = link.view.now._replace(active="", faults=((3, "gain of a"),))
    with chromium("--disable-3d-apis") as browser:
        browser.open(page.server.address, width, SIZES[width])
        browser.until("return document.querySelectorAll('.bench-grid svg path').length > 4")
        browser.run(f"{AXE.read_text()}; window.axe = axe;")
        browser.click("//button[normalize-space()='Tune pd']")
        for number, tab in enumerate(TABS):
            scheme = {"name": "prefers-color-scheme", "value": ("light", "dark")[number % 2]}
            still = {"name": "prefers-reduced-motion", "value": "reduce"}
            browser.devtools("Emulation.setEmulatedMedia", {"features": [scheme, still]})
            open_tab(browser, tab)
            browser.until("return !document.querySelector('.q-tab-panel .q-transition')")
            browser.until("return !document.querySelector('.q-tooltip')")  # it fades after a click
            assert browser.run(_RUN) == [], tab
