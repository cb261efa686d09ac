"""Processes on this machine that fly chunks: the dead are replaced, the hung are ended.

Every process has a pipe of its own, so one that dies at any moment harms no other. A result does
not depend on who flew it or in which chunk.
"""

import multiprocessing
import signal
import sys
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import islice
from multiprocessing.connection import Connection, wait
from operator import length_hint
from time import monotonic
from typing import Protocol

from flexslew_lab.studies.cases import Case
from flexslew_lab.studies.execution.worker import Flyer, Job
from flexslew_lab.studies.flight import Flown, failed
from flexslew_plant.testbeds.compiled.lanes import LANES

CHUNK_TIME = 3.0  # of a chunk, aimed at [wall s]
_LEAST_TIME = 0.05  # of a chunk, where there are enough trials for all [wall s]
_SHARES = 2  # that each worker gets of the cases left, at least
_LARGEST = 4096  # trials of a chunk
_GROWTH = 4  # of a chunk over the one before, at most
_DEATHS = 2  # with a chunk, before it is split to find out which trial it is
_READY = -1  # what a process says first
_START = 120.0  # that a process may take before it says so [wall s]
_SERVER = multiprocessing.get_context("forkserver")  # has imported everything once, for all
_SERVER.set_forkserver_preload(["flexslew_lab.studies.execution.worker"])


class Executor(Protocol):
    """Something that flies trials."""

    def fly(self, cases: Iterator[Case]) -> Iterator[list[Flown]]:
        """Yield the results of all cases as they come, each trial once."""

    def close(self) -> None:
        """End the processes."""


class InThisProcess:
    """Implements Executor in this process, one trial after the other."""

    def __init__(self, job: Job) -> None:
        self._flyer = Flyer(job)

    def fly(self, cases: Iterator[Case]) -> Iterator[list[Flown]]:
        """Yield the results of all cases; see Executor."""
        chunks = Chunks()
        while chunk := chunks.next(cases):
            started = monotonic()
            results: list[Flown] = []
            self._flyer.fly(chunk, results.extend)
            chunks.learn(len(chunk), monotonic() - started)
            yield results

    def close(self) -> None:
        """Nothing to end."""


class Chunks:
    """Chunks of some seconds; how many trials that is, it learns on the way."""

    def __init__(self) -> None:
        self._size = 1
        self._rate = 0.0  # of the last chunk [trials / s]

    def next(self, cases: Iterator[Case], workers: int = 1) -> list[Case]:
        """Return the next chunk; empty at the end.

        Towards the end of the cases, if they say how many are left, chunks become smaller: no
        worker shall wait for the last one of another.
        """
        size = self._size
        if workers > 1:
            share = length_hint(cases, sys.maxsize) // (_SHARES * workers)
            size = max(1, min(size, _whole_lanes(max(share, int(self._rate * _LEAST_TIME)))))
        return list(islice(cases, size))

    def learn(self, count: int, seconds: float) -> None:
        """Learn from a chunk that was flown in so much wall time."""
        self._rate = count / max(seconds, 1e-9)
        if count < self._size:  # a rest of another one
            return
        aim = int(self._rate * CHUNK_TIME)
        self._size = max(1, _whole_lanes(min(aim, _GROWTH * self._size, _LARGEST)))


def _whole_lanes(trials: int) -> int:
    """Return as many trials, or as many of them as fill their lanes."""
    return trials - trials % LANES if trials > LANES else trials


class _Chunk(deque[Case]):
    """Cases that have no result yet."""

    deaths = 0  # of processes that flew it


@dataclass
class _Worker:
    """One process and what it is at."""

    process: multiprocessing.process.BaseProcess
    pipe: Connection
    chunk: _Chunk = field(default_factory=_Chunk)
    now: int | None = None  # number of the trial that is flown alone
    heard: float = 0.0  # when something came from it last [wall s]
    patience: float = _START  # with its silence [wall s]
    started: float = 0.0  # the chunk [wall s]
    size: int = 0  # of the chunk at its start


