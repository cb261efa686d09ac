"""Names of any length leave the page whole."""

from pathlib import Path

import pytest
from tests.browser import chromium
from tests.console_walk import served_page

from flexslew_lab.console.view import ControllerView

pytestmark = pytest.mark.browser

_LONG = "b" * 60
_OUTSIDE = """
const place = document.querySelector('body').getBoundingClientRect();
return [...document.querySelectorAll('#bench-state span, .bench-card b, .bench-card .q-btn')]
  .map(e => [e.innerText, e.getBoundingClientRect()])
  .filter(([, box]) => box.right > place.right + 1 || box.height > 120)
  .map(([text]) => text);
"""


@pytest.mark.timeout(300)
def test_a_long_name_of_a_controller_does_not_push_the_state_out_of_sight(tmp_path: Path) -> None:
    with served_page(tmp_path) as (page, link), chromium("--disable-3d-apis") as browser:
        link.view.controllers[_LONG] = ControllerView(_LONG, "pd_feedforward", True, "", "")
        link.view.now = link.view.now._replace(active=_LONG)
        for width in (1440, 390):
            browser.open(page.server.address, width)
            browser.until("return document.body.innerText.includes(arguments[0])", _LONG)
            assert browser.run(_OUTSIDE) == []
            assert browser.run("return document.documentElement.scrollWidth <= innerWidth")
