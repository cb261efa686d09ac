"""Forms of the console: random messages, valid and not, through a page's own connection."""

import random
from pathlib import Path
from time import monotonic

import numpy as np
import pytest

from flexslew_lab.console.page import Page
from tests.fake_bench import FakeLink
from tests.page_client import PageClient

SERVICES = {
    "operate", "step", "set_rate", "note", "switch_controller", "inject_fault", "end_fault",
    "pd/tune", "draft_plan", "decide_plan", "cancel",
}  # fmt: skip
ODD = [
    None, True, -1, 0, 7, 1e300, float("nan"), float("inf"), "", "pd", "[1, 2]", "{", "a: b",
    "&x [*x]", "9**9**9", "x" * 5000, [1, 2], {"a": 1}, "sine", "fast", "12.5", "!!python/none",
]  # fmt: skip


def test_whatever_pages_send_the_console_goes_on_and_asks_only_what_there_is(
    case: np.random.Generator, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    said: list[str] = []
    rng, link = random.Random(int(case.integers(2**32))), FakeLink()
    page = Page(link, "127.0.0.1", 0, said.append, layouts=tmp_path / "layouts.json")
    page.poll()
    stranger = PageClient(page.server.address)
    for number in range(100):
        stranger.set(rng.choice([*stranger.inputs, "nobody"]), rng.choice(ODD))
        if number % 25 == 0:
            page.poll()
    remark, note = stranger.named("Remark"), stranger.named("Note it")
    link.request.clear()
    for uuid, value in ((remark, "the end"), (note, True)):
        stranger.set(uuid, value)
    limit = monotonic() + 60.0
    while ("note", "the end") not in [(s, v.get("text")) for s, v in link.request]:
        assert monotonic() < limit, (link.request[-5:], said[-5:])
        page.poll()
        stranger.reach()
    assert {service for service, _ in link.request} <= SERVICES
    late = PageClient(page.server.address)  # it is told what the others have left
    while "Start" not in [element["label"] for element in late.inputs.values()]:
        late.reach()
    page.close()
    stranger.socket.close()
    captured = capfd.readouterr()
    assert "Traceback" not in captured.err + captured.out
    assert all(words.startswith("open ") or "sent invalid data" in words for words in said)
