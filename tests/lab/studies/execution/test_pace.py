"""The time left of a study is right within a factor of two from its first print on."""

import heapq

import numpy as np
import pytest

from flexslew_lab.run.pool import CHUNK_TIME, Chunks
from flexslew_lab.studies.cases import Case
from flexslew_lab.studies.execution.pace import RemainingTime


def reports(
    rng: np.random.Generator, trials: int, workers: int, cost: float, overhead: float, start: float
) -> list[tuple[float, int]]:
    """Return when how many trials are done, by processes that fly chunks as the pool's do.

    Args:
        rng: of the trials' costs.
        trials: of the study.
        workers: processes.
        cost: of a trial, mean [s].
        overhead: of a chunk [s].
        start: of a process, with what it compiles [s].
    """
    chunks, numbers, done = Chunks(), iter([Case(0, 0, 0, 0, ())] * trials), 0
    found = []
    free = [(0.0, 0.0, 0, k) for k in range(workers)]  # when free, since when, trials, who
    heapq.heapify(free)
    while free:
        now, since, count, k = heapq.heappop(free)
        if count:
            chunks.update_rate(count, now - since)
            done += count
            found.append((now, done))
        chunk = chunks.next(numbers, workers)
        if chunk:
            takes = overhead + cost * float(rng.gamma(4.0, 0.25, len(chunk)).sum())
            takes += start * rng.uniform(0.7, 1.0) if now == 0.0 else 0.0
            heapq.heappush(free, (now + takes, now, len(chunk), k))
    return found


@pytest.mark.parametrize(
    ("trials", "workers", "cost", "overhead", "start"),
    [
        (400, 1, 0.5, 0.0, 45.0),
        (400, 2, 0.5, 0.1, 45.0),
        (200_000, 2, 0.001, 0.02, 60.0),
        (2_000, 4, 2.0, 0.0, 20.0),
        (60, 2, 20.0, 0.0, 60.0),
        (1_000_000, 8, 0.002, 0.05, 30.0),
    ],
)
@pytest.mark.parametrize("seed", range(5))
def test_every_estimate_is_within_a_factor_of_two(
    trials: int, workers: int, cost: float, overhead: float, start: float, seed: int
) -> None:
    rng = np.random.default_rng([8, seed])
    found = reports(rng, trials, workers, cost, overhead, start)
    end, pace, said = found[-1][0], RemainingTime(), []
    pace.take(0, 0.0)
    for now, done in found:
        pace.take(done, now)
        left = pace.left(trials)
        under_way = 3.0 * max(CHUNK_TIME, cost)  # the last chunks are not one pace
        if left is not None and end - now > under_way:
            said.append((now, left / (end - now)))
    assert said, "never said"
    worst = max(said, key=lambda one: abs(np.log(one[1])))
    assert 0.5 < worst[1] < 2.0, (worst, said[0], end, found[0])
    flying = found[0][0]
    assert said[0][0] < flying + 0.6 * (end - flying)


def test_nothing_is_said_before_there_is_a_pace() -> None:
    pace = RemainingTime()
    pace.take(100, 0.0)  # of an earlier run
    assert pace.left(1000) is None
    for k in range(25):
        pace.take(110 + 10 * k, 50.0 + k)  # half of the start is waited for
        assert pace.left(1000) is None
    pace.take(360, 75.0)
    assert pace.left(1000) == pytest.approx(64.0)
    pace.take(1000, 80.0)
    assert pace.left(1000) == 0.0