class Pool:
    """Implements Executor with processes.

    Args:
        job: what they fly.
        workers: how many.
    """

    def __init__(self, job: Job, workers: int) -> None:
        self._job, self._count = job, workers
        self._limit = job.study.settings.limit
        self._workers: list[_Worker] = []
        self._again: deque[_Chunk] = deque()
        self._chunks = Chunks()

    def fly(self, cases: Iterator[Case]) -> Iterator[list[Flown]]:
        """Yield the results of all cases; see Executor."""
        while True:
            self._fill(cases)
            busy = [worker for worker in self._workers if worker.chunk]
            if not busy:
                return
            patience = min(worker.heard + worker.patience for worker in busy) - monotonic()
            ready = wait([worker.pipe for worker in busy], timeout=max(patience, 0.0))
            for worker in busy:
                if worker.pipe in ready:
                    results = self._hear(worker)
                elif monotonic() - worker.heard > worker.patience:
                    results = self._end_hung(worker)
                else:
                    continue
                if results:
                    yield results

    def close(self) -> None:
        """End the processes, in whatever they are at."""
        for worker in self._workers:
            self._end(worker)
        self._workers.clear()

    def pids(self) -> list[int]:
        """Return the process numbers of the workers."""
        return [worker.process.pid or 0 for worker in self._workers]

    def _fill(self, cases: Iterator[Case]) -> None:
        """Give every idle process a chunk, as long as there are any."""
        idle = [worker for worker in self._workers if not worker.chunk]
        while idle or len(self._workers) < self._count:
            if self._again:
                chunk = self._again.popleft()
            else:
                chunk = _Chunk(self._chunks.next(cases, self._count))
            if not chunk:
                return
            worker = idle.pop() if idle else self._start()
            worker.chunk, worker.now, worker.size = chunk, None, len(chunk)
            worker.started = worker.heard = monotonic()
            with suppress(OSError):  # it is dead: its pipe will say so
                worker.pipe.send(list(chunk))

    def _start(self) -> _Worker:
        ours, theirs = _SERVER.Pipe()
        process = _SERVER.Process(target=_work, args=(theirs, self._job), daemon=True)
        process.start()
        theirs.close()
        self._workers.append(_Worker(process, ours))
        return self._workers[-1]

    def _hear(self, worker: _Worker) -> list[Flown]:
        try:
            message = worker.pipe.recv()
        except (EOFError, OSError):
            return self._replace(worker)
        worker.heard, worker.patience = monotonic(), self._limit
        if isinstance(message, int):
            worker.now = message if message != _READY else None
            return []
        worker.now = None
        done = {result.number for result in message}
        left = [case for case in worker.chunk if case.number not in done]
        worker.chunk.clear()
        worker.chunk.extend(left)
        if not left:
            self._chunks.learn(worker.size, worker.heard - worker.started)
        return list(message)

    def _replace(self, worker: _Worker) -> list[Flown]:
        """Put what a dead process was at back into the queue; give up a trial that kills twice."""
        self._end(worker)
        self._workers.remove(worker)
        code = worker.process.exitcode
        lost, rest = self._culprits(worker)
        if rest:
            self._again.append(rest)
        lost.deaths += 1
        if lost.deaths < _DEATHS:
            self._again.append(lost)
            return []
        if len(lost) == 1:
            return [failed(lost[0].number, f"its process died {_DEATHS} times ({_cause(code)})")]
        self._split(lost)
        return []

    def _end_hung(self, worker: _Worker) -> list[Flown]:
        self._end(worker)
        self._workers.remove(worker)
        lost, rest = self._culprits(worker)
        if rest:
            self._again.append(rest)
        if len(lost) == 1:
            return [failed(lost[0].number, f"no end after {self._limit:g} s")]
        self._split(lost)
        return []

    def _culprits(self, worker: _Worker) -> tuple[_Chunk, _Chunk]:
        """Return what the process was flying when it ended, and the rest of its chunk."""
        lost, rest = _Chunk(), _Chunk()
        for case in worker.chunk:
            (lost if worker.now in (None, case.number) else rest).append(case)
        lost.deaths = worker.chunk.deaths
        return lost, rest

    def _split(self, chunk: _Chunk) -> None:
        half = len(chunk) // 2
        for part in (list(chunk)[:half], list(chunk)[half:]):
            smaller = _Chunk(part)
            smaller.deaths = _DEATHS - 1
            self._again.append(smaller)

    def _end(self, worker: _Worker) -> None:
        worker.process.kill()
        worker.process.join()
        worker.pipe.close()


def _work(pipe: Connection, job: Job) -> None:
    """Fly what comes through the pipe until it is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the one who gives out chunks
    flyer = Flyer(job)
    with suppress(EOFError, OSError):  # whoever gave out chunks is gone
        pipe.send(_READY)
        while True:
            flyer.fly(pipe.recv(), pipe.send, pipe.send)


def _cause(code: int | None) -> str:
    if code is not None and code < 0:
        return signal.Signals(-code).name
    return f"exit code {code}"
