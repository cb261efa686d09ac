"""Pages that send what is no message, and two hands on one field."""

from pathlib import Path
from time import monotonic, sleep
from typing import Any

import pytest
from tests.fake_bench import FakeLink
from tests.page_client import PageClient

from flexslew_lab.console.page import Page

GARBAGE: list[str | bytes] = [
    b"", b"\xc1", b"\x00" * 999, "42", "42{", '42["event"]', '42["event", null]', "4", "x",
    '42["event", {"client_id": "nobody"}]', '42["javascript_response", {"client_id": 7}]',
    '42["handshake", {"client_id": "nobody"}]', "40{", "451-[", "1",
]  # fmt: skip


def opened(tmp_path: Path, link: FakeLink, said: list[str]) -> Page:
    page = Page(link, "127.0.0.1", 0, said.append, layouts=tmp_path / "layouts.json")
    page.poll()
    return page


@pytest.mark.slow
def test_what_is_no_message_ends_at_most_its_page(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    link = FakeLink()
    page = opened(tmp_path, link, [])
    for garbage in GARBAGE:
        stranger = PageClient(page.server.address)
        stranger.socket.send(garbage)
    other = PageClient(page.server.address)
    other.set(other.named("Start"), True)
    while not link.request:
        page.poll()
        other.reach()
    assert link.request[0][1]["action"] == "start"
    page.close()
    assert "Traceback" not in "".join(capfd.readouterr())


@pytest.mark.parametrize("value", [None, [], {"a": 1}, True, 7, 1e300, "x"])
def test_a_value_of_another_kind_is_told_and_changes_no_field(tmp_path: Path, value: Any) -> None:
    said: list[str] = []
    page = opened(tmp_path, FakeLink(), said)
    stranger = PageClient(page.server.address)
    before = {id(e): e.value for e in page.server.gui.all()}
    for name in ("Rate", "Strict", "Ticks", "Remark", "Deflection scale"):
        stranger.set(stranger.named(name), value)
    stranger.reach()
    stranger.set(stranger.named("Filter"), "seen")
    limit = monotonic() + 30.0
    while "seen" not in [e.value for e in page.server.gui.all()]:
        assert monotonic() < limit, said
        stranger.reach()
    for element in page.server.gui.all():
        same = element.value == before[id(element)]
        kinds = {"check": bool, "number": float, "slider": float, "choice": str, "text": str}
        assert same or isinstance(element.value, kinds.get(element.kind, object)), element.label
    assert any("sent invalid data" in words for words in said)
    page.close()


def test_what_is_written_while_a_remark_is_noted_is_not_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    link = FakeLink()
    page = opened(tmp_path, link, [])
    writer = PageClient(page.server.address)
    remark, note = writer.named("Remark"), writer.named("Note it")
    empty = page.server.call

    def slow(act: Any) -> None:  # the field is about to be emptied
        monkeypatch.undo()
        writer.set(remark, "second")
        writer.set(note, True)
        while not page._context._waiting:  # both have arrived
            assert monotonic() < limit
            sleep(0.01)
        empty(act)

    monkeypatch.setattr(page.server, "call", slow)
    limit = monotonic() + 10.0
    writer.set(remark, "first")
    writer.set(note, True)
    while len(link.request) < 2 and monotonic() < limit:
        page.poll()
        sleep(0.01)
    assert [values["text"] for _, values in link.request] == ["first", "second"]
    page.close()
