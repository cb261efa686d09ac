"""When the next tick is due: as fast as it goes, or paced by the wall clock."""

from math import inf

REPEAT_AFTER = 0.1  # an unanswered question is asked again [wall s]


class Pacing:
    """The wall clock's side of a run, without a clock of its own.

    Args:
        period: one tick [simulated s].
        rate_factor: simulated seconds per wall second; 0: as fast as it goes.
        answer_timeout: silence that counts as missed ticks when not paced [wall s].
    """

    def __init__(self, period: float, rate_factor: float, answer_timeout: float) -> None:
        self.paced = rate_factor > 0.0
        self._interval = period / rate_factor if self.paced else inf
        self._timeout = answer_timeout
        self._start, self._ticks = 0.0, 0
        self._asked = 0.0
        self._repeat = 0.0

    def start(self, now: float) -> None:
        """Count from now [wall s]: a pause is not caught up."""
        self._start, self._ticks = now, 0
        self.asked(now)

    def asked(self, now: float) -> None:
        """Note that a new question went out."""
        self._ticks += 1
        self._asked = now
        self._repeat = now + REPEAT_AFTER

    def repeat_due(self, now: float) -> bool:
        """Return whether to ask the same question again, and wait for the next time."""
        due = now >= self._repeat
        if due:
            self._repeat = now + REPEAT_AFTER
        return due

    def tick_over(self, now: float, answered: bool, missed_in_a_row: int) -> bool:
        """Return whether the bench must advance now.

        Args:
            now: wall clock [s].
            answered: a valid answer is held.
            missed_in_a_row: ticks; nobody is waited for twice as long as the timeout.
        """
        if self.paced:
            return now >= self._start + self._ticks * self._interval
        return answered or now - self._asked >= (REPEAT_AFTER if missed_in_a_row else self._timeout)

    def wait(self, now: float) -> float:
        """Return the wall seconds until one of the above can change by itself."""
        due = self._start + self._ticks * self._interval if self.paced else inf
        return max(0.0, min(due, self._repeat, self._asked + self._timeout) - now)
