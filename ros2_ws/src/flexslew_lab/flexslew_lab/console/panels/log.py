"""What happened, newest first, with a filter; and remarks of the operator."""

from collections.abc import Callable
from functools import partial

from flexslew_lab.console.desk import Desk, Reply
from flexslew_lab.console.link import RequestResult
from flexslew_plant import topics

_ROWS, _WIDTH = 10, 44  # of the list, in characters
_LEVELS = {"all": ("info", "warning", "fault"), "warnings and faults": ("warning", "fault")}
_SIGNS = {"info": "", "warning": "warning: ", "fault": "fault: "}


class EventsPanel:
    """A page of events; a click moves the charts there.

    Args:
        desk: of the page.
        jump: shows the charts around a time [s].
    """

    def __init__(self, desk: Desk, jump: Callable[[float], None]) -> None:
        gui = desk.gui
        self._view, self._jump = desk.view, jump
        self._level = gui.add_dropdown("Show", tuple(_LEVELS))
        self._filter = gui.add_text("Filter", "", hint="words of the message, its kind or source")
        self._buttons = [gui.add_button(" ", color="gray", visible=False) for _ in range(_ROWS)]
        self._rows = [(0.0, "")] * _ROWS
        self._skip = 0
        desk.click(gui.add_button("Older events"), partial(self._turn, _ROWS))
        desk.click(gui.add_button("Newer events"), partial(self._turn, -_ROWS))
        for row, button in enumerate(self._buttons):
            desk.click(button, partial(self._go, row))
        self._whole = Reply(desk)
        self._shown: tuple[object, ...] = ()

    def refresh(self) -> None:
        """List what passes the filter."""
        state = (self._view.heard, self._level.value, self._filter.value, self._skip)
        if state == self._shown:
            return
        self._shown = state
        words, levels = self._filter.value.lower(), _LEVELS.get(self._level.value, ())
        found = [
            e
            for e in reversed(self._view.events)
            if e.level in levels and words in f"{e.message} {e.kind} {e.source}".lower()
        ]
        self._skip = max(0, min(self._skip, len(found) - 1))
        chosen = found[self._skip : self._skip + _ROWS]
        for row, button in enumerate(self._buttons):
            button.visible = row < len(chosen)
            if row < len(chosen):
                event = chosen[row]
                who = event.data.get("who", "")
                by = f" (by {who})" if who else ""
                label = f"{event.time:.2f} s {_SIGNS[event.level]}{event.message}"
                self._rows[row] = event.time, f"{label}{by}"
                button.label = label if len(label) <= _WIDTH else f"{label[:_WIDTH]}..."

    def _turn(self, rows: int, who: str) -> None:
        self._skip = max(0, self._skip + rows)

    def _go(self, row: int, who: str) -> None:
        time, words = self._rows[row]
        self._jump(time)
        self._whole.tell(RequestResult(True, words))


class NotePanel:
    """A remark, kept in the log at its tick.

    Args:
        desk: of the page.
    """

    def __init__(self, desk: Desk) -> None:
        gui, self._desk = desk.gui, desk
        self._text = gui.add_text("Remark", "", multiline=True)
        desk.click(gui.add_button("Note it"), self._note)
        self._reply = Reply(desk)

    def refresh(self) -> None:
        """Nothing changes by itself."""

    def _note(self, who: str) -> None:
        text = self._text.value
        if not text.strip() or len(text) > 4000:
            words = "Remark: write something of at most 4000 characters"
            self._reply.tell(RequestResult(False, words))
            return

        def noted(result: RequestResult) -> None:
            if result.ok:
                self._desk.replace(self._text, text, "")

        self._reply.ask(topics.NOTE, {"text": text, "who": who}, noted)
