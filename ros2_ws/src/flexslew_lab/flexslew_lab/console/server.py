"""viser behind the gate: one port, no banner, no tunnel to the outside."""

import asyncio
from collections.abc import Callable
from contextlib import redirect_stdout
from io import StringIO
from typing import Any

import viser
from viser import _messages

from flexslew_lab.console.gate import Gate, listening, standing

# a space is the brake, not a click on what has the focus; fields to write in keep it
SCRIPT = """
addEventListener("keydown", event => {
  if (event.code !== "Space" || event.target.closest("input, textarea, select")) return;
  document.activeElement?.blur();
  event.preventDefault();
}, true);
"""


class ConsoleServer:
    """A viser server for one page.

    Args:
        host: address to listen on.
        port: 0 takes any.
        say: told in one line when a page sends what cannot be read.

    Raises:
        BadInput: the port cannot be opened.
    """

    def __init__(self, host: str, port: int, say: Callable[[str], None]) -> None:
        sock = listening(host, port)
        self.host, self.port = host, int(sock.getsockname()[1])
        self.gate = Gate(self.port, SCRIPT)
        with standing(self.gate, sock), redirect_stdout(StringIO()):  # it prints a banner
            self.viser = viser.ViserServer(host, self.port, verbose=False)
        self.gui, self.scene = self.viser.gui, self.viser.scene
        inside = self.viser._websock_server
        for kind in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
            inside.unregister_handler(kind)  # it would open a tunnel to another machine

        def unreadable(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
            say(f"a page sent what cannot be used: {context.get('exception') or 'nothing'!r:.200}")

        loop = self.viser._event_loop
        loop.call_soon_threadsafe(loop.set_exception_handler, unreadable)

    @property
    def address(self) -> str:
        """What a person opens."""
        name = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{name}:{self.port}/?token={self.gate.token}"

    def close(self) -> None:
        """End all pages."""
        with redirect_stdout(StringIO()):
            self.viser.stop()
