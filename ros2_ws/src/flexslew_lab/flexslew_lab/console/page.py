"""The page: which panels stand where."""

from collections.abc import Callable
from pathlib import Path
from time import monotonic, process_time

from flexslew_lab.console.desk import Desk, DeskPanel
from flexslew_lab.console.gui import Element
from flexslew_lab.console.layouts import layout_file
from flexslew_lab.console.link import BenchLink
from flexslew_lab.console.panels.analyse import AnalysePanel
from flexslew_lab.console.panels.charts import ChartsPanel
from flexslew_lab.console.panels.compare import ComparePanel
from flexslew_lab.console.panels.end import EndPanel
from flexslew_lab.console.panels.experiment import ExperimentPanel
from flexslew_lab.console.panels.faults import ActivePanel, DisturbPanel, FaultPanel
from flexslew_lab.console.panels.log import EventsPanel, NotePanel
from flexslew_lab.console.panels.plan import PlanPanel
from flexslew_lab.console.panels.replay import RecordingPanel, ReplayPanel
from flexslew_lab.console.panels.run import FINISHED, HeaderPanel, RunPanel
from flexslew_lab.console.panels.scene import ScenePanel
from flexslew_lab.console.panels.sky import SkyPanel
from flexslew_lab.console.panels.state import StatePanel
from flexslew_lab.console.panels.swap import SwapPanel
from flexslew_lab.console.panels.tune import TunePanel
from flexslew_lab.console.server import ConsoleServer

POLL_PERIOD = 0.025  # between two polls at bench and pages [wall s]
FRAME = 1 / 10  # between two frames at least [wall s]
SHARE = 0.04  # of a core that the page takes of a bench that goes as fast as it can, about
_SLOWEST = 1.0  # between two frames then at most [wall s]
Make = Callable[[Desk], DeskPanel]


class Page:
    """Panels over one bench, the same for every browser that opens it.

    Args:
        link: link to the bench.
        host: address to listen on.
        port: 0 takes any.
        say: called with each line for the user.
        recording: panel of the log that the link shows; None: a live bench.
        layouts: file of the chart layouts; None: the user's own.

    Raises:
        BadInput: the port cannot be opened.
    """

    def __init__(
        self,
        link: BenchLink,
        host: str,
        port: int,
        say: Callable[[str], None],
        recording: RecordingPanel | None = None,
        layouts: Path | None = None,
    ) -> None:
        self._link = link
        self.server = ConsoleServer(host, port, say)
        self._desk = Desk(self.server, link, say)
        self._working: tuple[Element, ...] = ()  # tabs that do nothing once the run is over
        self._panels = self._built(recording, layouts or layout_file())
        self._next = 0.0
        self._spent = 0.0  # processor time at the last frame [s]
        say(f"open {self.server.address}")

    def poll(self) -> float:
        """Serve bench and pages; return after how many wall seconds to be called again."""
        now = monotonic()
        self._desk.work()
        self._link.poll(now)
        if now >= self._next:
            self.refresh()
            self._next = now + self._pause()
        self.server.show()
        return POLL_PERIOD

    def refresh(self) -> None:
        """Update every panel to the present state."""
        for panel in self._panels:
            panel.refresh()
        over = self._link.view.now.state == FINISHED
        for tab in self._working:
            tab.visible = not over

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

    def _built(self, recording: RecordingPanel | None, layouts: Path) -> list[DeskPanel]:
        desk, gui = self._desk, self._desk.gui
        panels: list[DeskPanel] = [HeaderPanel(desk, recording is None), StatePanel(desk)]
        if recording is not None:
            panels.append(ReplayPanel(desk, recording))
        live: dict[str, tuple[Make, ...]] = {
            "Run": (RunPanel,),
            "Swap": (SwapPanel,),
            "Tune": (TunePanel,),
            "Experiment": (ExperimentPanel,),
            "Plan": (PlanPanel,),
            "Break": (ActivePanel, DisturbPanel, FaultPanel),
        }
        work = {} if recording else live
        names = (*work, "Analyse", "Log", "View", "End")
        places = dict(zip(names, gui.tabs(names), strict=True))
        for name, makes in work.items():
            with places[name]:
                panels += [make(desk) for make in makes]
        self._working = tuple(places[name] for name in work if name != "Experiment")
        with places["Analyse"]:
            panels.append(AnalysePanel(desk, self.server.gate.files))
        with places["View"]:
            charts = ChartsPanel(desk, layouts)
            panels += [charts, ScenePanel(desk), SkyPanel(desk)]
        with places["Log"]:
            panels += [] if recording else [NotePanel(desk)]
            panels.append(EventsPanel(desk, charts.jump))
        with places["End"]:
            panels.append(EndPanel(desk, self.server.gate.files))
            panels.append(ComparePanel(desk, charts))
        return panels
