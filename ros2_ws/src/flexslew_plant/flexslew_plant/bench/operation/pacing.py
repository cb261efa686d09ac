"""When the next tick is due: as fast as possible, or paced by the wall clock."""

from math import inf

REPEAT_AFTER = 0.1  # an unanswered question is repeated [wall s]
FINAL_TIMEOUT = 0.25  # paced, an answer that decides about the charge is waited for [wall s]
_ROUNDING = 1e-6  # of sums of times, which must not keep a tick from its end [wall s]
MAX_DELAY = 0.05  # further behind its schedule a paced run starts a new one [wall s]


class TickTimer:
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
        self._question_time = 0.0
        self._repeat = 0.0
        self._next_check = inf  # when the plant meant to look again
        self.late = 0.0  # by which the last look came too late [wall s]
        self._by_plant = self._question_is_new = False
        self.set_rate(rate_factor, 0.0)

    def set_rate(self, rate_factor: float, now: float) -> None:
        """Go on at another rate; the schedule begins with the question that is out."""
        self.rate_factor = rate_factor
        self.paced = rate_factor > 0.0
        self._interval = self._period / rate_factor if self.paced else inf
        self._allowed = self._interval  # for an answer [wall s]
        self._start, self._ticks = now, 1
        self._next_check = inf

    def follow_plant(self) -> None:
        """Leave the pace to the clock of the plant: from tick 1 on an answer is due in a period."""
        self.set_rate(0.0, 0.0)
        self._by_plant, self.rate_factor = True, 1.0

    @property
    def real_time(self) -> bool:
        """Whether the wall clock, or the plant's, does not wait for an answer."""
        return self.paced or self._by_plant

    def start(self, now: float) -> None:
        """Count from now [wall s]: a pause is not caught up."""
        self._start, self._ticks = now, 0
        self._next_check = inf
        self.request(now)

    def request(self, now: float) -> None:
        """Note that a new question went out.

        With the plant's own clock it may have waited for the plant since it read the wall clock:
        then the time of the question is that of the next look.
        """
        self._question_is_new = self._by_plant
        self._ticks += 1
        self._question_time = now
        self._repeat = now + REPEAT_AFTER

    def look(self, now: float) -> float:
        """Note that the plant reads the clock; return by how much it is late [s]."""
        self.late = max(0.0, now - self._next_check)
        self._next_check = inf
        if self._question_is_new:
            self._question_is_new = False
            self._question_time, self._repeat = now, now + REPEAT_AFTER
            return self.late
        self._question_time += self.late
        self._repeat += self.late
        return self.late

    def check_repeat(self, now: float) -> bool:
        """Return whether to ask the same question again, and wait for the next time."""
        expired = now >= self._repeat
        if expired:
            self._repeat = now + REPEAT_AFTER
        return expired

    def tick_over(
        self, now: float, has_answer: bool, missing_ticks: int, is_final: bool = False
    ) -> bool:
        """Return whether the bench must advance now.

        Args:
            now: wall clock [s].
            has_answer: a valid answer is held.
            missing_ticks: ticks; after a miss the plant waits a shorter time than the timeout.
            is_final: another controller takes over if this question has no answer.
        """
        self._allowed = max(self._interval, FINAL_TIMEOUT * is_final)
        if self.paced:
            return now >= (
                self._deadline
                if has_answer
                else max(self._deadline, self._question_time + self._allowed - _ROUNDING)
            )
        patience = self._patience
        return has_answer or now - self._question_time >= (
            (min(REPEAT_AFTER, patience) if missing_ticks else patience) - _ROUNDING
        )

    def shift_schedule(self, now: float) -> float:
        """Return by how much a new schedule begins later than the old one [s]; 0: the old holds."""
        delay = now - self._deadline if self.paced else 0.0
        if delay <= max(MAX_DELAY, self._interval):
            return 0.0
        self._start += delay
        return delay

    def wait(self, now: float, has_answer: bool) -> float:
        """Return the wall seconds until one of the above can change by itself."""
        over = self._deadline if now < self._deadline else self._question_time + self._allowed
        if not has_answer:
            over = min(over, self._repeat, self._question_time + self._patience)
        self._next_check = max(now, over)
        return self._next_check - now

    @property
    def _patience(self) -> float:
        """Silence that counts as a missed tick without a deadline [wall s]."""
        return self._period if self._by_plant and self._ticks > 1 else self._timeout

    @property
    def _deadline(self) -> float:
        return self._start + self._ticks * self._interval if self.paced else inf
