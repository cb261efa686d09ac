"""An earlier run over every chart, with the largest difference."""

from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np

from flexslew_lab.console import quantities
from flexslew_lab.console.desk import PanelContext, ReplyLine
from flexslew_lab.console.history import Curve
from flexslew_lab.console.link import RequestResult
from flexslew_lab.console.panels.charts import ChartsPanel
from flexslew_lab.console.replay import Replay
from flexslew_lab.trial.outputs import bag_folder
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import one_line

_QUANTITIES = tuple(name for name in quantities.NAMES if name != quantities.INNOVATION)
Curves = dict[str, list[Curve]]  # by quantity


class ComparePanel:
    """The overlay.

    Args:
        context: of the page.
        charts: that it is drawn in.
    """

    def __init__(self, context: PanelContext, charts: ChartsPanel) -> None:
        gui = context.gui
        self._view, self._charts = context.view, charts
        folder = Path(context.link.folder) if context.link.folder else Path("runs/run")
        self._run = gui.text("Earlier run", _latest_other_run(folder), hint="its folder or bag")
        context.click(gui.button("Overlay it"), self._overlay)
        context.click(gui.button("Remove the overlay"), self._remove)
        self._reply = ReplyLine(context)
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="compare")
        self._reading: Future[Curves] | None = None
        self._previous: Curves = {}  # what is overlaid
        self._last_comparison = -1  # ticks

    def refresh(self) -> None:
        """Take a log that was read, and show the largest difference every 100 ticks."""
        if self._reading is not None and self._reading.done():
            done, self._reading = self._reading, None
            try:
                self._previous = done.result()
                self._charts.overlay({k: [*map(as_overlay, c)] for k, c in self._previous.items()})
                self._last_comparison = -1
            except Exception as error:  # of a log, which may hold anything; the page goes on
                words = str(error) if isinstance(error, BadInput | OSError) else one_line(error)
                self._reply.tell(RequestResult(False, words))
        ticks = self._view.truth.time.size
        if self._previous and abs(ticks - self._last_comparison) >= 100:
            self._last_comparison = ticks
            self._reply.tell(
                RequestResult(True, largest_difference(self._view_curves(), self._previous))
            )

    def _view_curves(self) -> Curves:
        return {name: quantities.curves_of(self._view, name) for name in _QUANTITIES}

    def _overlay(self, who: str) -> None:
        place = Path(self._run.value.strip())
        self._reply.tell(RequestResult(True, "reading ..."))
        self._reading = self._worker.submit(_read, place)

    def _remove(self, who: str) -> None:
        self._previous = {}
        self._charts.overlay({})
        self._reply.clear()


def _read(place: Path) -> Curves:
    """Return the curves of a run.

    Raises:
        BadInput: it cannot be read.
    """
    if not place.exists():
        raise BadInput(f"Earlier run: {place}: no such run")
    log = Replay(bag_folder(place))
    log.seek(log.last)
    return {
        name: curves for name in _QUANTITIES if (curves := quantities.curves_of(log.view, name))
    }


def as_overlay(curve: Curve) -> Curve:
    """Return a curve as it is drawn over those of the run that is seen."""
    return curve._replace(label=f"earlier {curve.label}", dashed=True, color=None)


def largest_difference(now: Curves, previous: Curves) -> str:
    """Return the largest difference of each quantity on the ticks that both have."""
    words = []
    for name in _QUANTITIES:
        others = {c.label: c for c in previous.get(name, ())}
        found = [
            (float(np.nanmax(np.abs(c.value[a] - others[c.label].value[b]))), c.label)
            for c in now.get(name, ())
            if c.label in others
            for _, a, b in [np.intersect1d(c.time, others[c.label].time, return_indices=True)]
            if len(a)
        ]
        if found:
            words.append(f"{name} {max(found)[0]:.3g} ({max(found)[1]})")
    return "largest difference: " + ("; ".join(words) if words else "no common tick")


def _latest_other_run(folder: Path) -> str:
    """Return the newest other run in the same place."""
    try:
        runs = [p for p in folder.parent.iterdir() if (p / "bag").is_dir() and p != folder]
        return str(max(runs, key=lambda p: p.stat().st_mtime)) if runs else ""
    except OSError:
        return ""
