"""Real-time priority for the processes of a loop that is held to the wall clock."""

import os

# Priorities. A law that computes too long does not hold up the plant, nor does a standby law hold
# up the one in charge; but a standby law has seen all that it must know when it takes over.
PLANT, IN_CHARGE, STANDBY, NONE = 3, 2, 1, 0


class RealTime:
    """Gives this process real-time priority where its user is allowed to.

    Root may, and so may a user with an `rtprio` limit (limits.conf(5)), which may be less than
    demanded; for others nothing changes. Without it a page that is drawn, or a compiler, holds up a
    tick at times where processors are few. Processes that this one starts do not get it.

    """

    def __init__(self) -> None:
        self._priority = NONE

    def set_priority(self, priority: int) -> None:
        """Change how all threads are scheduled, if the priority is new; NONE: the default."""
        if priority == self._priority:
            return
        self._priority = priority
        for thread in map(int, os.listdir("/proc/self/task")):
            for policy, allowed in _priority_options(priority):
                try:
                    os.sched_setscheduler(thread, policy, os.sched_param(allowed))
                except PermissionError:
                    continue
                except ProcessLookupError:  # it has just ended
                    pass
                break


def priority_of(in_charge: bool, rate_factor: float) -> int:
    """Return the priority of a controller of a bench at this rate."""
    if rate_factor > 0.0:
        return IN_CHARGE if in_charge else STANDBY
    return NONE


def _priority_options(priority: int) -> list[tuple[int, int]]:
    """Return policies and priorities, the best first, of which one may be allowed."""
    once = os.SCHED_RESET_ON_FORK  # only a privileged process can take this back
    if priority == NONE:
        return [(os.SCHED_OTHER, NONE), (os.SCHED_OTHER | once, NONE)]
    return [(os.SCHED_FIFO | once, less) for less in range(priority, NONE, -1)]
