"""What is held to the wall clock goes before all that is not real-time, where it may."""

import os
from functools import partial
from pathlib import Path

import pytest
from flexslew_msgs.srv import SetRate

from flexslew_plant.ros.realtime import CONTROLLER, PLANT

from .bystander import beside
from .flight import Flight, slew

REAL_TIME = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK  # what such a process starts is not
FIRST, SECOND = "pd_feedforward", "second"


def allowed() -> bool:
    """Return whether this process could be real-time: root in a container often could not."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PLANT))
    except OSError:
        return False
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    return True


def scheduled(pid: int) -> set[tuple[int, int]]:
    """Return policies and priorities of the threads of a process."""
    threads = map(int, os.listdir(f"/proc/{pid}/task"))
    return {(os.sched_getscheduler(t), os.sched_getparam(t).sched_priority) for t in threads}


@pytest.mark.skipif(not allowed(), reason="needs CAP_SYS_NICE or an rtprio limit")
def test_plant_and_who_is_in_charge_are_real_time_while_a_clock_paces_them(tmp_path: Path) -> None:
    def act(pids: dict[str, int], domain: int) -> None:
        def real_time(*names: str) -> bool:
            requested = {n: {(os.SCHED_OTHER, 0)} for n in ("plant", FIRST, SECOND, "recorder")}
            for name in names:
                requested[name] = {(REAL_TIME, PLANT if name == "plant" else CONTROLLER)}
            return {name: scheduled(pids[name]) for name in requested} == requested

        with beside(domain) as bench:
            bench.until(partial(real_time, "plant", FIRST))
            bench.swap(SECOND)
            bench.until(partial(real_time, "plant", SECOND))
            assert bench.ask(SetRate, "set_rate", rate_factor=0.0).ok
            bench.until(real_time)
            bench.swap(FIRST)
            assert bench.ask(SetRate, "set_rate", rate_factor=2.0).ok
            bench.until(partial(real_time, "plant", FIRST))
        raise KeyboardInterrupt

    trial = slew(1e5, 5.0, f", {SECOND}: {{law: lqr, requires_plan: false}}")
    assert Flight(trial, tmp_path, 1, act).outcome.exit_code == 130
