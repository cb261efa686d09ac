"""Processes on this machine that do numbered cases of a job, a chunk at a time.

The dead are replaced, the hung are ended. Every process has a pipe of its own, so one that dies at
any moment harms no other. A result does not depend on its process or on its chunk.
"""

import multiprocessing
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import islice
from multiprocessing.connection import Connection, wait
from operator import length_hint
from time import monotonic
from types import ModuleType
from typing import Any, Generic, Protocol, TypeVar

from flexslew_plant.errors import RunFault

CHUNK_TIME = 3.0  # of a chunk, aimed at [wall s]
_LEAST_TIME = 0.05  # of a chunk, where there are enough cases for all [wall s]
_CHUNKS_PER_WORKER = 2  # that each worker gets of the cases left, at least
_LARGEST = 4096  # cases of a chunk
_MAX_RATIO = 4  # of a chunk over the one before, at most
_MAX_FAILURES = 2  # with a chunk, before it is split to find out which case it is
_LAST_WORDS = 1.0  # patience with a process that has closed its pipe and not yet ended [wall s]
_READY = -1  # first message of a process
_START = 120.0  # limit for the first message of a process [wall s]
_STARTING = threading.Lock()  # of processes, one after the other: others may have threads
_SERVER = multiprocessing.get_context("forkserver")  # has imported everything once, for all


class HasNumber(Protocol):
    """A case, or its result."""

    @property
    def number(self) -> int:
        """Of the case, unlike any other's."""


_Case = TypeVar("_Case", bound=HasNumber)
_Given = TypeVar("_Given", bound=HasNumber, contravariant=True)
_Result = TypeVar("_Result", bound=HasNumber)


class CaseRunner(Protocol[_Given, _Result]):
    """Does cases of a job, in any process."""

    def fly(
        self,
        cases: Sequence[_Given],
        report: Callable[[list[_Result]], None],
        begin: Callable[[int], None] = lambda number: None,
    ) -> None:
        """Do the cases.

        Args:
            cases: cases of the job.
            report: gets the results as they come, in any order.
            begin: called with the number of a case before it is done alone.
        """


class PooledJob(Protocol[_Given, _Result]):
    """All that a process must know to do any case; it goes from process to process."""

    @property
    def limit(self) -> float:
        """The longest that a case may take [wall s]."""

    @property
    def at_once(self) -> int:
        """How many cases are done as fast as one."""

    def flyer(self) -> CaseRunner[_Given, _Result]:
        """Return what does its cases; called once in every process."""

    def failed(self, number: int, reason: str) -> _Result:
        """Return the result of a case that came to nothing."""


class Executor(Protocol[_Given, _Result]):
    """Something that does the cases of a job."""

    def fly(self, cases: Iterator[_Given]) -> Iterator[list[_Result]]:
        """Yield the results of all cases as they come, each once."""

    def close(self) -> None:
        """End the processes."""


class InThisProcess(Generic[_Case, _Result]):
    """Implements Executor in this process, one case after the other."""

    def __init__(self, job: PooledJob[_Case, _Result]) -> None:
        self._runner, self._at_once = job.flyer(), job.at_once

    def fly(self, cases: Iterator[_Case]) -> Iterator[list[_Result]]:
        """Yield the results of all cases; see Executor."""
        chunks = Chunks(self._at_once)
        while chunk := chunks.next(cases):
            started = monotonic()
            results: list[_Result] = []
            self._runner.fly(chunk, results.extend)
            chunks.update_rate(len(chunk), monotonic() - started)
            yield results

    def close(self) -> None:
        """Nothing to end."""


