"""What stands on every worker of a Dask cluster, also on those that come later."""

import threading

from distributed import Worker, WorkerPlugin, get_worker

from flexslew_lab.studies.cases import Case
from flexslew_lab.studies.execution.worker import Job, StudyRunner
from flexslew_lab.studies.flight import FlightResult


class StudyPlugin(WorkerPlugin):  # type: ignore[misc]  # it has no types
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
        self._local = threading.local()

    def fly(self, chunk: list[Case]) -> list[FlightResult]:
        """Return the results of a chunk."""
        if not hasattr(self._local, "flyer"):
            self._local.flyer = StudyRunner(self._job)
        results: list[FlightResult] = []
        self._local.flyer.fly(chunk, results.extend)
        return results


def run_on_worker(name: str, chunk: list[Case]) -> list[FlightResult]:
    """Return the results of a chunk of a study; runs on a worker."""
    plugin = get_worker().plugins[name]
    assert isinstance(plugin, StudyPlugin)
    return plugin.fly(chunk)
