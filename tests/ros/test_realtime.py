"""What is held to the wall clock goes before all that is not real-time, where it may."""

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from flexslew_msgs.srv import SetRate

from flexslew_plant.ros.realtime import IN_CHARGE, NONE, PLANT, STANDBY, RealTime

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


@pytest.mark.ros
@pytest.mark.skipif(not allowed(), reason="needs CAP_SYS_NICE or an rtprio limit")
def test_plant_and_controllers_are_real_time_while_a_clock_paces_them(tmp_path: Path) -> None:
    def act(pids: dict[str, int], domain: int) -> None:
        def real_time(**priorities: int) -> bool:
            requested = {n: {(os.SCHED_OTHER, 0)} for n in ("plant", FIRST, SECOND, "recorder")}
            requested |= {name: {(REAL_TIME, one)} for name, one in priorities.items()}
            return {name: scheduled(pids[name]) for name in requested} == requested

        def led_by(first: int, second: int) -> Callable[[], bool]:
            return partial(real_time, plant=PLANT, **{FIRST: first, SECOND: second})

        with beside(domain) as bench:
            bench.until(led_by(IN_CHARGE, STANDBY))
            bench.swap(SECOND)
            bench.until(led_by(STANDBY, IN_CHARGE))
            assert bench.ask(SetRate, "set_rate", rate_factor=0.0).ok
            bench.until(real_time)
            bench.swap(FIRST)
            assert bench.ask(SetRate, "set_rate", rate_factor=2.0).ok
            bench.until(led_by(IN_CHARGE, STANDBY))
        raise KeyboardInterrupt

    trial = slew(1e5, 5.0, f", {SECOND}: {{law: lqr, requires_plan: false}}")
    assert Flight(trial, tmp_path, 1, act).outcome.exit_code == 130


@pytest.mark.parametrize("limit", range(5))
def test_who_may_have_less_has_that_and_goes_back_to_what_others_have(
    monkeypatch: pytest.MonkeyPatch, limit: int
) -> None:
    """By the rules of sched(7) for those with an rtprio limit and no other right."""
    now = [os.SCHED_OTHER, 0]

    def set_scheduler(thread: int, policy: int, parameters: os.sched_param) -> None:
        once = os.SCHED_RESET_ON_FORK
        if parameters.sched_priority > limit or now[0] & once > policy & once:
            raise PermissionError
        now[:] = policy, parameters.sched_priority

    monkeypatch.setattr(os, "sched_setscheduler", set_scheduler)
    one = RealTime()
    for wanted in (PLANT, IN_CHARGE, STANDBY, IN_CHARGE):
        one.set_priority(wanted)
        assert now[1] == min(wanted, limit)
    one.set_priority(NONE)
    assert now == [os.SCHED_OTHER | (os.SCHED_RESET_ON_FORK if limit else 0), 0]
