"""The site is searched from a folder, where a browser starts no workers."""

from pathlib import Path

import pytest
from tests.browser import chromium

SCRIPTS = Path(__file__).parents[2] / "docs/javascripts"
PAGE = """<!doctype html><body><script>
{shim}
const worker = new Worker("worker.js");
worker.addEventListener("message", event => {{ document.title = event.data; }});
worker.postMessage(41);
</script></body>"""


@pytest.mark.browser
def test_a_worker_of_a_page_that_is_opened_as_a_file_answers(tmp_path: Path) -> None:
    shim = (SCRIPTS / "iframe-worker.js").read_text(encoding="utf-8")
    (tmp_path / "page.html").write_text(PAGE.format(shim=shim), encoding="utf-8")
    worker = 'addEventListener("message", event => postMessage(`answer ${event.data + 1}`));'
    (tmp_path / "worker.js").write_text(worker, encoding="utf-8")
    with chromium() as browser:
        browser.show(tmp_path / "page.html")
        browser.until("return document.title === 'answer 42'")
