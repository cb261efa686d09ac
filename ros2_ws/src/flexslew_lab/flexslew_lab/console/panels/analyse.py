"""Poles and margins of a controller of the bench, as it flies now, on a page of their own."""

from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from tempfile import mkdtemp
from typing import NamedTuple

from flexslew_control.message_fields import plan_of
from flexslew_control.plan import Plan
from flexslew_lab.console.desk import Desk, DeskReply, line
from flexslew_lab.console.flown_trial import flown_trial
from flexslew_lab.console.forms import FormKey, OpenedOn, moment, value_of
from flexslew_lab.console.gate import FILES
from flexslew_lab.console.link import RequestResult
from flexslew_lab.console.panels.swap import NOBODY
from flexslew_lab.trial.trial import Trial
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import one_line

_PAGE = "analysis.html"
_OPEN = f'<a href="{FILES}{_PAGE}" target="_blank" rel="noopener">Open the analysis</a>'
_AT = "analysed at"


class _Found(NamedTuple):
    page: str  # HTML
    rows: list[str]  # the few numbers that the panel shows


class AnalysePanel:
    """The analysis of one controller, made in a thread of its own.

    Args:
        desk: desk of the page.
        files: files that the gate serves, by name.
    """

    def __init__(self, desk: Desk, files: dict[str, Path]) -> None:
        gui = desk.gui
        self._view, self._files, self._folder = desk.view, files, desk.link.folder
        self._which = gui.choice("Analysed controller", (NOBODY,))
        self._opened = OpenedOn(self._which)
        self._at = gui.text(f"{_AT} [s]", hint="simulated time; empty: now")
        desk.click(gui.button("Analyse", hint="its page opens from here"), self._analyse)
        self._reply, self._rows = DeskReply(desk), gui.html()
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="analyse")
        self._making: Future[_Found] | None = None

    def refresh(self) -> None:
        """List the controllers, and show a finished analysis."""
        self._opened.offer(tuple(sorted(self._view.controllers)), NOBODY, self._view.now.active)
        if self._making is None or not self._making.done():
            return
        done, self._making = self._making, None
        try:
            found = done.result()
            if _PAGE not in self._files:
                self._files[_PAGE] = Path(self._folder or mkdtemp(prefix="flexslew-")) / _PAGE
            self._files[_PAGE].write_text(found.page, encoding="utf-8")
        except Exception as error:  # of a law and a testbed that may be anything; the page goes on
            words = str(error) if isinstance(error, BadInput | OSError) else one_line(error)
            self._reply.tell(RequestResult(False, words))
            return
        self._reply.tell(RequestResult(True, "analysed"))
        self._rows.content = _OPEN + "".join(line(row) for row in found.rows)

    def _analyse(self, who: str) -> None:
        if self._making is not None:
            return
        view, name = self._view, self._which.value
        try:
            at = value_of(FormKey(_AT, "[s]"), str(self._at.value))
            time = view.time if at is None else moment(_AT, at)
            trial = flown_trial(view, name)
            plan = plan_of(view.plan, "the bench") if view.plan is not None else None
        except BadInput as error:
            self._reply.tell(RequestResult(False, str(error)))
            return
        self._reply.tell(RequestResult(True, "analysing ..."))
        self._making = self._worker.submit(partial(_analysis, trial, name, time, plan))


def _analysis(trial: Trial, name: str, time: float, plan: Plan | None) -> _Found:
    """Return the page and the numbers of a controller at a time.

    Raises:
        BadInput: it has no linear form there.
    """
    from flexslew_lab.analysis.analysis import analysed  # a page without an analysis needs neither
    from flexslew_lab.analysis.page import analysis_page, summary_rows

    analysis = analysed(trial, "the bench", name, time, plan=plan)
    rows = [f"{what}: {value}" for what, value in summary_rows(analysis)]
    return _Found(analysis_page(analysis, trial.testbed.kind), rows)
