"""Fly on a Dask cluster by the address of its scheduler."""

from collections import deque
from collections.abc import Iterator
from time import monotonic
from typing import Any

from flexslew_lab.studies.cases import Case
from flexslew_lab.studies.flight import Flown, failed
from flexslew_lab.studies.pool import Pace
from flexslew_lab.studies.worker import Flyer, Job
from flexslew_plant.errors import BadInput

_CONNECT = 10.0  # patience with the scheduler [wall s]


class Cluster:
    """Fulfils Executor with the workers of a cluster, one chunk for each of their threads.

    A worker that dies loses its chunk; Dask gives it to another one. A chunk that Dask gives up,
    or that takes longer than all its trials may, is flown one by one; a trial that then fails
    again has failed.

    Args:
        job: what is flown.
        address: of the scheduler, such as tcp://127.0.0.1:8786.

    Raises:
        BadInput: nobody answers there.
    """

    def __init__(self, job: Job, address: str) -> None:
        import distributed

        try:
            self._client: Any = distributed.Client(address, timeout=_CONNECT, set_as_default=False)
        except (OSError, ValueError) as error:
            raise BadInput(f"--dask: {address}: no scheduler answers: {error}") from None
        self._limit = job.study.settings.limit
        self._job = self._client.scatter(job, broadcast=True, hash=False)
        self._running: dict[Any, tuple[list[Case], float]] = {}
        self._pace = Pace()

    def fly(self, cases: Iterator[Case]) -> Iterator[list[Flown]]:
        """Yield the results of all cases; see Executor."""
        from distributed import FIRST_COMPLETED, wait

        alone: deque[Case] = deque()  # from chunks that came to nothing
        while True:
            while len(self._running) < max(sum(self._client.nthreads().values()), 1):
                chunk = [alone.popleft()] if alone else self._pace.chunk(cases)
                if not chunk:
                    break
                self._submit(chunk)
            if not self._running:
                return
            ends = [started + self._limit * len(c) for c, started in self._running.values()]
            try:
                patience = max(min(ends) - monotonic(), 0.0)
                done = wait(list(self._running), patience, return_when=FIRST_COMPLETED).done
            except TimeoutError:
                done = set()
            for future in done:
                yield from self._taken(future, alone)
            yield from self._overdue(alone)

    def close(self) -> None:
        """Leave the cluster, which others may use."""
        for future in self._running:
            future.cancel(force=True)
        self._client.close()

    def _submit(self, chunk: list[Case]) -> None:
        future = self._client.submit(_fly, self._job, chunk, pure=False)
        self._running[future] = chunk, monotonic()

    def _taken(self, future: Any, alone: deque[Case]) -> Iterator[list[Flown]]:
        chunk, started = self._running.pop(future)
        if future.status == "finished":
            self._pace.took(len(chunk), monotonic() - started)
            yield future.result()
        else:
            yield from self._given_up(chunk, alone, f"given up by the cluster: {_why(future)}")

    def _overdue(self, alone: deque[Case]) -> Iterator[list[Flown]]:
        now = monotonic()
        for future, (chunk, started) in list(self._running.items()):
            if now - started <= self._limit * len(chunk):
                continue
            del self._running[future]
            places = self._client.who_has([future]) or {}
            busy = self._client.processing()
            stuck = [w for w, keys in busy.items() if any(future.key in str(k) for k in keys)]
            future.cancel(force=True)
            if stuck and not any(places.values()):
                self._client.restart_workers(stuck, raise_for_error=False)
            yield from self._given_up(chunk, alone, f"no end after {self._limit:g} s")

    def _given_up(self, chunk: list[Case], alone: deque[Case], why: str) -> Iterator[list[Flown]]:
        if len(chunk) == 1:
            yield [failed(chunk[0].number, why)]
        else:
            alone.extend(chunk)


def _fly(job: Job, chunk: list[Case]) -> list[Flown]:
    """Return the results of a chunk; runs on a worker of the cluster."""
    results: list[Flown] = []
    Flyer(job).fly(chunk, results.extend)
    return results


def _why(future: Any) -> str:
    return " ".join(str(future.exception() or future.status).split())
