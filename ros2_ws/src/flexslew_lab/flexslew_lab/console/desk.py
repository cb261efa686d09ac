"""What every panel works with: the page's elements, the bench, and one thread for all of it."""

import getpass
import html
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Protocol

from flexslew_lab.console.gui import Element, PageCallback
from flexslew_lab.console.link import BenchLink, RequestResult
from flexslew_lab.console.loop_margins import LoopMargins
from flexslew_lab.console.server import ConsoleServer

Act = Callable[[str], None]  # takes the user and page of the request


class PagePanel(Protocol):
    """A part of the page."""

    def refresh(self) -> None:
        """Show what is known now; called at most ten times a second."""


class PanelContext:
    """Hands the clicks of all pages to the thread that serves the bench.

    Args:
        server: server of the page.
        link: link to the bench.
        notify: called with one line when a page sends what none of its forms can send.
    """

    _accepted: tuple[str, dict[str, Any]] | None = None  # the settings of its bench, the model

    def __init__(
        self, server: ConsoleServer, link: BenchLink, notify: Callable[[str], None]
    ) -> None:
        self.server, self.gui = server, server.gui
        self.link, self.view = link, link.view
        self.margins = LoopMargins(link.view)
        self._waiting: deque[tuple[Act, int]] = deque()
        self.replies: list[ReplyLine] = []
        self._user, self._notify = _user(), notify

    @property
    def identified(self) -> dict[str, Any] | None:
        """The `testbed` section of the model that was accepted of this bench; None: none yet."""
        if self._accepted is None or self._accepted[0] != self.view.bench_settings:
            return None
        return self._accepted[1]

    def accept(self, model: dict[str, Any]) -> None:
        """Let plans for the bench that is there believe a model, a `testbed` section."""
        self._accepted = self.view.bench_settings, model

    def click(self, button: Element, act: Act) -> None:
        """Let a button do something."""
        button.on_click.append(self._handler(act))

    def change(self, field: Element, act: Act) -> None:
        """Do something whenever a page, and not the console itself, changes a field."""
        field.changed.append(self._handler(act))

    def replace(self, field: Element, old: Any, new: Any) -> None:
        """Give a field another value, unless a page has changed it meanwhile.

        Both what pages write and this is done by the thread of the server, so that neither
        comes between the look and the change.
        """

        def swap() -> None:
            if field.value == old:
                field.value = new

        self.server.call(swap)

    def refresh(self) -> None:
        """Remove the messages that are no longer true."""
        for reply in self.replies:
            reply.refresh()

    def work(self) -> None:
        """Perform the requests that the pages have sent since the last call."""
        while self._waiting:
            act, page = self._waiting.popleft()
            try:
                act(f"{self._user}, page {page}")
            except (LookupError, TypeError, ValueError) as error:  # others go on working
                self._notify(f"a page sent invalid data: {error!r:.200}")

    def _handler(self, act: Act) -> PageCallback:
        return lambda page: self._waiting.append((act, page))


class ReplyLine:
    """A line that shows the outcome of the last request of its panel, as long as it is true.

    Args:
        context: desk of the page.
    """

    def __init__(self, context: PanelContext) -> None:
        self._link, self._content = context.link, ""
        self._html = context.gui.html()
        self._holds: Callable[[], bool] | None = None
        context.replies.append(self)

    def ask(
        self,
        service: str,
        values: Mapping[str, Any],
        then: Callable[[RequestResult], None] = lambda result: None,
        done: Callable[[], bool] | None = None,
    ) -> None:
        """Request something of the bench, and show its answer.

        Args:
            service: name of its service.
            values: fields of the request.
            then: called with the answer.
            done: whether the state of the bench, which the page shows anyway, is the requested one.
                A success then needs no message, and a repeated request is a success.
        """

        def answer(result: RequestResult) -> None:
            if done is not None and (result.ok or done()):
                self.clear()
            else:
                self.tell(result)
            then(result)

        self.tell(RequestResult(True, "asked ..."))
        self._link.ask(service, values, answer)

    def tell(self, result: RequestResult, holds: Callable[[], bool] | None = None) -> None:
        """Show an answer, a refusal as such in words.

        Args:
            result: the answer.
            holds: whether it is still true. None: a refusal until the state of the bench changes,
                another answer until a reset.
        """
        words = result.message if result.ok else f"refused: {result.message}"
        known = self._state(result.ok)
        self._holds = holds or (lambda: self._state(result.ok) == known)
        self._show(line(words, "status" if result.ok else "alert"))

    def _state(self, ok: bool) -> tuple[object, ...]:
        """Return the state of the bench that an answer depends on."""
        now, brake = self._link.view.now, self._link.view.brake_on_next
        return (now.epoch,) if ok else (now.epoch, now.state, now.active, brake)

    def refresh(self) -> None:
        """Clear the line if it is no longer true."""
        if self._holds is not None and not self._holds():
            self.clear()

    def clear(self) -> None:
        """Show an empty line."""
        self._holds = None
        self._show("")

    def _show(self, content: str) -> None:
        if content != self._content:
            self._html.content = self._content = content


def line(words: str, role: str = "") -> str:
    """Return one line of text as HTML; the role alert has the colour of a refusal."""
    attribute = f' role="{role}"' if role else ""
    return f'<div{attribute} class="bench-note">{html.escape(words)}</div>' if words else ""


def _user() -> str:
    with suppress(ImportError, KeyError, OSError):  # an id without a name, a system without ids
        return getpass.getuser()
    return "console"
