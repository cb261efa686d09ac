"""What stands on every worker of a Dask cluster, also on those that come later."""

import threading

from distributed import Worker, WorkerPlugin, get_worker

from flexslew_lab.studies.cases import Case
from flexslew_lab.studies.execution.worker import Flyer, Job
from flexslew_lab.studies.flight import Flown


class StudyFlights(WorkerPlugin):  # type: ignore[misc]  # it has no types
    """Flies chunks of one study on a worker.

    The scheduler keeps it and gives it to each worker before its first task, so that nothing that
    a study needs is lost with a worker.

    Args:
        job: what is flown.
        name: of the study on the cluster, unlike any other's.
    """

    def __init__(self, job: Job, name: str) -> None:
        self.name = name
        self._job = job

    def setup(self, worker: Worker) -> None:
        """Give every thread of the worker a flyer of its own."""
        self._own = threading.local()

    def fly(self, chunk: list[Case]) -> list[Flown]:
        """Return the results of a chunk."""
        if not hasattr(self._own, "flyer"):
            self._own.flyer = Flyer(self._job)
        results: list[Flown] = []
        self._own.flyer.fly(chunk, results.extend)
        return results


def fly_on_worker(name: str, chunk: list[Case]) -> list[Flown]:
    """Return the results of a chunk of a study; runs on a worker."""
    flights = get_worker().plugins[name]
    assert isinstance(flights, StudyFlights)
    return flights.fly(chunk)
