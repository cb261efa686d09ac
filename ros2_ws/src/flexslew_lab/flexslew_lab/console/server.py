"""viser behind the gate: one port, no banner, no tunnel to the outside."""

import asyncio
from collections.abc import Callable
from contextlib import redirect_stdout
from io import StringIO
from typing import Any

import viser
from viser import _messages

from flexslew_lab.console.gate import Gate, guarded_by, listening

SCRIPT = """
// a space is the brake, not a click on what has the focus; fields to write in keep it
addEventListener("keydown", event => {
  if (event.code !== "Space" || event.target.closest("input, textarea, select")) return;
  document.activeElement?.blur();
  event.preventDefault();
}, true);

// viser draws on for a quarter of a second after each change, as often as the screen can, which
// never ends while the bench moves. Here it draws what has come, and more only while somebody has
// a hand on the page. It would take that for a slow machine and draw fewer dots.
let touched = -1e9, drawn = -1e9, news = false, number = 0, timer, asked = new Map();
const screenFrame = requestAnimationFrame.bind(window);
function draw(time) {
  const due = asked;
  [asked, news, drawn] = [new Map(), false, performance.now()];
  for (const then of due.values()) try { then(time); } catch (error) { reportError(error); }
}
function schedule() {
  if (!asked.size) return;
  const now = performance.now();
  const pause = now - touched < 500 ? 0 : news ? 85 : 250;  // after the last frame [ms]
  clearTimeout(timer);
  timer = setTimeout(() => screenFrame(draw), drawn + pause - now);
}
window.requestAnimationFrame = then => {
  asked.set(++number, then);
  if (asked.size === 1) schedule();
  return number;
};
window.cancelAnimationFrame = which => { asked.delete(which); };
for (const kind of ["pointerdown", "pointermove", "wheel", "keydown"])
  addEventListener(kind, () => { touched = performance.now(); schedule(); }, true);
window.Worker = class extends Worker {
  constructor(...of) {
    super(...of);
    this.addEventListener("message", () => { news = true; schedule(); });
  }
};
const here = new URL(location);
here.searchParams.set("fixedDpr", devicePixelRatio);
history.replaceState(null, "", here);
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
        with guarded_by(self.gate, sock), redirect_stdout(StringIO()):  # it prints a banner
            self.viser = viser.ViserServer(host, self.port, verbose=False)
        self.gui, self.scene = self.viser.gui, self.viser.scene
        inside = self.viser._websock_server
        for kind in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
            inside.unregister_handler(kind)  # it would open a tunnel to another machine

        def unreadable(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
            say(f"a page sent invalid data: {context.get('exception') or 'nothing'!r:.200}")

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
