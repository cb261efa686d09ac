"""When the next tick is due: as fast as possible, or paced by the wall clock."""

from math import inf

REPEAT_AFTER = 0.1  # an unanswered question is repeated [wall s]
LAST_CHANCE = 0.25  # paced, an answer that decides about the charge is waited for [wall s]
BEHIND = 0.05  # further behind its schedule a paced run starts a new one [wall s]


class Pacing:
    """The wall clock's side of a run, without a clock of its own.

    Paced, a tick is over when its time has come and it is answered; without an answer not before
    the question had its full period, and the last question before another controller takes over has
    a quarter of a second at least: a busy machine is not a dead controller. Time during which the
    plant itself did not read the clock (a process held up, a busy machine) does not count.
    A run that is too far behind starts a new schedule instead of catching up in a burst.

    Args:
        period: one tick [simulated s].
        rate_factor: simulated seconds per wall second; 0: as fast as possible.
        answer_timeout: silence that counts as missed ticks when not paced [wall s].
    """

    def __init__(self, period: float, rate_factor: float, answer_timeout: float) -> None:
        self._period, self._timeout = period, answer_timeout
        self._start, self._ticks = 0.0, 0
        self._asked = 0.0
        self._repeat = 0.0
        self._look_due = inf  # when the plant meant to look again
        self.late = 0.0  # by which the last look came too late [wall s]
        self.set_rate(rate_factor, 0.0)

    def set_rate(self, rate_factor: float, now: float) -> None:
        """Go on at another rate; the schedule begins with the question that is out."""
        self.rate_factor = rate_factor
        self.paced = rate_factor > 0.0
        self._interval = self._period / rate_factor if self.paced else inf
        self._allowed = self._interval  # for an answer [wall s]
        self._start, self._ticks = now, 1
        self._look_due = inf

    def start(self, now: float) -> None:
        """Count from now [wall s]: a pause is not caught up."""
        self._start, self._ticks = now, 0
        self._look_due = inf
        self.asked(now)

    def asked(self, now: float) -> None:
        """Note that a new question went out."""
        self._ticks += 1
        self._asked = now
        self._repeat = now + REPEAT_AFTER

    def look(self, now: float) -> float:
        """Note that the plant reads the clock; return by how much it is late [s]."""
        self.late = max(0.0, now - self._look_due)
        self._look_due = inf
        self._asked += self.late
        self._repeat += self.late
        return self.late

    def repeat_due(self, now: float) -> bool:
        """Return whether to ask the same question again, and wait for the next time."""
        due = now >= self._repeat
        if due:
            self._repeat = now + REPEAT_AFTER
        return due

    def tick_over(
        self, now: float, answered: bool, missed_in_a_row: int, last_chance: bool = False
    ) -> bool:
        """Return whether the bench must advance now.

        Args:
            now: wall clock [s].
            answered: a valid answer is held.
            missed_in_a_row: ticks; after a miss the plant waits a shorter time than the timeout.
            last_chance: another controller takes over if this question has no answer.
        """
        self._allowed = max(self._interval, LAST_CHANCE * last_chance)
        if self.paced:
            return now >= (self._due if answered else max(self._due, self._asked + self._allowed))
        return answered or now - self._asked >= (REPEAT_AFTER if missed_in_a_row else self._timeout)

    def fall_behind(self, now: float) -> float:
        """Return by how much a new schedule begins later than the old one [s]; 0: the old holds."""
        behind = now - self._due if self.paced else 0.0
        if behind <= max(BEHIND, self._interval):
            return 0.0
        self._start += behind
        return behind

    def wait(self, now: float) -> float:
        """Return the wall seconds until one of the above can change by itself."""
        over = self._due if now < self._due else self._asked + self._allowed
        self._look_due = max(now, min(over, self._repeat, self._asked + self._timeout))
        return self._look_due - now

    @property
    def _due(self) -> float:
        return self._start + self._ticks * self._interval if self.paced else inf
