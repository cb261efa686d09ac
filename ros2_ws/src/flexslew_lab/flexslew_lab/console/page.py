"""The page: which panels stand where."""

from collections.abc import Callable
from time import monotonic

from flexslew_lab.console.desk import Desk, Panel
from flexslew_lab.console.link import Link
from flexslew_lab.console.panels.charts import ChartsPanel
from flexslew_lab.console.panels.replay import Recording, ReplayPanel
from flexslew_lab.console.panels.run import BrakePanel, RunPanel
from flexslew_lab.console.panels.scene import ScenePanel
from flexslew_lab.console.panels.state import StatePanel
from flexslew_lab.console.panels.swap import SwapPanel
from flexslew_lab.console.server import ConsoleServer

FRAME = 0.05  # between two frames at least [wall s]
LEFT, RIGHT = 340, 560  # widths [px]


class Page:
    """Panels over one bench, the same for everybody who opens it.

    Args:
        link: to the bench.
        host: address to listen on.
        port: 0 takes any.
        say: told what a person should know, a line each.
        recording: that the link shows; None: the bench is alive.

    Raises:
        BadInput: the port cannot be opened.
    """

    def __init__(
        self,
        link: Link,
        host: str,
        port: int,
        say: Callable[[str], None],
        recording: Recording | None = None,
    ) -> None:
        self._link = link
        self.server = ConsoleServer(host, port, say)
        self._desk = Desk(self.server.viser, link)
        self._panels = _built(self._desk, recording)
        self._next = 0.0
        say(f"open {self.server.address}")

    def poll(self) -> float:
        """Serve bench and pages; return after how many wall seconds to be called again."""
        now = monotonic()
        self._desk.work()
        self._link.poll(now)
        if now >= self._next:
            for panel in self._panels:
                panel.refresh()
            self._next = now + FRAME
        return FRAME / 2

    def close(self) -> None:
        """End all pages."""
        self.server.close()


def _built(desk: Desk, recording: Recording | None) -> list[Panel]:
    gui = desk.gui
    gui.configure_theme(show_logo=False, show_share_button=False)
    gui.set_panel_label("flexslew")
    panels: list[Panel] = [StatePanel(desk)]
    panels.append(BrakePanel(desk) if recording is None else ReplayPanel(desk, recording))
    tabs = gui.add_tab_group()
    if recording is None:
        with tabs.add_tab("Run"):
            panels.append(RunPanel(desk))
        with tabs.add_tab("Swap"):
            panels.append(SwapPanel(desk))
    with tabs.add_tab("View"):
        panels.append(ScenePanel(desk))
    right = gui.add_panel()
    with right.add_tab("Charts"):
        panels.append(ChartsPanel(desk))
    gui.main_panel.dock_left()
    gui.main_panel.set_width(LEFT)
    right.dock_right()
    right.set_width(RIGHT)
    return panels
