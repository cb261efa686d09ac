"""Pages that send what is no message, and two hands on one field."""

from collections.abc import Callable
from time import monotonic, sleep
from typing import Any

import msgspec
import pytest
from tests.fake_bench import FakeLink
from tests.page_client import PageClient

from flexslew_lab.console.page import Page


def test_what_is_no_message_ends_its_page_and_no_other(capfd: pytest.CaptureFixture[str]) -> None:
    link = FakeLink()
    page = Page(link, "127.0.0.1", 0, lambda words: None)
    page.poll()
    for garbage in (b"", b"\xc1", msgspec.msgpack.encode({"type": "NoSuchMessage"}), b"\x00" * 999):
        stranger = PageClient(page.server.address)
        stranger.socket.send(garbage)
    other = PageClient(page.server.address)
    inputs = page.server.gui._gui_input_handle_from_uuid.values()
    [start] = [e for e in inputs if getattr(e, "label", "") == "Start"]
    other.set(start._impl.uuid, True)
    while not link.asked:
        page.poll()
        other.reach()
    assert link.asked[0][1]["action"] == "start"
    page.close()
    assert "Traceback" not in "".join(capfd.readouterr())


def test_what_is_written_while_a_remark_is_noted_is_not_lost(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    link = FakeLink()
    page = Page(link, "127.0.0.1", 0, lambda words: None)
    page.poll()
    writer = PageClient(page.server.address)
    while "Note it" not in [element["label"] for element in writer.inputs.values()]:
        writer.reach()
    remark, note = writer.named("Remark"), writer.named("Note it")
    tell: Callable[[Any], None] = page.server.gui._websock_interface.queue_message

    def slow(message: Any) -> None:  # the field is about to be emptied
        if getattr(message, "updates", None) == {"value": ""}:
            monkeypatch.undo()
            writer.set(remark, "second")
            writer.set(note, True)
            sleep(0.3)
        tell(message)

    monkeypatch.setattr(page.server.gui._websock_interface, "queue_message", slow)
    writer.set(remark, "first")
    writer.set(note, True)
    limit = monotonic() + 10.0
    while len(link.asked) < 2 and monotonic() < limit:
        page.poll()
        sleep(0.01)
    assert [values["text"] for _, values in link.asked] == ["first", "second"]
    page.close()
