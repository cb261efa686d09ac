"""What a process of a comparison does: plan for a candidate, or fly one on one bench."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.plan import Plan
from flexslew_control.planners import other_method
from flexslew_lab.run.flight_log import FlightLog
from flexslew_lab.run.in_process import run_bench
from flexslew_lab.trial.trial import SavedPlan, Trial, parse_trial, plan_of_trial, set_plan, set_up
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.bench.bench import Truth
from flexslew_plant.errors import BadInput, FlexslewError, without_source
from flexslew_plant.own_code import Trust, one_line
from flexslew_plant.testbeds import read_testbed

_CURVE_SAMPLES = 600  # samples of a curve
_LIMIT = 3600.0  # of a plan or a flight [wall s]


class PlanCase(NamedTuple):
    """A requested plan."""

    number: int
    method: str
    keys: Mapping[str, Any]  # of its section, in addition to the manoeuvre


class FlightCase(NamedTuple):
    """A requested flight."""

    number: int
    controllers: dict[str, dict[str, Any]]
    active: str
    plan: Plan | None
    testbed: dict[str, Any]  # the section of what stands on the bench
    duration: float  # of the run [s]
    longest: float  # end of the longest plan [s]


class FlightOutcome(NamedTuple):
    """What a candidate did on one bench."""

    metrics: Mapping[str, Any]
    lost: str  # why the flight could not be flown to its end; empty: it was
    time: Vector  # (samples,) [s]
    curves: Matrix  # (samples, curves of the comparison)


class CaseOutcome(NamedTuple):
    """What became of a case."""

    number: int
    plan: Plan | None = None
    flight: FlightOutcome | None = None
    refused: str = ""  # why there is neither


Cases = Sequence[PlanCase | FlightCase]


@dataclass(frozen=True)
class ComparisonJob:
    """Implements PooledJob: plans and flights of one trial's variants.

    Args:
        trial: its text, with the section of the manoeuvre as its plan, or with none.
        source: its file, for messages.
        trust: which classes of the user's own it may name.
        redesigned: whether the laws are designed for the bench that they fly on, not for the
            trial's own.
        metrics: returns the numbers of a flight from its log and the end of the manoeuvre, for a
            step that of the longest plan [s]. A function of a module, as `curves`: it goes from
            process to process.
        curves: returns the curves of some ticks of a flight over time, (ticks, curves).
    """

    trial: str
    source: str
    trust: Trust
    redesigned: bool
    metrics: Callable[[FlightLog, float], dict[str, Any]]
    curves: Callable[[FlightLog, Sequence[Truth]], Matrix]
    limit: float = _LIMIT
    at_once: int = 1

    def flyer(self) -> "_CaseRunner":
        """Return what plans and flies in this process."""
        return _CaseRunner(self, parse_trial(self.trial, self.source, self.trust))

    def failed(self, number: int, reason: str) -> CaseOutcome:
        """Return the outcome of a case that came to nothing."""
        return CaseOutcome(number, refused=reason)


class _CaseRunner(NamedTuple):
    job: ComparisonJob
    trial: Trial

    def fly(
        self,
        cases: Cases,
        report: Callable[[list[CaseOutcome]], None],
        begin: Callable[[int], None] = lambda number: None,
    ) -> None:
        """Do the cases; see CaseRunner."""
        for case in cases:
            begin(case.number)
            report([self._outcome(case)])

    def _outcome(self, case: PlanCase | FlightCase) -> CaseOutcome:
        try:
            if isinstance(case, PlanCase):
                return CaseOutcome(case.number, plan=self._make_plan(case))
            return CaseOutcome(case.number, flight=self._simulate(case))
        except FlexslewError as reason:
            return CaseOutcome(case.number, refused=without_source(reason))
        except Exception as error:  # a class of the user's own may do anything
            return CaseOutcome(case.number, refused=one_line(error))

    def _make_plan(self, case: PlanCase) -> Plan | None:
        trial_plan = self.trial.plan
        assert not isinstance(trial_plan, SavedPlan | None)
        section = other_method(trial_plan, case.method, f"{self.job.source}: plan", **case.keys)
        return plan_of_trial(replace(self.trial, plan=section), predict=False)

    def _simulate(self, case: FlightCase) -> FlightOutcome:
        """Return the flight of a candidate on another bench than it believes in.

        Raises:
            BadInput: there is no such law for this testbed, or it does not take the plan.
        """
        trial = replace(
            self.trial,
            controllers=case.controllers,
            active=case.active,
            duration=case.duration,
        )
        testbed = read_testbed(case.testbed, self.job.source, trial.trust)
        if self.job.redesigned:
            trial = replace(trial, testbed=testbed)
        bench, controllers = set_up(trial, self.job.source, testbed)
        plan = case.plan
        reason = set_plan(controllers, trial.active, plan) or controllers[trial.active].reason
        if reason is not None:
            raise BadInput(reason)
        seen = FlightLog(bench, plan)
        run_bench(bench, controllers, seen)
        end = plan.end if plan is not None and plan.duration else case.longest
        sample_rows = np.unique(np.linspace(0, len(seen.truth_log) - 1, _CURVE_SAMPLES).astype(int))
        some = [seen.truth_log[row] for row in sample_rows]
        return FlightOutcome(
            self.job.metrics(seen, end),
            bench.failure,
            np.array([truth.time for truth in some]),
            self.job.curves(seen, some),
        )


def largest_tip(truths: Sequence[Truth]) -> Vector:
    """Return the largest appendage's deflection at each tick, with its sign, (ticks,) [m]."""
    # with a zero, so that there is one where nothing deflects
    tips = np.array([(*truth.tip_deflection, 0.0) for truth in truths])
    return np.take_along_axis(tips, np.abs(tips).argmax(axis=1)[:, None], axis=1)[:, 0]
