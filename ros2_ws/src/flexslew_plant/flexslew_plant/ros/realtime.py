"""Real-time priority for the two processes of a loop that is held to the wall clock."""

import os
from contextlib import suppress

PLANT, CONTROLLER = 2, 1  # priorities: a law that computes too long does not hold up the plant


class RealTime:
    """Gives this process real-time priority where its user is allowed to.

    Root may, and who has an `rtprio` limit (limits.conf(5)); for others nothing changes. Without
    it a page that is drawn, or a compiler, holds up a tick now and then where processors are few.
    What this process starts meanwhile goes on without.

    Args:
        priority: among real-time processes.
    """

    def __init__(self, priority: int) -> None:
        self._priority, self._requested = priority, False

    def want(self, requested: bool) -> None:
        """Change how all threads are scheduled, where that is news."""
        if requested == self._requested:
            return
        self._requested = requested
        policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK if requested else os.SCHED_OTHER
        for thread in os.listdir("/proc/self/task"):
            with suppress(OSError):  # not allowed, or it has just ended
                os.sched_setscheduler(
                    int(thread), policy, os.sched_param(self._priority * requested)
                )
