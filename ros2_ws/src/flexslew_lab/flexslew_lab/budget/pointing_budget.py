"""The pointing budget of a trial: its error sources, their metrics, the total and its margins.

After ECSS-E-ST-60-10C (control performance) and ESSB-HB-E-003 (pointing error engineering): sources
are listed, taken through the closed loop, filtered by the windows of the metrics (see windows),
summed (see contribution) and compared with requirements.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.plan import Plan
from flexslew_lab.budget.closed_loop import ErrorAxes, ErrorLoop, error_loop
from flexslew_lab.budget.contribution import Contribution, ErrorBound, bound_of, half_width, summed
from flexslew_lab.budget.flown_sources import (
    ErrorFreeFlight,
    fault_sources,
    friction_source,
    gyro_bias_sources,
    model_sources,
    reference_flight,
    slew_source,
)
from flexslew_lab.budget.left_out import left_out
from flexslew_lab.budget.parts import INTERPRETATIONS, Interpretation
from flexslew_lab.budget.quantisation import flown_quanta, white_quanta
from flexslew_lab.budget.requirements import Margin, margins_of
from flexslew_lab.budget.sources import (
    ObservedLoop,
    disturbance_sources,
    instrument_sources,
    outside_sources,
    sensor_sources,
)
from flexslew_lab.budget.windows import KNOWLEDGE, METRICS, Windows, windows_of
from flexslew_lab.guarantee.parameters import Vary
from flexslew_lab.short_values import short
from flexslew_lab.trial.trial import Trial, plan_of_trial
from flexslew_plant.errors import BadInput, FlexslewError
from flexslew_plant.notebook_table import in_notebook

_WINDOW = 10.0  # of a testbed that has none of its own [s]


@dataclass(frozen=True)
class BudgetRequest:
    """How a budget is made.

    Args:
        controller: by name; None: the active one when the observation begins.
        window: of MPE, RPE and PDE [s]; None: that of the testbed, or 10 s.
        drift: from a window to that with which PDE compares it [s]; None: the next one.
        level: of confidence [-].
        interpretation: see contribution.
        vary: errors of the model, see flown_sources.model_sources.
        require: largest values by metric, or by metric and axis (`APE`, `RPE.x`), [rad or m] or
            with a unit.
    """

    controller: str | None = None
    window: float | None = None
    drift: float | None = None
    level: float = 0.9973
    interpretation: Interpretation = "mixed"
    vary: Vary = field(default_factory=dict)
    require: Mapping[str, float | str] = field(default_factory=dict)

    def check(self) -> None:
        """Check what does not depend on the trial.

        Raises:
            BadInput: if the level or the interpretation is not allowed.
        """
        half_width(self.level)
        if self.interpretation not in INTERPRETATIONS:
            words = f"one of {', '.join(INTERPRETATIONS)}"
            raise BadInput(words, key="--interpretation", value=self.interpretation)


class BudgetRow(NamedTuple):
    """A source, or the total, at the level of confidence."""

    source: str
    kind: str
    about: str  # how it was found
    bounds: Mapping[str, ErrorBound]  # by metric


@dataclass(frozen=True, repr=False)
class Budget:
    """A pointing budget.

    Args:
        trial: its name.
        controller: that closes the loop.
        loop: of the errors.
        windows: that are observed.
        period: one tick [s].
        request: how it was made.
        contributions: of all sources.
        without: sources that the total does not contain, each with its reason.
        left_out: in words, what the linear loop does not contain.
    """

    trial: str
    controller: str
    loop: ErrorLoop
    windows: Windows
    period: float
    request: BudgetRequest
    contributions: tuple[Contribution, ...]
    without: tuple[str, ...]
    left_out: tuple[str, ...]

    def __repr__(self) -> str:
        """Return one line: the trial, the number of sources, the verdict."""
        return f"<Budget of {self.trial}: {len(self.contributions)} sources; {self.verdict}>"

    def _repr_html_(self) -> str:
        """Return the totals, for notebooks."""
        rows = [
            (metric, *(short(v, 4) for v in bound.value))
            for metric, bound in self.total.bounds.items()
        ]
        names = [f"{n} [{u}]" for n, u in zip(self.axes.names, self.axes.units, strict=True)]
        return in_notebook(repr(self), ("total", *names), rows)

    @property
    def axes(self) -> ErrorAxes:
        """The axes of the errors."""
        return self.loop.axes

    @property
    def metrics(self) -> tuple[str, ...]:
        """The metrics that some source has, in their order."""
        found = {name for one in self.contributions for name in one.parts}
        return tuple(m for m in (*METRICS, *KNOWLEDGE.values()) if m in found)

    @cached_property
    def rows(self) -> tuple[BudgetRow, ...]:
        """The sources at the level of confidence."""
        width = half_width(self.request.level)
        return tuple(
            BudgetRow(one.name, one.kind, one.about, {
                metric: bound_of(parts, self.request.interpretation, width)
                for metric, parts in one.parts.items()
            })
            for one in self.contributions
        )  # fmt: skip

    @cached_property
    def total(self) -> BudgetRow:
        """All sources together."""
        width = half_width(self.request.level)
        bounds = {}
        for metric in self.metrics:
            parts = summed([c.parts[metric] for c in self.contributions if metric in c.parts])
            bounds[metric] = bound_of(parts, self.request.interpretation, width)
        return BudgetRow("total", "total", "see the rules of summation", bounds)

    @property
    def margins(self) -> tuple[Margin, ...]:
        """The requirements with their margins."""
        return margins_of(self.request.require, self.total.bounds, self.axes)

    @property
    def met(self) -> bool:
        """Whether every requirement is met and no source is missing from the total."""
        return not self.without and all(one.met for one in self.margins)

    @property
    def verdict(self) -> str:
        """The result in a sentence."""
        words = "; ".join(
            f"{metric} {short(float(bound.value.max()), 3)}" if bound.value.size else metric
            for metric, bound in self.total.bounds.items()
        )
        level = f"{100.0 * self.request.level:g} %, {self.request.interpretation}: {words}"
        if missed := [one.requirement for one in self.margins if not one.met]:
            level += f"; NOT met: {', '.join(missed)}"
        elif self.margins and not self.without:
            level += "; all requirements met"
        if self.without:
            names = ", ".join(text.partition(":")[0] for text in self.without)
            level += f"; WITHOUT {names}, so no requirement counts as met"
        return level

    def plain(self) -> dict[str, Any]:
        """Return it as plain data."""
        w = self.windows
        return {
            "trial": self.trial,
            "controller": self.controller,
            "axes": dict(zip(self.axes.names, self.axes.units, strict=True)),
            "observed": [w.first * self.period, w.last * self.period],
            "window": w.length * self.period,
            "drift": w.apart * w.length * self.period,
            "level": self.request.level,
            "half_width": half_width(self.request.level),
            "interpretation": self.request.interpretation,
            "sources": [_plain_row(row) for row in self.rows],
            "total": _plain_row(self.total),
            "requirements": [one._asdict() for one in self.margins],
            "met": self.met,
            "without": list(self.without),
            "left_out": list(self.left_out),
            "verdict": self.verdict,
        }


def _plain_row(row: BudgetRow) -> dict[str, Any]:
    bounds = {
        metric: {key: value.tolist() for key, value in bound._asdict().items()}
        for metric, bound in row.bounds.items()
    }
    return {"source": row.source, "kind": row.kind, "about": row.about, "metrics": bounds}


def pointing_budget(
    trial: Trial, source: str, request: BudgetRequest, progress: Callable[[str], None] | None = None
) -> Budget:
    """Return the pointing budget of a trial from the end of its manoeuvre to that of its run.

    Args:
        trial: of the budget.
        source: its file, for an error.
        request: how it is made.
        progress: called with the name of what is computed.

    Raises:
        BadInput: if the loop is not stable or not linear, or a value of the request is not allowed.
        PlanFailed: if there is no plan.
    """
    request.check()
    plan = plan_of_trial(trial, predict=False)
    windows = observed_windows(trial, source, plan, request)
    loop = error_loop(trial, source, plan, windows.first * trial.period, request.controller)
    margins_of(request.require, {}, loop.axes)
    collected = _Collected(progress or (lambda name: None))
    at = ObservedLoop(trial, loop, windows)
    collected.add("sensors", lambda: sensor_sources(at))
    collected.add("instruments", lambda: instrument_sources(at))
    collected.add("quantisation", lambda: white_quanta(at))
    collected.add("disturbances", lambda: disturbance_sources(at))
    references = collected.take("slew", lambda: [reference_flight(at, source, plan)])
    for reference in references:
        _add_flown(collected, at, reference, request.vary)
    return Budget(
        trial.name,
        loop.controller,
        loop,
        windows,
        trial.period,
        request,
        tuple(collected.found),
        tuple(collected.without),
        left_out(at),
    )


def _add_flown(collected: "_Collected", at: ObservedLoop, of: ErrorFreeFlight, vary: Vary) -> None:
    """Add the sources along, or by, flights of the bench."""
    collected.add("slew", lambda: [slew_source(of)])
    collected.add("outside", lambda: outside_sources(at, of.flight.states))
    collected.add("gyro bias", lambda: gyro_bias_sources(of))
    collected.add("actuator.coulomb_friction", lambda: friction_source(of))
    collected.add("quantisation", lambda: flown_quanta(of))
    collected.add("faults", lambda: fault_sources(of))
    if vary:
        collected.add("model", lambda: model_sources(of, vary))


def observed_windows(
    trial: Trial, source: str, plan: Plan | None, request: BudgetRequest
) -> Windows:
    """Return the windows from the end of the manoeuvre, or `pointing_from`, to the end of the run.

    Raises:
        BadInput: if the manoeuvre ends after the run, or a window is not allowed.
    """
    testbed: Any = trial.testbed
    begin = max(0.0 if plan is None else plan.end, getattr(testbed, "pointing_from", 0.0))
    first, last = int(np.ceil(begin / trial.period - 1e-6)), round(trial.duration / trial.period)
    if first > last:
        words = f"the run ends before the observation begins, at {begin:g} s; give more"
        raise BadInput(words, source, "duration", trial.duration)
    seconds = request.window
    if seconds is None:
        seconds = float(getattr(testbed, "pointing_window", _WINDOW))
    return windows_of(first, last, trial.period, seconds, request.drift)


@dataclass
class _Collected:
    """Contributions so far, and the sources that have none, each with its reason."""

    progress: Callable[[str], None]
    found: list[Contribution] = field(default_factory=list)
    without: list[str] = field(default_factory=list)

    def add(self, name: str, make: Callable[[], Iterable[Contribution]]) -> None:
        """Add the contributions of some sources, those before a failure included."""
        self.found += self.take(name, make)

    def take(self, name: str, make: Callable[[], Iterable[Any]]) -> Sequence[Any]:
        """Return what is made; a failure is noted under the name."""
        self.progress(name)
        made: list[Any] = []
        try:
            made.extend(make())  # those before a failure stay
        except FlexslewError as error:
            self.without.append(f"{name}: {error}")
        return made
