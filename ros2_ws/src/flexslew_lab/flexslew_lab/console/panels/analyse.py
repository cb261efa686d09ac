"""Poles and margins of a controller of the bench, as it flies now, on a page of their own."""

from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from tempfile import mkdtemp
from typing import NamedTuple

from flexslew_control.message_fields import plan_of
from flexslew_control.plan import Plan
from flexslew_lab.console.current_trial import current_trial
from flexslew_lab.console.desk import PanelContext, ReplyLine, line
from flexslew_lab.console.forms import FormKey, OpenedOn, moment, value_of
from flexslew_lab.console.gate import FILES
from flexslew_lab.console.link import RequestResult
from flexslew_lab.console.panels.cards import NO_CONTROLLER
from flexslew_lab.guarantee.model.parameters import Vary, vary_of
from flexslew_lab.report.sections import Section
from flexslew_lab.trial.trial import Trial
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import one_line

_PAGE = "analysis.html"
_OPEN = f'<a href="{FILES}{_PAGE}" target="_blank" rel="noopener">Open the analysis</a>'
_AT, _VARY = "analysed at", "uncertain"
_VARIED = "stiffness=20%, payload=20%"


class _Job(NamedTuple):
    """What is analysed; the last two for a guarantee."""

    trial: Trial
    name: str
    time: float
    plan: Plan | None
    vary: Vary | None = None
    fly: bool = False


class _Found(NamedTuple):
    page: str  # HTML
    rows: list[str]  # the few numbers that the panel shows


class AnalysePanel:
    """The analysis of one controller, made in a thread of its own.

    Args:
        context: desk of the page.
        files: files that the gate serves, by name.
    """

    def __init__(self, context: PanelContext, files: dict[str, Path]) -> None:
        gui = context.gui
        self._view, self._files, self._folder = context.view, files, context.link.folder
        self._which = gui.choice("Analysed controller", (NO_CONTROLLER,))
        self._opened = OpenedOn(self._which)
        self._at = gui.text(f"{_AT} [s]", hint="simulated time; empty: now")
        context.click(gui.button("Analyse", hint="its page opens from here"), self._analyse)
        self._vary = gui.text(_VARY, _VARIED, hint="NAME=20% or NAME=LOW..HIGH, with commas")
        hint = "the worst case over these ranges, with its page"
        context.click(gui.button("Guarantee", hint=hint), partial(self._guarantee, False))
        hint = "a bench of its own, just inside and outside of the nearest unstable loop"
        context.click(gui.button("Fly it", hint=hint), partial(self._guarantee, True))
        self._reply, self._rows = ReplyLine(context), gui.html()
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="analyse")
        self._analysis_job: Future[_Found] | None = None

    def refresh(self) -> None:
        """List the controllers, and show a finished analysis."""
        self._opened.offer(
            tuple(sorted(self._view.controllers)), NO_CONTROLLER, self._view.now.active
        )
        if self._analysis_job is None or not self._analysis_job.done():
            return
        done, self._analysis_job = self._analysis_job, None
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
        self._begin(None, False)

    def _guarantee(self, fly: bool, who: str) -> None:
        self._begin(str(self._vary.value), fly)

    def _begin(self, ranges: str | None, fly: bool) -> None:
        """Begin an analysis, with a guarantee over ranges or without.

        Args:
            ranges: of uncertain parameters, with commas between; None: no guarantee.
            fly: whether the nearest unstable loop is flown.
        """
        if self._analysis_job is not None:
            return
        view, name = self._view, self._which.value
        try:
            at = value_of(FormKey(_AT, "[s]"), str(self._at.value))
            time = view.time if at is None else moment(_AT, at)
            trial = current_trial(view, name)
            plan = plan_of(view.plan, "the bench") if view.plan is not None else None
            parts = [part for part in (ranges or "").split(",") if part.strip()]
            vary = None if ranges is None else vary_of(parts)
        except BadInput as error:
            self._reply.tell(RequestResult(False, str(error)))
            return
        self._reply.tell(RequestResult(True, "analysing ..."))
        job = _Job(trial, name, time, plan, vary, fly)
        self._analysis_job = self._worker.submit(partial(_analysis, job))


def _analysis(job: _Job) -> _Found:
    """Return the page and the numbers of a controller at a time.

    Raises:
        BadInput: it has no linear form there, or no guarantee can be tried.
    """
    from flexslew_lab.analysis.analysis import (
        loop_analysis,  # a page without an analysis needs neither
    )
    from flexslew_lab.analysis.page import analysis_page, summary_rows
    from flexslew_lab.guarantee.flight import guarantee_of
    from flexslew_lab.guarantee.tables import gain_rows, worst_case_sections

    analysis = loop_analysis(job.trial, "the bench", job.name, job.time, plan=job.plan)
    rows = [f"{what}: {value}" for what, value in summary_rows(analysis)]
    more: list[Section] = []
    if job.vary is not None:
        worst = guarantee_of(job.trial, analysis, job.vary, job.fly)
        if job.fly and worst.flown is None:
            raise BadInput("no unstable loop was found in these ranges: there is none to fly")
        more, at = worst_case_sections(worst), worst.found.rows
        rows = [worst.verdict, *(f"{name}: unstable at {value}" for name, _, _, value in at)]
        rows += [f"peak of {name}: {found}, none above {bound}"
                 for name, _, found, bound, _ in gain_rows(worst.found)]  # fmt: skip
    return _Found(analysis_page(analysis, job.trial.testbed.kind, more=more), rows)
