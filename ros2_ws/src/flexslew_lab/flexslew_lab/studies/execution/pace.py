"""How long a study will take yet, from the pace of its results."""

from bisect import bisect_left

_MIN_COUNT = 6  # after the first, before an estimate
_MAX_RATIO = 1.4  # ratio of the paces of two stretches that count as one pace
_MIN_TIME = 5.0  # from the first report on [wall s]
_STARTS = 0.5  # of the time before it, by which other processes may have started later [-]


class RemainingTime:
    """Estimates the time left; returns None before the pace is known.

    What comes before the first result (processes that start, machine code that is compiled) does
    not count; as other processes may start later, half of it is waited for. The time since then
    is halved: only where trials come about as fast in both halves is there one pace, that of the
    later half. Chunks grow at first, and so does the pace; until it stays, nothing is known.
    """

    def __init__(self) -> None:
        self._times: list[float] = []  # of the reports [wall s]
        self._done: list[int] = []  # trials by then
        self._before: int | None = None  # trials that were there already
        self._start_time = 0.0  # [wall s]

    def take(self, done: int, now: float) -> None:
        """Take a report.

        Args:
            done: trials, those of earlier runs too.
            now: [wall s].
        """
        if self._before is None:
            self._before, self._start_time = done, now
        elif done > self._before:
            self._times.append(now)
            self._done.append(done)

    def left(self, requested: int) -> float | None:
        """Return the wall seconds until all trials that are requested are done; None: unknown."""
        if self._done and self._done[-1] >= requested:
            return 0.0
        if len(self._times) <= _MIN_COUNT:
            return None
        first, last = self._times[0], self._times[-1]
        if last - first < max(_MIN_TIME, _STARTS * (first - self._start_time)):
            return None
        middle = bisect_left(self._times, 0.5 * (first + last))
        first_rate, late = self._rate(0, middle), self._rate(middle, len(self._times) - 1)
        if not (
            first_rate > 0.0 and late > 0.0 and 1.0 / _MAX_RATIO < late / first_rate < _MAX_RATIO
        ):
            return None
        return (requested - self._done[-1]) / late

    def _rate(self, begin: int, end: int) -> float:
        """Return trials per second between two reports; 0: there is no time between them."""
        seconds = self._times[end] - self._times[begin]
        return (self._done[end] - self._done[begin]) / seconds if seconds > 0.0 else 0.0
