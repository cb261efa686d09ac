"""Find the error sources of a trial and make its pointing budget of them.

After ECSS-E-ST-60-10C (control performance) and ESSB-HB-E-003 (pointing error engineering): sources
are listed, taken through the closed loop, filtered by the windows of the metrics (see windows),
summed (see contribution) and compared with requirements.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flexslew_control.plan import Plan
from flexslew_lab.budget.budget import Budget, BudgetRequest
from flexslew_lab.budget.closed_loop import error_loop
from flexslew_lab.budget.contribution import Contribution
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
from flexslew_lab.budget.quantisation import flown_quanta, white_quanta
from flexslew_lab.budget.requirements import margins_of
from flexslew_lab.budget.sources import (
    ObservedLoop,
    disturbance_sources,
    instrument_sources,
    outside_sources,
    sensor_sources,
)
from flexslew_lab.budget.windows import Windows, windows_of
from flexslew_lab.guarantee.model.parameters import Vary
from flexslew_lab.trial.trial import Trial, plan_of_trial
from flexslew_plant.errors import BadInput, FlexslewError

_WINDOW = 10.0  # of a testbed that has none of its own [s]


def pointing_budget(trial: Trial, source: str, request: BudgetRequest) -> Budget:
    """Return the pointing budget of a trial from the end of its manoeuvre to that of its run.

    Args:
        trial: of the budget.
        source: its file, for an error.
        request: how it is made.

    Raises:
        BadInput: if the loop is not stable or not linear, or a value of the request is not allowed.
        PlanFailed: if there is no plan.
    """
    request.check()
    plan = plan_of_trial(trial, predict=False)
    windows = observed_windows(trial, source, plan, request)
    loop = error_loop(trial, source, plan, windows.first * trial.period, request.controller)
    margins_of(request.require, {}, loop.axes)
    collected = _Collected()
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

    found: list[Contribution] = field(default_factory=list)
    without: list[str] = field(default_factory=list)

    def add(self, name: str, make: Callable[[], Iterable[Contribution]]) -> None:
        """Add the contributions of some sources, those before a failure included."""
        self.found += self.take(name, make)

    def take(self, name: str, make: Callable[[], Iterable[Any]]) -> Sequence[Any]:
        """Return what is made; a failure is noted under the name."""
        made: list[Any] = []
        try:
            made.extend(make())  # those before a failure stay
        except FlexslewError as error:
            self.without.append(f"{name}: {error}")
        return made
