from typing import Any

import pytest

from flexslew_plant.bench.operation.run_state import FINISHED, PAUSED, RUNNING, WAITING, RunState


def running() -> Any:
    run = RunState(autostart=True)
    run.begin(10.0)
    return run


def test_it_waits_or_rests_at_the_start() -> None:
    assert RunState(autostart=True).state == WAITING
    assert RunState(autostart=False).state == PAUSED


def test_what_is_refused_says_the_state_and_changes_nothing() -> None:
    run = running()
    assert str(run.start().refused) == "already running"
    assert str(run.step(3).refused) == "not paused but running; call pause first"
    run.finish(12.0)
    assert str(run.start().refused) == "the run is over; call reset first"
    assert str(run.step(1).refused) == "the run is over; call reset first"
    assert str(run.pause(13.0).refused) == "not running but finished"
    assert run.state == FINISHED


def test_steps_are_counted_and_then_it_rests() -> None:
    run = RunState(autostart=False)
    assert run.step(3).ok
    run.begin(0.0)
    assert [run.count_tick(0.1) for _ in range(3)] == [False, False, True]
    assert run.state == PAUSED
    assert run.step(0).message == "flying 1 tick"


@pytest.mark.parametrize("act", ["pause", "start", "reset"])
def test_what_is_left_of_a_step_is_forgotten(act: str) -> None:
    run = RunState(autostart=False)
    run.step(100)
    run.begin(0.0)
    run.count_tick(0.1)
    assert run.has_steps_left
    {"pause": lambda: run.pause(0.2), "start": run.start, "reset": run.reset}[act]()
    assert not run.has_steps_left
    if act != "start":
        assert run.start().ok
        run.begin(0.3)
    assert run.state == RUNNING
    assert not any(run.count_tick(0.4) for _ in range(1000))


def test_the_wall_time_is_that_of_the_run_without_its_pauses() -> None:
    run = running()
    run.pause(13.0)
    assert run.wall_time(100.0) == 3.0
    run.start()
    run.begin(200.0)
    assert run.wall_time(201.0) == 4.0
    run.reset()
    assert run.wall_time(300.0) == 0.0
