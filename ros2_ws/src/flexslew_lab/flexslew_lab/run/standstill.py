"""Detects a node that stands still inside Fast DDS 3.2, unlike one that waits or is stopped.

One thread holds the lock of the discovery and waits for the thread of the timers (a remote writer
leaves: PDP::removeWriterProxyData), which waits for that lock to announce the node
(PDP::set_next_announcement_interval): eProsima/Fast-DDS issue 6502. From then on the node
discovers no other and may never end its own construction. The thread of the timers wakes at least
every 3 s (leaseAnnouncement) wherever DDS is alive, so one that does not wake is the sign.
"""

from collections.abc import Callable
from pathlib import Path
from time import monotonic

PATIENCE = 30.0  # with a thread of timers that does not wake: ten announcements [wall s]
_TIMERS = "dds.ev."  # what Fast DDS calls the threads


class StallMonitor:
    """Examines the processes of a run from time to time.

    Args:
        clock: returns the time [wall s].
        processes: folder of the kernel with all processes.
    """

    def __init__(
        self, clock: Callable[[], float] = monotonic, processes: Path = Path("/proc")
    ) -> None:
        self._clock, self._processes = clock, processes
        self._switch_counts: dict[Path, tuple[str, float]] = {}  # how often, since when

    def of(self, pid: int) -> bool:
        """Return whether a thread of timers of a process has not woken for PATIENCE."""
        now, found = self._clock(), False
        for thread in (self._processes / str(pid) / "task").glob("*"):
            try:
                if not (thread / "comm").read_text().startswith(_TIMERS):
                    continue
                status = (thread / "status").read_text()
            except OSError:  # it has just ended
                continue
            switch_count, state = _field(status, "voluntary_ctxt_switches"), _field(status, "State")
            before, since = self._switch_counts.get(thread, ("", now))
            if switch_count != before or not state.startswith(
                "S"
            ):  # stopped by a signal, or at work
                since = now
            self._switch_counts[thread] = switch_count, since
            found = found or now - since > PATIENCE
        return found


def _field(status: str, name: str) -> str:
    lines = (line.partition(":") for line in status.splitlines())
    return next((value.strip() for key, _, value in lines if key == name), "")
