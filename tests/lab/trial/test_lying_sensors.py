"""A part of the campaign of benchmarks/lying_sensors.py: what is seen, and what the bench does."""

from dataclasses import replace

import pytest
from benchmarks.lying_sensors import LAWS, LIES, Outcome, flown, trial_of
from tests.representatives import representatives

DURATION = 14.0  # [s]; the fault begins at 10 s


def seen(law: str, lie: str, guarded: bool = True) -> Outcome:
    return flown(replace(trial_of(law, lie, guarded), duration=DURATION))


@pytest.mark.slow
@pytest.mark.first(1)
@pytest.mark.parametrize(
    ("law", "lie", "within"),
    [
        ("lqr", "rate sensor reads zero", 2),
        ("proportional_integral", "encoder biased by 0.05 rad", 2),
        ("output_feedback", "encoder frozen", 20),
        ("collocated_pid", "rate biased by 0.02 rad/s", 20),
        ("collocated_pid", "rate sensor reads NaN", 2),
    ],
)
def test_a_lie_is_seen_and_the_next_one_takes_over(law: str, lie: str, within: int) -> None:
    one = seen(law, LIES[lie])
    assert one.detected is not None
    assert 0 <= one.detected <= within
    assert one.end != law


@pytest.mark.slow
@pytest.mark.parametrize("law", representatives(LAWS, "lqr"))
def test_nothing_is_seen_where_there_is_no_lie(law: str) -> None:
    assert seen(law, "") == seen(law, "", guarded=False)


def test_without_a_guard_nobody_sees_a_frozen_encoder() -> None:
    one = seen("lqr", LIES["encoder frozen"], guarded=False)
    assert (one.detected, one.end) == (None, "lqr")
