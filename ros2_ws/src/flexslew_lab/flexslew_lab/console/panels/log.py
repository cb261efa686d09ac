"""What happened, newest first, with a filter; and remarks of the operator."""

from collections.abc import Callable, Iterable

from flexslew_lab.console.desk import PanelContext, ReplyLine, line
from flexslew_lab.console.link import RequestResult
from flexslew_lab.console.panels.run import FINISHED
from flexslew_lab.console.view import EVENTS
from flexslew_plant.events import Event
from flexslew_plant.graph import topics

_ROWS = 200  # of the table
_LEVELS = {"all": ("info", "warning", "fault"), "warnings and faults": ("warning", "fault")}
_COLUMNS = ("time [s]", "what", "by")
_SIGNS = {"info": "", "warning": "warning: ", "fault": "fault: "}


class EventsPanel:
    """A table of events; a click moves the charts there.

    Args:
        context: of the page.
        jump: shows the charts around a time [s].
    """

    def __init__(self, context: PanelContext, jump: Callable[[float], None]) -> None:
        gui = context.gui
        self._view, self._jump = context.view, jump
        self._level = gui.choice("Show", tuple(_LEVELS))
        self._filter = gui.text("Filter", "", hint="words of the message, its kind or source")
        self._group_warnings = gui.check(
            "Fold warnings", True, hint="those of a kind that follow each other"
        )
        self._table = gui.add("table", "events", options=_COLUMNS, data=[])
        context.click(self._table, self._go)
        self._cut = gui.html(visible=False)
        self._times: dict[int, float] = {}  # of the rows, by their numbers [s]
        self._last_state: tuple[object, ...] = ()

    def refresh(self) -> None:
        """List what passes the filter."""
        state = (
            self._view.received,
            self._level.value,
            self._filter.value,
            self._group_warnings.value,
        )
        if state == self._last_state:
            return
        self._last_state = state
        words, levels = self._filter.value.lower(), _LEVELS.get(self._level.value, ())
        found = (
            (self._view.received - k, e)
            for k, e in enumerate(reversed(self._view.events), 1)
            if e.level in levels and words in f"{e.message} {e.kind} {e.source}".lower()
        )
        groups = folded(found, _ROWS, bool(self._group_warnings.value))
        self._times = {group[-1][0]: group[0][1].time for group in groups}
        self._table.data = [_row(group[-1][0], [e for _, e in group]) for group in groups]
        self._cut.visible = len(groups) == _ROWS or len(self._view.events) == EVENTS
        self._cut.content = line(
            f"The newest {_ROWS} rows at most, of the last {EVENTS:,} events: the filter finds "
            "older rows, flexslew log info prints all events."
        )

    def _go(self, who: str) -> None:
        if (time := self._times.get(self._table.value)) is not None:
            self._jump(time)


def folded(
    events: Iterable[tuple[int, Event]], rows: int, group_warnings: bool
) -> list[list[tuple[int, Event]]]:
    """Return events in groups: warnings of a kind that follow each other are one.

    Args:
        events: with their numbers, newest first.
        rows: groups at most.
        group_warnings: False: each for itself.
    """
    found: list[list[tuple[int, Event]]] = []
    for number, event in events:
        last = found[-1][0][1] if found else None
        same = last is not None and (event.kind, event.source) == (last.kind, last.source)
        if group_warnings and same and event.level == "warning":
            found[-1].append((number, event))
        elif len(found) == rows:
            break
        else:
            found.append([(number, event)])
    return found


def _row(number: int, group: list[Event]) -> dict[str, object]:
    event = group[0]
    many = f" ({len(group)} times since {group[-1].time:.2f} s)" if len(group) > 1 else ""
    values = (f"{event.time:.2f}", f"{_SIGNS[event.level]}{event.message}{many}")
    return {"id": number, **dict(zip(_COLUMNS, (*values, event.data.get("who", "")), strict=True))}


class NotePanel:
    """A remark, kept in the log at its tick.

    Args:
        context: of the page.
    """

    def __init__(self, context: PanelContext) -> None:
        gui, self._context = context.gui, context
        self._place = gui.folder("Remark")
        with self._place:
            self._text = gui.text("Remark", "", lines=True)
            context.click(gui.button("Note it"), self._note)
            self._reply = ReplyLine(context)

    def refresh(self) -> None:
        """A run that is over takes no more remarks."""
        self._place.visible = self._context.view.now.state != FINISHED

    def _note(self, who: str) -> None:
        text = self._text.value
        if not text.strip() or len(text) > 4000:
            words = "Remark: write something of at most 4000 characters"
            self._reply.tell(RequestResult(False, words))
            return

        def on_note(result: RequestResult) -> None:
            if result.ok:
                self._context.replace(self._text, text, "")

        self._reply.ask(topics.NOTE, {"text": text, "who": who}, on_note)
