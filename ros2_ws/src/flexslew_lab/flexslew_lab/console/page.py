"""The page: which panels stand where."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from threading import Event
from time import monotonic, process_time

from flexslew_lab.console.desk import PagePanel, PanelContext
from flexslew_lab.console.gui import Element
from flexslew_lab.console.layouts import layout_file
from flexslew_lab.console.link import BenchLink
from flexslew_lab.console.panels.analyse import AnalysePanel
from flexslew_lab.console.panels.cards import CardsPanel
from flexslew_lab.console.panels.charts import ChartsPanel
from flexslew_lab.console.panels.compare import ComparePanel
from flexslew_lab.console.panels.end import EndPanel
from flexslew_lab.console.panels.experiment import ExperimentPanel
from flexslew_lab.console.panels.faults import ActivePanel, DisturbancePanel, FaultPanel
from flexslew_lab.console.panels.log import EventsPanel, NotePanel
from flexslew_lab.console.panels.plan import PlanPanel
from flexslew_lab.console.panels.replay import RecordingPanel, ReplayPanel
from flexslew_lab.console.panels.run import FINISHED, HeaderPanel
from flexslew_lab.console.panels.scene import ScenePanel
from flexslew_lab.console.panels.sky import SkyPanel
from flexslew_lab.console.panels.tune import TunePanel
from flexslew_lab.console.panels.uploads import UploadsPanel
from flexslew_lab.console.server import ConsoleServer

POLL_PERIOD = 0.025  # between two polls at bench and pages [wall s]
FRAME = 1 / 10  # between two frames at least [wall s]
SHARE = 0.04  # of a core that the page takes of a bench that goes as fast as it can, about
_MAX_FRAME_INTERVAL = 1.0  # between two frames then at most [wall s]
_KEYS = {  # of the tabs
    "Plan": "m", "Faults": "f", "Experiment": "e", "Analysis": "a", "Log": "l", "End": "d",
}  # fmt: skip
Make = Callable[[PanelContext], PagePanel]


class Page:
    """Panels over one bench, the same for every browser that opens it.

    Args:
        link: link to the bench.
        host: address to listen on.
        port: 0 takes any.
        notify: called with each line for the user.
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
        notify: Callable[[str], None],
        recording: RecordingPanel | None = None,
        layouts: Path | None = None,
    ) -> None:
        self._link = link
        self.server = ConsoleServer(host, port, notify)
        self._context = PanelContext(self.server, link, notify)
        self._working: tuple[Element, ...] = ()  # tabs that do nothing once the run is over
        self._panels = self._built(recording, layouts or layout_file())
        self._next = 0.0
        self._process_time = 0.0  # processor time at the last frame [s]
        notify(f"open {self.server.address}")

    def poll(self) -> float:
        """Serve bench and pages; return after how many wall seconds to be called again."""
        now = monotonic()
        self._context.work()
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
        before, self._process_time = self._process_time, process_time()
        bench = self._context.view.now
        if bench.state != "running" or bench.rate_factor:
            return FRAME
        return min(max((self._process_time - before) / SHARE, FRAME), _MAX_FRAME_INTERVAL)

    def serve(self, over: Event) -> None:
        """Serve bench and pages until it is over, then end all pages."""
        try:
            while not over.wait(self.poll()):
                pass
        finally:
            self.close()

    def close(self) -> None:
        """End all pages."""
        self.server.close()

    def _built(self, recording: RecordingPanel | None, layouts: Path) -> list[PagePanel]:
        context, gui, live = self._context, self._context.gui, recording is None
        panels: list[PagePanel] = [context, HeaderPanel(context, live)]
        if recording is not None:
            panels += [ReplayPanel(context, recording), CardsPanel(context, None)]
        else:
            cards = gui.add("stack")  # above the gains
            panels.append(tune := TunePanel(context))
            with cards:
                panels.append(CardsPanel(context, tune.open))
        work: dict[str, tuple[Make, ...]] = {
            "Plan": (PlanPanel,),
            "Faults": (ActivePanel, DisturbancePanel, FaultPanel),
            "Experiment": (ExperimentPanel, partial(UploadsPanel, files=self.server.gate.files)),
        }
        names = (*(work if live else ()), "Analysis", "Log", "End")
        with gui.right:
            places = dict(zip(names, gui.tabs({n: _KEYS[n] for n in names}), strict=True))
        for name, panel_types in (work if live else {}).items():
            with places[name]:
                panels += [make(context) for make in panel_types]
        self._working = tuple(places[name] for name in ("Plan", "Faults") if live)
        with places["Analysis"]:
            panels.append(AnalysePanel(context, self.server.gate.files))
        with gui.middle:
            look = gui.add("details", "Drawing and layouts")
        with look:
            panels.append(ScenePanel(context))
            charts = ChartsPanel(context, layouts)
            panels += [charts, SkyPanel(context)]
        look.remove()
        gui.middle.children = (*gui.middle.children, look)  # below what it is about
        with places["Log"]:
            panels.append(EventsPanel(context, charts.jump))
            panels += [NotePanel(context)] if live else []
        with places["End"]:
            panels.append(EndPanel(context, self.server.gate.files))
            panels.append(ComparePanel(context, charts))
        return panels
