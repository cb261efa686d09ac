from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.console_walk import served_page
from tests.fake_bench import FakeLink

from flexslew_lab.console.page import Page


@pytest.fixture
def served(tmp_path: Path) -> Iterator[tuple[Page, FakeLink]]:
    """Yield a page over a bench that has flown a little, and is served from a thread."""
    with served_page(tmp_path) as page:
        yield page
