"""NiceGUI behind the gate: one port, from a thread of its own."""

import asyncio
import logging
import os
import sys
import webbrowser
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from threading import Thread
from typing import Any

import uvicorn
from fastapi import FastAPI, Request
from nicegui import core, ui

from flexslew_lab.console.drawing import PageView
from flexslew_lab.console.gate import Gate, Receive, Scope, Send, listening
from flexslew_lab.console.gui import Element, Gui

RECONNECT = 30.0  # for so long a page that is held up finds itself again [wall s]
_HISTORY = 4000  # messages that are sent again to such a page
_MESSAGE = 1 << 20  # bytes that a page may send at once
_DISPLAY_VARIABLES = {"DISPLAY", "WAYLAND_DISPLAY"}  # environment variables: a browser can be seen
_SERVER = "flexslew.server"  # key of a request's scope


class ConsoleServer:
    """Serves one page to every browser that the gate admits.

    Args:
        host: address to listen on.
        port: 0 takes any.
        notify: called with one line when a page sends what cannot be read.

    Attributes:
        gui: what stands on the page.

    Raises:
        BadInput: the port cannot be opened.
    """

    def __init__(self, host: str, port: int, notify: Callable[[str], None]) -> None:
        sock = listening(host, port)
        self.host, self.port = host, int(sock.getsockname()[1])
        self.gui, self.notify, self.pages = Gui(), notify, 0
        self.views: list[PageView] = []
        self._loop, inner = _nicegui()

        async def application(scope: Scope, receive: Receive, send: Send) -> None:
            await inner({**scope, _SERVER: self}, receive, send)

        self.gate = Gate(application, host, self.port)
        config = uvicorn.Config(
            self.gate, lifespan="off", log_config=None, access_log=False, ws_max_size=_MESSAGE,
            proxy_headers=False, server_header=False, timeout_graceful_shutdown=1,
        )  # fmt: skip
        self._server = uvicorn.Server(config)
        self._over = asyncio.run_coroutine_threadsafe(self._server.serve([sock]), self._loop)
        self._update_pending = False

    @property
    def address(self) -> str:
        """What a person opens."""
        name = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{name}:{self.port}/?token={self.gate.token}"

    def open_browser(self) -> None:
        """Open the page in a browser, if there is a screen."""
        if sys.platform == "linux" and not _DISPLAY_VARIABLES & os.environ.keys():
            return
        with suppress(webbrowser.Error):
            webbrowser.open(self.address)

    def show(self) -> None:
        """Have all pages show what has changed; may be called by any thread."""
        if self.gui.updates and not self._update_pending:
            self._update_pending = True
            self._loop.call_soon_threadsafe(self._draw)

    def call(self, act: Callable[[], None]) -> None:
        """Do something in the thread that takes what pages write, and show what it changes."""

        def run_action() -> None:
            act()
            self._draw()

        self._loop.call_soon_threadsafe(run_action)

    def close(self) -> None:
        """End all pages."""
        self._server.should_exit = True
        self._over.result(20.0)
        self.views.clear()

    def _draw(self) -> None:
        self._update_pending = False
        changed: dict[int, Element] = {}
        while self.gui.updates:
            element = self.gui.updates.popleft()
            changed[id(element)] = element
        self.views = [view for view in self.views if not view.closed]
        for view in self.views:
            for element in changed.values():
                view.update(element)
            view.track()


@cache
def _nicegui() -> tuple[asyncio.AbstractEventLoop, Any]:
    """Return the loop that all pages of this process share, running, and what answers there."""
    logging.getLogger("nicegui").setLevel(logging.CRITICAL)  # else it prints tracebacks
    for name in ("uvicorn.error", "engineio.server", "socketio.server"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    ui.page("/", title="flexslew", language="en-US", reconnect_timeout=RECONNECT, dark=None)(_page)
    ui.run_with(
        app, title="flexslew", reconnect_timeout=RECONNECT, show_welcome_message=False,
        message_history_length=_HISTORY, binding_refresh_interval=None, tailwind=False,
    )  # fmt: skip
    core.app.on_exception(_invalid)
    # no bar over the page while the browser requests something: it has no name for a screen reader
    core.app.config.quasar_config["loadingBar"]["skipHijack"] = True
    loop = asyncio.new_event_loop()
    loop.set_exception_handler(lambda _, context: _invalid(context.get("exception")))
    Thread(target=loop.run_forever, daemon=True, name="pages").start()
    lifespan = app.router.lifespan_context(app)
    asyncio.run_coroutine_threadsafe(lifespan.__aenter__(), loop).result(60.0)
    core.sio.eio.max_http_buffer_size = _MESSAGE
    core.sio.eio.ping_timeout = RECONNECT  # one that only draws slowly is not cut off
    return loop, app


def _invalid(error: BaseException | None) -> None:
    """Print one line about page data that is no message."""
    print(f"a page sent invalid data: {error!r:.200}", file=sys.stderr, flush=True)


async def _page(request: Request) -> None:
    """Draw the page of the server that has let the request in."""
    server: ConsoleServer = request.scope[_SERVER]
    server.pages += 1
    view = PageView(server.gui, server.pages, server.notify, server.show)
    server.views.append(view)
    await view.settle()
