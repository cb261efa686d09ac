"""Whether the bench waits, runs, rests or is done, and which requests it accepts then."""

from flexslew_plant.counted import count_text
from flexslew_plant.refusal import Cause, Refusal, Reply

WAITING, RUNNING, PAUSED, FINISHED = "waiting", "running", "paused", "finished"
_OVER = "the run is over; call reset first"


def _not_now(why: str) -> Reply:
    return Reply(refused=Refusal(why, cause=Cause.NOT_NOW))


class RunState:
    """The states of a run: waiting for nodes -> running <-> paused -> finished.

    Args:
        autostart: begin waiting; else paused.
    """

    def __init__(self, autostart: bool) -> None:
        self.state = WAITING if autostart else PAUSED
        self._steps_left = 0  # of a paused bench; 0: no end
        self._elapsed = 0.0  # of the finished stretches of this epoch [s]
        self._since: float | None = None  # of the present one [wall s]

    @property
    def running(self) -> bool:
        """Ticks pass."""
        return self.state == RUNNING

    @property
    def has_steps_left(self) -> bool:
        """Return whether a paused bench simulates some ticks, or waits for nodes before it does."""
        return self._steps_left > 0

    def wall_time(self, now: float) -> float:
        """Return for how long ticks have passed in this epoch, pauses left out [wall s]."""
        return self._elapsed + (now - self._since if self._since is not None else 0.0)

    def begin(self, now: float) -> None:
        """Run: all required nodes are present."""
        self.state, self._since = RUNNING, now

    def start(self) -> Reply:
        """Run on without an end, as soon as all are there."""
        reasons = {FINISHED: _OVER, RUNNING: "already running"}
        if self.state in reasons and not self._steps_left:
            return _not_now(reasons[self.state])
        self._steps_left = 0
        if self.state == PAUSED:
            self.state = WAITING
        return Reply("starting")

    def pause(self, now: float) -> Reply:
        """Rest between two ticks."""
        if self.state not in (RUNNING, WAITING):
            return _not_now(f"not running but {self.state}")
        self._rest(PAUSED, now)
        return Reply("paused")

    def step(self, ticks: int) -> Reply:
        """Run for some ticks, then rest again."""
        if self.state != PAUSED:
            over = self.state == FINISHED
            return _not_now(_OVER if over else f"not paused but {self.state}; call pause first")
        self._steps_left = max(1, ticks)
        self.state = WAITING
        return Reply(f"flying {count_text(self._steps_left, 'tick')}")

    def reset(self) -> None:
        """Rest at tick 0; nothing is left of what was under way."""
        self.state, self._steps_left = PAUSED, 0
        self._elapsed, self._since = 0.0, None

    def count_tick(self, now: float) -> bool:
        """Count a tick; return whether the bench rests after it."""
        if not self._steps_left:
            return False
        self._steps_left -= 1
        if self._steps_left:
            return False
        self._rest(PAUSED, now)
        return True

    def finish(self, now: float) -> None:
        """Nothing is left to fly."""
        self._rest(FINISHED, now)

    def _rest(self, state: str, now: float) -> None:
        self._elapsed, self._since = self.wall_time(now), None
        self.state, self._steps_left = state, 0