class Chunks:
    """Chunks of some seconds; how many cases that is, it learns on the way.

    Args:
        at_once: how many cases are done as fast as one.
    """

    def __init__(self, at_once: int = 1) -> None:
        self._size, self._at_once = 1, at_once
        self._rate = 0.0  # of the last chunk [cases / s]

    def next(self, cases: Iterator[_Case], workers: int = 1) -> list[_Case]:
        """Return the next chunk; empty at the end.

        Towards the end of the cases, if their number is known, chunks become smaller: no worker
        shall wait for the last one of another.
        """
        size = self._size
        if workers > 1:
            share = length_hint(cases, sys.maxsize) // (_CHUNKS_PER_WORKER * workers)
            size = max(
                1, min(size, self._complete_count(max(share, int(self._rate * _LEAST_TIME))))
            )
        return list(islice(cases, size))

    def update_rate(self, count: int, seconds: float) -> None:
        """Learn from a chunk that was flown in so much wall time."""
        self._rate = count / max(seconds, 1e-9)
        if count < self._size:  # a rest of another one
            return
        target_size = int(self._rate * CHUNK_TIME)
        self._size = max(
            1, self._complete_count(min(target_size, _MAX_RATIO * self._size, _LARGEST))
        )

    def _complete_count(self, cases: int) -> int:
        """Return as many cases, or as many of them as are done at once."""
        return cases - cases % self._at_once if cases > self._at_once else cases


class _Chunk(deque[_Case]):
    """Cases that have no result yet."""

    failures = 0  # of processes that flew it


@dataclass
class _Worker(Generic[_Case]):
    """One process and what it is at."""

    process: multiprocessing.process.BaseProcess
    pipe: Connection
    chunk: _Chunk[_Case] = field(default_factory=_Chunk)
    now: int | None = None  # number of the case that is done alone
    ready: bool = False  # its first message has come
    received: float = 0.0  # time of its last message [wall s]
    patience: float = _START  # with its silence [wall s]
    started: float = 0.0  # the chunk [wall s]
    size: int = 0  # of the chunk at its start


