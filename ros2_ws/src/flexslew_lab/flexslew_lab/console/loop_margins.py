"""Stability and margins of the controllers' linear loops, computed beside the page."""

from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any, NamedTuple

from flexslew_control.message_fields import plan_of
from flexslew_control.plan import Plan
from flexslew_lab.console.current_trial import current_trial
from flexslew_lab.console.view import BenchView
from flexslew_lab.trial.trial import Trial
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import one_line
from flexslew_plant.yaml_data import yaml_text

_KEPT = 32  # results
_Key = tuple[str, ...]


class LoopMargin(NamedTuple):
    """Stability and disk margin of a loop in words, or why there are none."""

    words: str = ""  # empty: not computed yet
    known: bool = False


class LoopMargins:
    """The margins of each controller about the rest after the plan, or the start without one.

    One is computed at a time, in a thread of its own, which takes about half a second of a
    processor. The latest results are kept.

    Args:
        view: view of the bench.
    """

    def __init__(self, view: BenchView) -> None:
        self._view = view
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="margins")
        self._found: dict[_Key, LoopMargin] = {}
        self._job: tuple[_Key, Future[LoopMargin]] | None = None

    def of(self, controller: str, changes: Mapping[str, Any] = {}) -> LoopMargin:
        """Return the margins of a controller; call it again until they are computed.

        Args:
            controller: its name.
            changes: settings that differ from those that it has reported.
        """
        view, known = self._view, self._view.controllers.get(controller)
        if known is None or not view.bench_settings:
            return LoopMargin()
        key = (known.law, known.settings, yaml_text(dict(changes)) if changes else "",
               view.bench_settings, view.plan.hash if view.plan is not None else "")  # fmt: skip
        self._collect()
        if key not in self._found and self._job is None:
            try:
                trial = current_trial(view, controller, changes)
                plan = plan_of(view.plan, "the bench") if view.plan is not None else None
            except Exception as error:  # of settings that may be anything; the page goes on
                self._found[key] = _refused(error)
            else:
                job = self._worker.submit(partial(_margin, trial, controller, plan))
                self._job = key, job
        return self._found.get(key, LoopMargin())

    def _collect(self) -> None:
        if self._job is not None and self._job[1].done():
            key, job = self._job
            self._job = None
            self._found[key] = job.result()
            if len(self._found) > _KEPT:
                del self._found[next(iter(self._found))]


def _margin(trial: Trial, controller: str, plan: Plan | None) -> LoopMargin:
    from flexslew_lab.analysis.analysis import loop_analysis  # takes long to import

    try:
        found = loop_analysis(trial, "the bench", controller, plan=plan, errors=())
    except Exception as error:  # of a law and a testbed that may be anything; the page goes on
        return _refused(error)
    disk = f", disk margin {found.disks['input'].alpha:.2f}" if found.stable else ""
    return LoopMargin(f"{found.statement}{disk}", True)


def _refused(error: Exception) -> LoopMargin:
    return LoopMargin(str(error) if isinstance(error, BadInput) else one_line(error))
