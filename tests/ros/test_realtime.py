"""A bench that is held to the wall clock goes before what is not real-time, where it may."""

import os
from pathlib import Path
from resource import RLIMIT_RTPRIO, getrlimit

import pytest

from .flight import Flight, slew

ALLOWED = os.geteuid() == 0 or getrlimit(RLIMIT_RTPRIO)[0] > 0


def policies(pid: int) -> set[int]:
    """Return how the threads of a process are scheduled."""
    return {os.sched_getscheduler(int(t)) for t in os.listdir(f"/proc/{pid}/task")}


@pytest.mark.skipif(not ALLOWED, reason="needs root or an rtprio limit")
@pytest.mark.parametrize("rate", [0.0, 20.0])
def test_the_loop_is_real_time_while_a_clock_paces_it(tmp_path: Path, rate: float) -> None:
    found: dict[str, set[int]] = {}

    def look(pids: dict[str, int], domain: int) -> None:
        found.update({name: policies(pid) for name, pid in pids.items()})

    flight = Flight(slew(duration=60.0, rate=rate), tmp_path, 100, look)
    assert flight.outcome == (0, "")
    assert found["pd_feedforward"] == {os.SCHED_FIFO}
    assert found["plant"] == {os.SCHED_FIFO if rate else os.SCHED_OTHER}
    assert found["recorder"] == {os.SCHED_OTHER}
