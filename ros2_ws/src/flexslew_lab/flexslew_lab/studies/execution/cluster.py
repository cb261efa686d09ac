"""Fly on a Dask cluster by the address of its scheduler."""

from asyncio import CancelledError
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from queue import Empty, SimpleQueue
from time import monotonic
from typing import Any
from uuid import uuid4

from flexslew_lab.run.pool import Chunks
from flexslew_lab.studies.cases import Case
from flexslew_lab.studies.execution.worker import Job
from flexslew_lab.studies.flight import FlightResult, failed
from flexslew_plant.errors import BadInput, RunFault

_CONNECT = 30.0  # patience with the scheduler [wall s]


class Cluster:
    """Implements Executor with the workers of a cluster, one chunk for each of their threads.

    A worker that dies loses its chunk; Dask gives it to another one. A chunk that loses its
    workers again and again, or that takes longer than all its trials may, is flown one by one; a
    trial that then fails again has failed.

    Args:
        job: the study and its plans.
        address: address of the scheduler, such as tcp://127.0.0.1:8786.

    Raises:
        BadInput: if no scheduler answers there, or the workers there cannot fly.
    """

    def __init__(self, job: Job, address: str) -> None:
        import distributed

        from flexslew_lab.studies.execution.cluster_worker import StudyPlugin

        self._address = address
        try:
            self._client: Any = distributed.Client(address, timeout=_CONNECT, set_as_default=False)
        except (OSError, ValueError) as error:
            raise BadInput(f"--dask: {address}: no scheduler answers: {error}") from None
        self._limit = job.limit
        self._name = f"flexslew-{uuid4()}"
        try:
            self._client.register_plugin(StudyPlugin(job, self._name))
        except Exception as error:  # any error of the other machines
            self._client.close()
            raise BadInput(f"--dask: {address}: its workers cannot fly: {_line(error)}") from None
        self._running: dict[Any, tuple[list[Case], float]] = {}
        self._finished: SimpleQueue[Any] = SimpleQueue()
        self._chunks = Chunks(job.at_once)

    def fly(self, cases: Iterator[Case]) -> Iterator[list[FlightResult]]:
        """Yield the results of all cases; see Executor.

        Raises:
            RunFault: the scheduler is gone.
        """
        single_cases: deque[Case] = deque()  # from chunks that came to nothing
        while True:
            try:
                self._fill(single_cases, cases)
                if not self._running:
                    return
                ends = [started + self._limit * len(c) for c, started in self._running.values()]
                future = self._next_finished(max(min(ends) - monotonic(), 0.0))
                found = [self._collect(future, single_cases)] if future in self._running else []
                found.append(self._late_results(single_cases))
            except (OSError, CancelledError) as error:
                raise self._lost_cluster(_line(error)) from None
            except (RuntimeError, ValueError) as error:  # of a client that is just being closed
                if self._client.status == "running":
                    raise
                raise self._lost_cluster(_line(error)) from None
            yield from filter(None, found)

    def close(self) -> None:
        """Leave the cluster, which others may use."""
        if self._client.status == "running":
            with suppress(OSError, CancelledError, ValueError):  # it goes at this moment
                for future in self._running:
                    future.cancel(force=True)
                self._client.unregister_worker_plugin(self._name)
        self._client.close()

    def _fill(self, single_cases: deque[Case], cases: Iterator[Case]) -> None:
        """Give every thread a chunk, as long as there are any."""
        from flexslew_lab.studies.execution.cluster_worker import run_on_worker

        if self._client.status != "running":
            raise self._lost_cluster("the scheduler does not answer any more")
        threads = max(sum(self._client.nthreads().values()), 1)
        while len(self._running) < threads:
            chunk = [single_cases.popleft()] if single_cases else self._chunks.next(cases, threads)
            if not chunk:
                return
            future = self._client.submit(run_on_worker, self._name, chunk, pure=False)
            self._running[future] = chunk, monotonic()
            future.add_done_callback(self._finished.put)

    def _next_finished(self, patience: float) -> Any:
        """Return a future that has ended in any way; None after so many seconds."""
        try:
            return self._finished.get(timeout=patience)
        except Empty:
            return None

    def _collect(self, future: Any, single_cases: deque[Case]) -> list[FlightResult]:
        chunk, started = self._running.pop(future)
        try:
            results: list[FlightResult] = future.result()
        except CancelledError as error:
            raise self._lost_cluster(_line(error)) from None
        except Exception as error:  # any error on the other machines
            return _fail_or_split(chunk, single_cases, f"given up by the cluster: {_line(error)}")
        self._chunks.update_rate(len(chunk), monotonic() - started)
        return results

    def _late_results(self, single_cases: deque[Case]) -> list[FlightResult]:
        """Give up what takes too long; end the workers that are at it."""
        now, given_up = monotonic(), []
        late = {
            future: chunk
            for future, (chunk, started) in self._running.items()
            if now - started > self._limit * len(chunk)
        }
        busy = self._client.processing() if late else {}
        for future, chunk in late.items():
            stuck = [w for w, keys in busy.items() if any(future.key in str(k) for k in keys)]
            if not stuck:  # it is done, or no worker was there to begin it
                self._running[future] = chunk, now
                continue
            del self._running[future]
            future.cancel(force=True)
            with suppress(TimeoutError):  # it comes back, or others go on
                self._client.restart_workers(stuck, raise_for_error=False)
            given_up += _fail_or_split(chunk, single_cases, f"no end after {self._limit:g} s")
        return given_up

    def _lost_cluster(self, why: str) -> RunFault:
        return RunFault(
            f"{self._address}: the cluster is gone: {why}; results are kept; run the study again"
        )


def _fail_or_split(chunk: list[Case], single_cases: deque[Case], why: str) -> list[FlightResult]:
    if len(chunk) == 1:
        return [failed(chunk[0].number, why)]
    single_cases.extend(chunk)
    return []


def _line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
