"""The page: which panels stand where."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import monotonic, process_time

from flexslew_lab.console.desk import Desk, Panel
from flexslew_lab.console.link import Link
from flexslew_lab.console.panels.breakage import ActivePanel, BreakPanel, DisturbPanel
from flexslew_lab.console.panels.charts import ChartsPanel
from flexslew_lab.console.panels.compare import ComparePanel
from flexslew_lab.console.panels.end import EndPanel
from flexslew_lab.console.panels.log import EventsPanel, NotePanel
from flexslew_lab.console.panels.plan import PlanPanel
from flexslew_lab.console.panels.replay import Recording, ReplayPanel
from flexslew_lab.console.panels.run import BrakePanel, RunPanel
from flexslew_lab.console.panels.scene import ScenePanel
from flexslew_lab.console.panels.state import StatePanel
from flexslew_lab.console.panels.swap import SwapPanel
from flexslew_lab.console.panels.tune import TunePanel
from flexslew_lab.console.server import ConsoleServer

LOOK = 0.025  # between two looks at bench and pages [wall s]
FRAME = 1 / 10  # between two frames at least [wall s]
SHARE = 0.04  # of a core that the page takes of a bench that goes as fast as it can, about
_SLOWEST = 1.0  # between two frames then at most [wall s]
LEFT, RIGHT = 400, 560  # widths [px]
Make = Callable[[Desk], Panel]


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
        self._desk = Desk(self.server.viser, link, say)
        self._panels = _built(self._desk, recording, self.server.gate.files)
        self._next = 0.0
        self._spent = 0.0  # processor time at the last frame [s]
        say(f"open {self.server.address}")

    def poll(self) -> float:
        """Serve bench and pages; return after how many wall seconds to be called again."""
        now = monotonic()
        self._desk.work()
        self._link.poll(now)
        if now >= self._next:
            for panel in self._panels:
                panel.refresh()
            self._next = now + self._pause()
        return LOOK

    def _pause(self) -> float:
        """Return the wall seconds until the next frame: fewer frames where time is scarce."""
        before, self._spent = self._spent, process_time()
        bench = self._desk.view.now
        if bench.state != "running" or bench.rate_factor:
            return FRAME
        return min(max((self._spent - before) / SHARE, FRAME), _SLOWEST)

    def close(self) -> None:
        """End all pages."""
        self.server.close()


def _built(desk: Desk, recording: Recording | None, files: dict[str, Path]) -> list[Panel]:
    gui = desk.gui
    gui.configure_theme(show_logo=False, show_share_button=False)
    gui.set_panel_label("flexslew")
    right = gui.add_panel()
    with right.add_tab("Charts"):
        charts = ChartsPanel(desk)
    panels: list[Panel] = [charts, StatePanel(desk)]
    if recording is not None:
        panels.append(ReplayPanel(desk, recording))
        tabs: dict[str, tuple[Make, ...]] = {}
    else:
        panels.append(BrakePanel(desk))
        tabs = {
            "Run": (RunPanel,),
            "Swap": (SwapPanel,),
            "Tune": (TunePanel,),
            "Plan": (PlanPanel,),
            "Break": (ActivePanel, DisturbPanel, BreakPanel),
        }
    events: Make = partial(EventsPanel, jump=charts.jump)
    tabs["Log"] = (events,) if recording else (NotePanel, events)
    tabs["View"] = (ScenePanel,)
    tabs["End"] = (partial(EndPanel, files=files), partial(ComparePanel, charts=charts))
    group = gui.add_tab_group()
    for name, makes in tabs.items():
        with group.add_tab(name):
            panels += [make(desk) for make in makes]
    gui.main_panel.dock_left()
    gui.main_panel.set_width(LEFT)
    right.dock_right()
    right.set_width(RIGHT)
    return panels
