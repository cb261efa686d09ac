"""Flights of the trials of a chunk in any process: by batches or one by one."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from flexslew_lab.studies.batch.fleet import BatchRunner, ForBench
from flexslew_lab.studies.cases import Case
from flexslew_lab.studies.flight import FlightResult, PlanCache, failed, simulate_case
from flexslew_lab.studies.study import Study
from flexslew_lab.studies.ways import Way
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH

Report = Callable[[list[FlightResult]], None]
Begin = Callable[[int], None]


class Job(NamedTuple):
    """All that a process must know to fly any trial of a study."""

    study: Study
    plans: PlanCache
    at_once: int = BATCH_WIDTH

    @property
    def limit(self) -> float:
        """The longest that a trial may take [wall s]."""
        return self.study.settings.limit

    def __reduce__(self) -> tuple[type["Job"], tuple[Study, PlanCache, int]]:
        """Travel without the trials made so far: they may be of classes that a file here holds.

        Another process finds these by their names when it makes the trials itself.
        """
        return Job, (self.study._replace(nominal={}), self.plans, self.at_once)

    def flyer(self) -> "StudyRunner":
        """Return what flies its trials."""
        return StudyRunner(self)

    def failed(self, number: int, reason: str) -> FlightResult:
        """Return the result of a trial that has none."""
        return failed(number, reason)


@dataclass
class StudyRunner:
    """Flies chunks of a study.

    Args:
        job: the study and the plans that are made already.
    """

    job: Job
    _batch_runner: BatchRunner | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        """Open the batch, if the study uses them."""
        if self.job.study.settings.batch:
            self._batch_runner = BatchRunner(self.job.study, self.job.plans)

    def fly(
        self, cases: Sequence[Case], report: Report, begin: Begin = lambda number: None
    ) -> None:
        """Fly the cases.

        Args:
            cases: cases of the study.
            report: called with the results as they come, in any order.
            begin: called with the number of a trial before it is flown alone.
        """
        if self._batch_runner is None:
            self._one_by_one([ForBench(case, Way.BENCH) for case in cases], report, begin)
            return
        for results, others in self._batch_runner.fly(cases):
            if results:
                report(results)
            self._one_by_one(others, report, begin)

    def _one_by_one(self, cases: Sequence[ForBench], report: Report, begin: Begin) -> None:
        for case, way in cases:
            begin(case.number)
            report([simulate_case(self.job.study, case, self.job.plans)._replace(way=way)])