class Pool(Generic[_Case, _Result]):
    """Implements Executor with processes.

    Args:
        job: what they do.
        workers: how many.
    """

    def __init__(self, job: PooledJob[_Case, _Result], workers: int) -> None:
        self._job, self._count = job, workers
        self._workers: list[_Worker[_Case]] = []
        self._queue: deque[_Chunk[_Case]] = deque()
        self._chunks = Chunks(job.at_once)
        self._failed_starts = 0  # processes that ended before they were ready, one after the other
        _SERVER.set_forkserver_preload([type(job).__module__])

    def fly(self, cases: Iterator[_Case]) -> Iterator[list[_Result]]:
        """Yield the results of all cases; see Executor.

        Raises:
            RunFault: processes end before they are ready, which is no fault of a case.
        """
        while True:
            self._fill(cases)
            busy = [worker for worker in self._workers if worker.chunk]
            if not busy:
                return
            patience = min(worker.received + worker.patience for worker in busy) - monotonic()
            ready = wait([worker.pipe for worker in busy], timeout=max(patience, 0.0))
            for worker in busy:
                if worker.pipe in ready:
                    results = self._receive(worker)
                elif monotonic() - worker.received > worker.patience:
                    results = self._stop_late(worker)
                else:
                    continue
                if results:
                    yield results

    def close(self) -> None:
        """End the processes, in any state."""
        for worker in self._workers:
            self._end(worker)
        self._workers.clear()

    def pids(self) -> list[int]:
        """Return the process numbers of the workers."""
        return [worker.process.pid or 0 for worker in self._workers]

    def _fill(self, cases: Iterator[_Case]) -> None:
        """Give every idle process a chunk, as long as there are any."""
        idle = [worker for worker in self._workers if not worker.chunk]
        while idle or len(self._workers) < self._count:
            if self._queue:
                chunk = self._queue.popleft()
            else:
                chunk = _Chunk[_Case](self._chunks.next(cases, self._count))
            if not chunk:
                return
            worker = idle.pop() if idle else self._start()
            worker.chunk, worker.now, worker.size = chunk, None, len(chunk)
            worker.started = worker.received = monotonic()
            with suppress(OSError):  # it is dead: its pipe will report it
                worker.pipe.send(list(chunk))

    def _start(self) -> _Worker[_Case]:
        parent_end, child_end = _SERVER.Pipe()
        process = _SERVER.Process(target=_work, args=(child_end, self._job), daemon=True)
        with _without_script():
            process.start()
        child_end.close()
        self._workers.append(_Worker[_Case](process, parent_end))
        return self._workers[-1]

    def _receive(self, worker: _Worker[_Case]) -> list[_Result]:
        try:
            message = worker.pipe.recv()
        except (EOFError, OSError):
            return self._replace(worker)
        worker.received, worker.patience = monotonic(), self._job.limit
        if isinstance(message, int):
            worker.now = message if message != _READY else None
            worker.ready, self._failed_starts = True, 0
            return []
        worker.now = None
        done = {result.number for result in message}
        left = [case for case in worker.chunk if case.number not in done]
        worker.chunk.clear()
        worker.chunk.extend(left)
        if not left:
            self._chunks.update_rate(worker.size, worker.received - worker.started)
        return list(message)

    def _replace(self, worker: _Worker[_Case]) -> list[_Result]:
        """Put what a dead process was at back into the queue; give up a case that kills twice."""
        worker.process.join(_LAST_WORDS)
        self._end(worker)
        self._workers.remove(worker)
        code = worker.process.exitcode
        if not worker.ready:
            return self._return_chunk(worker, f"ended ({_cause(code)})")
        lost, rest = self._remaining_cases(worker)
        if rest:
            self._queue.append(rest)
        lost.failures += 1
        if lost.failures < _MAX_FAILURES:
            self._queue.append(lost)
            return []
        if len(lost) == 1:
            why = f"its process died {_MAX_FAILURES} times ({_cause(code)})"
            return [self._job.failed(lost[0].number, why)]
        self._split(lost)
        return []

    def _stop_late(self, worker: _Worker[_Case]) -> list[_Result]:
        self._end(worker)
        self._workers.remove(worker)
        if not worker.ready:
            return self._return_chunk(worker, f"were not ready after {_START:g} s")
        lost, rest = self._remaining_cases(worker)
        if rest:
            self._queue.append(rest)
        if len(lost) == 1:
            return [self._job.failed(lost[0].number, f"no end after {self._job.limit:g} s")]
        self._split(lost)
        return []

    def _return_chunk(self, worker: _Worker[_Case], why: str) -> list[_Result]:
        """Put the whole chunk of a process back into the queue: it has not started.

        Raises:
            RunFault: if the same has happened to others before it.
        """
        self._queue.append(worker.chunk)
        self._failed_starts += 1
        if self._failed_starts > _MAX_FAILURES * self._count:
            words = (
                f"{self._failed_starts} processes, one after the other, {why} before their first "
                "case"
            )
            raise RunFault(words)
        return []

    def _remaining_cases(self, worker: _Worker[_Case]) -> tuple[_Chunk[_Case], _Chunk[_Case]]:
        """Return what the process was at when it ended, and the rest of its chunk."""
        lost, rest = _Chunk[_Case](), _Chunk[_Case]()
        for case in worker.chunk:
            (lost if worker.now in (None, case.number) else rest).append(case)
        lost.failures = worker.chunk.failures
        return lost, rest

    def _split(self, chunk: _Chunk[_Case]) -> None:
        half = len(chunk) // 2
        for part in (list(chunk)[:half], list(chunk)[half:]):
            half_chunk = _Chunk[_Case](part)
            half_chunk.failures = _MAX_FAILURES - 1
            self._queue.append(half_chunk)

    def _end(self, worker: _Worker[_Case]) -> None:
        worker.process.kill()
        worker.process.join()
        worker.pipe.close()


@contextmanager
def _without_script() -> Iterator[None]:
    """Start processes that do not run the caller's script: they need nothing of it.

    Python would run it again in each of them, up to the call that starts them, which then fails.
    """
    with _STARTING:
        script = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            yield
        finally:
            sys.modules["__main__"] = script


def _work(pipe: Connection, job: PooledJob[Any, Any]) -> None:
    """Do what comes through the pipe until it is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent process
    runner = job.flyer()
    with suppress(EOFError, OSError):  # the parent process is gone
        pipe.send(_READY)
        while True:
            runner.fly(pipe.recv(), pipe.send, pipe.send)


def _cause(code: int | None) -> str:
    if code is not None and code < 0:
        return signal.Signals(-code).name
    return f"exit code {code}"
