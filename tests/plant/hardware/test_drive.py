from typing import Any

import numpy as np
import pytest

from flexslew_plant.bench.bench import Bench, BenchSettings, SwitchRequest
from flexslew_plant.events import Level
from flexslew_plant.events.run import RejectionReason
from flexslew_plant.measurement import EffortCommand
from flexslew_plant.testbeds.csa import CsaTestbed

GOOD = np.array([20.0, -10.0])


def bench(**more: Any) -> Bench:
    return Bench(BenchSettings(testbed=CsaTestbed(modes=1), **({"active": "a"} | more)))


def command(bed: Any, effort: Any = GOOD, **changes: Any) -> Any:
    question = bed.question
    answer = EffortCommand(question.tick, question.epoch, question.controller, effort)
    return answer._replace(**changes)


def answered_once(**more: Any) -> Any:
    """Return a bench that holds GOOD and asks its second question."""
    bed = bench(**more)
    assert bed.offer(command(bed))
    bed.advance()
    bed.events.clear()
    return bed


WRONG: dict[str, dict[str, Any]] = {
    "sender": {"controller": "b"},
    "stale": {"tick": 0, "effort": 2.0 * GOOD},
    "size": {"effort": np.zeros(3)},
    "finite": {"effort": np.array([np.nan, 0.0])},
}


@pytest.mark.parametrize("kind", WRONG)
def test_a_wrong_answer_is_rejected_counted_and_told_and_the_last_effort_held(kind: Any) -> None:
    bed = answered_once()
    assert not bed.offer(command(bed, **WRONG[kind]))
    assert bed.drive.rejected == {kind: 1}
    assert not bed.answered
    (event,) = bed.events
    assert (event.kind, event.level, event.tick) == ("rejected", Level.WARNING, 1)
    assert event.data["reason"] == kind
    bed.advance()
    np.testing.assert_array_equal(bed.truth().applied_effort, GOOD)
    assert bed.drive.missed == 1


def test_an_answer_of_an_earlier_epoch_is_stale() -> None:
    bed = bench()
    old = command(bed)
    bed.reset()
    assert not bed.offer(old)
    assert bed.drive.rejected[RejectionReason.STALE] == 1


@pytest.mark.parametrize("effort", [np.array([np.inf, 0.0]), np.array([0.0, -np.inf])])
def test_infinite_efforts_are_not_finite(effort: Any) -> None:
    bed = bench()
    assert not bed.offer(command(bed, effort))
    assert bed.drive.rejected[RejectionReason.FINITE] == 1


def test_a_right_answer_after_a_wrong_one_counts() -> None:
    bed = answered_once()
    bed.offer(command(bed, controller="b"))
    assert bed.offer(command(bed, 2.0 * GOOD))
    bed.advance()
    np.testing.assert_array_equal(bed.truth().applied_effort, 2.0 * GOOD)
    assert bed.drive.missed == 0


def test_a_flood_of_wrong_answers_stays_readable() -> None:
    bed = bench()
    for _ in range(1000):
        bed.offer(command(bed, controller="b"))
    assert bed.drive.rejected[RejectionReason.SENDER] == 1000
    assert len(bed.events) == 10


def test_the_second_answer_is_ignored() -> None:
    bed = bench()
    assert bed.offer(command(bed))
    assert not bed.offer(command(bed, 3.0 * GOOD))
    bed.advance()
    np.testing.assert_array_equal(bed.truth().applied_effort, GOOD)
    assert not bed.drive.rejected


def test_silence_goes_to_the_fallbacks_in_turn_and_then_to_the_brake() -> None:
    bed = bench(fallback=("b", "c"), max_missed=3)
    in_charge = []
    for _ in range(10):
        in_charge.append(bed.question.controller)
        bed.advance()
    assert in_charge == ["a"] * 3 + ["b"] * 3 + ["c"] * 3 + [""]
    assert bed.faulted
    assert bed.answered  # the brake needs nobody
    assert bed.drive.missed == 9
    faults = [event for event in bed.events if event.level == Level.FAULT]
    assert [(e.kind, e.data["to"]) for e in faults] == [
        ("fallback", "b"), ("fallback", "c"), ("brake", ""),
    ]  # fmt: skip


def test_a_repeated_answer_is_no_wrong_one() -> None:
    bed = bench()
    again = command(bed)
    for _ in range(3):
        bed.offer(command(bed))
        bed.advance()
    bed.events.clear()
    assert not bed.offer(again)  # its question had been repeated
    assert not bed.drive.rejected
    assert not bed.events


def test_an_answer_in_between_starts_the_count_anew() -> None:
    bed = bench(max_missed=3)
    for tick in range(20):
        if tick % 3 == 2:
            assert bed.offer(command(bed))
        bed.advance()
    assert bed.question.controller == "a"
    assert not bed.faulted


def test_nobody_may_answer_while_the_brake_is_on() -> None:
    bed = bench(max_missed=1)
    bed.advance()
    assert bed.question.controller == ""
    assert not bed.offer(command(bed, controller="a"))
    assert bed.drive.rejected[RejectionReason.SENDER] == 1


def test_the_brake_brings_the_bench_to_rest() -> None:
    bed = bench(max_missed=1)
    for _ in range(500):  # 5 s of push
        bed.offer(command(bed))
        bed.advance()
    pushed = bed.truth()
    for _ in range(60_000):
        bed.advance()
    still = bed.truth()
    assert still.energy < 1e-6 * pushed.energy
    assert np.abs(still.velocity).max() < 1e-4


def test_the_brake_never_adds_energy() -> None:
    bed = bench(max_missed=1)
    for _ in range(300):
        bed.offer(command(bed))
        bed.advance()
    bed.advance()
    energies = []
    for _ in range(3000):
        bed.advance()
        energies.append(bed.truth().energy)
    assert np.diff(energies).max() < 1e-9 * energies[0]


def test_a_strict_switch_whose_step_is_too_large_gives_the_bench_back() -> None:
    bed = answered_once()
    assert bed.request_switch(SwitchRequest("b", 2, strict=True, max_effort_step=5.0)) is None
    bed.offer(command(bed))
    bed.advance()
    assert bed.question.controller == "b"
    assert not bed.offer(command(bed, GOOD + np.array([5.1, 0.0])))
    assert bed.question.controller == "a"
    assert bed.question.tick == 2
    assert not bed.answered
    assert bed.offer(command(bed))
    bed.advance()
    (result,) = bed.switch_results
    assert not result.ok
    assert "would step by 5.1" in result.message
    assert bed.question.controller == "a"
    assert not bed.faulted


def test_a_strict_switch_with_a_small_step_goes_through_and_tells_it() -> None:
    bed = answered_once()
    bed.request_switch(SwitchRequest("b", 2, strict=True, max_effort_step=5.0))
    bed.offer(command(bed))
    bed.advance()
    assert bed.offer(command(bed, GOOD + np.array([4.0, -1.0])))
    (result,) = bed.switch_results
    assert result.ok
    assert result.tick == 2
    np.testing.assert_allclose(result.effort_step, [4.0, -1.0])
    assert bed.events[-1].kind == "switched"


def test_a_newcomer_that_never_answers_counts_as_missed() -> None:
    bed = answered_once(fallback=("a",), max_missed=2)
    bed.request_switch(SwitchRequest("b", 2))
    bed.offer(command(bed))
    for _ in range(3):
        bed.advance()
    assert bed.question.controller == "a"
    assert bed.faulted
