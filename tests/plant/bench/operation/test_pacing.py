from typing import Any

import numpy as np
import pytest

from flexslew_plant.bench.operation.pacing import REPEAT_AFTER, TickTimer


def paced(rate_factor: float = 2.0) -> Any:
    pacing = TickTimer(0.01, rate_factor, 2.0)
    pacing.start(100.0)
    return pacing


def fast() -> Any:
    pacing = TickTimer(0.01, 0.0, 2.0)
    pacing.start(100.0)
    return pacing


def test_as_fast_as_it_goes_the_answer_ends_the_tick() -> None:
    pacing = fast()
    assert not pacing.paced
    assert pacing.tick_over(100.0, True, 0)
    assert not pacing.tick_over(100.0, False, 0)


def test_silence_for_the_timeout_ends_the_tick() -> None:
    pacing = fast()
    assert not pacing.tick_over(101.99, False, 0)
    assert pacing.tick_over(102.0, False, 0)


def test_who_was_silent_is_not_waited_for_as_long_again() -> None:
    pacing = fast()
    assert not pacing.tick_over(100.0 + 0.9 * REPEAT_AFTER, False, 1)
    assert pacing.tick_over(100.0 + 1.01 * REPEAT_AFTER, False, 1)


def test_a_paced_tick_ends_with_its_period_whether_answered_or_not() -> None:
    pacing = paced()
    for answered in (True, False):
        assert not pacing.tick_over(100.0049, answered, 0)
        assert pacing.tick_over(100.0051, answered, 0)


def test_every_question_has_its_full_period_however_late_it_was_asked() -> None:
    pacing = paced()
    pacing.request(100.009)  # the second, 4 ms late
    assert not pacing.tick_over(100.0139, False, 0)
    assert pacing.tick_over(100.0141, False, 0)


def test_an_answered_tick_is_slept_through_however_long_it_is() -> None:
    """Its question is repeated no more: a plant that looked for that would take a processor."""
    pacing = paced(0.01)  # a tick takes a second
    assert pacing.wait(100.0, False) == pytest.approx(REPEAT_AFTER)
    for now in (100.0, 100.05, 100.2, 100.7):
        assert pacing.wait(now, True) == pytest.approx(101.0 - now)
    assert pacing.check_repeat(100.7)
    assert pacing.wait(100.7, False) == pytest.approx(REPEAT_AFTER)


def test_a_stall_of_the_plant_counts_against_nobody() -> None:
    pacing = paced()
    wait = pacing.wait(100.001, False)
    assert pacing.look(100.001 + wait + 3.0) == pytest.approx(3.0)
    assert not pacing.tick_over(103.0049, False, 0)
    assert pacing.tick_over(103.0051, False, 0)


def test_a_stall_as_fast_as_it_goes_is_no_silence() -> None:
    pacing = fast()
    pacing.wait(100.0, False)
    pacing.look(110.0)
    assert not pacing.tick_over(110.0, False, 0)
    assert pacing.tick_over(112.0, False, 0)


def test_too_far_behind_a_new_schedule_begins_instead_of_a_burst() -> None:
    pacing = paced()
    assert pacing.shift_schedule(100.03) == 0.0  # 25 ms: caught up
    late = pacing.shift_schedule(100.505)
    assert late == pytest.approx(0.5)
    pacing.request(100.505)
    assert not pacing.tick_over(100.5099, True, 0)
    assert pacing.tick_over(100.5101, True, 0)


def test_another_rate_counts_from_its_change_on() -> None:
    pacing = paced()
    pacing.set_rate(0.5, 100.002)
    assert not pacing.tick_over(100.0219, True, 0)
    assert pacing.tick_over(100.0221, True, 0)
    pacing.set_rate(0.0, 100.023)
    assert pacing.tick_over(100.023, True, 0)


def test_paced_ticks_do_not_drift_when_one_is_late() -> None:
    pacing = paced()
    pacing.request(100.009)  # the first was 4 ms late
    assert not pacing.tick_over(100.0099, True, 0)
    assert pacing.tick_over(100.0101, True, 0)


def test_a_pause_is_not_caught_up() -> None:
    pacing = paced()
    pacing.request(100.005)
    pacing.start(500.0)
    assert not pacing.tick_over(500.0049, True, 0)
    assert pacing.tick_over(500.0051, True, 0)


def test_a_question_is_repeated_at_its_interval() -> None:
    pacing = fast()
    assert not pacing.check_repeat(100.0 + 0.5 * REPEAT_AFTER)
    assert pacing.check_repeat(100.0 + 1.01 * REPEAT_AFTER)
    assert not pacing.check_repeat(100.0 + 1.5 * REPEAT_AFTER)
    pacing.request(103.0)
    assert not pacing.check_repeat(103.0 + 0.9 * REPEAT_AFTER)


@pytest.mark.parametrize("pacing", [paced(), fast()])
def test_the_wait_ends_when_something_is_due(pacing: Any) -> None:
    wait = pacing.wait(100.001, False)
    assert 0.0 < wait <= REPEAT_AFTER
    later = 100.001 + wait + 1e-9
    assert pacing.tick_over(later, False, 0) or pacing.check_repeat(later)
    assert pacing.wait(1000.0, False) == 0.0


def test_after_tick_0_an_answer_to_a_plant_with_its_own_clock_is_due_in_a_period() -> None:
    pacing = fast()
    pacing.follow_plant()
    assert (pacing.paced, pacing.real_time, pacing.rate_factor) == (False, True, 1.0)
    assert not pacing.tick_over(101.99, False, 0)  # its clock stands
    pacing.request(103.0)
    assert pacing.tick_over(103.001, True, 0)
    for missing in (0, 1):
        assert not pacing.tick_over(103.009, False, missing)
        assert pacing.tick_over(103.011, False, missing)
    assert pacing.wait(103.002, False) == pytest.approx(0.008)
    pacing.start(104.0)
    assert not pacing.tick_over(105.99, False, 0)


def test_a_question_after_a_wait_for_the_plant_counts_from_the_next_look() -> None:
    pacing = fast()
    pacing.follow_plant()
    pacing.look(101.0)
    pacing.request(101.0)  # the plant has measured since
    pacing.look(101.5)
    assert not pacing.tick_over(101.5, False, 0)
    assert pacing.tick_over(101.51, False, 0)


@pytest.mark.parametrize("by_plant", [False, True])
def test_no_rounding_keeps_an_unanswered_tick_from_its_end(
    by_plant: bool, case: np.random.Generator
) -> None:
    for _ in range(20):
        pacing = TickTimer(0.02, 0.0, 0.02)
        if by_plant:
            pacing.follow_plant()
        now = case.uniform(1000.0, 9000.0)
        pacing.start(now)
        pacing.request(now)
        for _ in range(4):
            pacing.look(now)
            if pacing.tick_over(now, False, 0):
                break
            now += pacing.wait(now, False) + case.uniform(1e-6, 1e-4)
        else:
            raise AssertionError(f"no end at {now}")
