"""Real-time priority for the nodes of a loop that is held to the wall clock."""

import os
from contextlib import suppress

_PRIORITY = 1  # the lowest: before all that is not real-time


class RealTime:
    """Lets this process go before all that is not real-time, where its user may ask for that.

    Root may, and who has an `rtprio` limit (limits.conf(5)); for others nothing changes. Without
    it a page that is drawn, or a compiler, holds up a tick now and then where processors are few.
    """

    def __init__(self) -> None:
        self._wanted = False

    def want(self, wanted: bool) -> None:
        """Change the priority of all threads, where that is news."""
        if wanted == self._wanted:
            return
        self._wanted = wanted
        policy = os.SCHED_FIFO if wanted else os.SCHED_OTHER
        with suppress(OSError):  # not allowed
            for thread in os.listdir("/proc/self/task"):
                os.sched_setscheduler(int(thread), policy, os.sched_param(_PRIORITY * wanted))
