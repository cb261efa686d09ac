from typing import Any

import numpy as np
import pytest
from tests.present import present

from flexslew_plant.bench.bench import Bench, BenchSettings, SwitchRequest
from flexslew_plant.bench.handover import RUN_OVER
from flexslew_plant.bench.schedule import ScheduleEntry
from flexslew_plant.measurement import EffortCommand
from flexslew_plant.refusal import Cause, Refusal
from flexslew_plant.testbeds.csa import CsaTestbed


def bench(**more: Any) -> Bench:
    return Bench(BenchSettings(testbed=CsaTestbed(modes=1), **({"active": "a"} | more)))


def tick(bed: Any, silent: Any = (), effort: Any = (1.0, -1.0)) -> Any:
    """Fly one tick in which everybody answers but those who are silent; return who was asked."""
    asked = bed.question.controller
    if asked and asked not in silent:
        bed.offer(EffortCommand(bed.tick, bed.epoch, asked, np.array(effort)))
    bed.advance()
    return asked


def asked(bed: Any, ticks: Any, silent: Any = ()) -> list[Any]:
    return [tick(bed, silent) for _ in range(ticks)]


def kinds(bed: Any, *requested: Any) -> list[Any]:
    return [event.kind for event in bed.events if event.kind in requested]


def test_a_newcomer_that_never_answers_gives_the_bench_back_to_the_one_before_it() -> None:
    bed = bench(fallback=("c",), max_missed=2)
    bed.request_switch(SwitchRequest("b", 1))
    assert asked(bed, 5, silent=("b",)) == ["a", "b", "b", "a", "a"]
    (result,) = bed.switch_results
    assert not result.ok
    assert result.message == "b never answered; a is in charge"
    assert bed.faulted


def test_a_newcomer_from_the_brake_that_never_answers_leaves_the_brake_on() -> None:
    bed = bench(max_missed=1)
    assert asked(bed, 2, silent=("a",)) == ["a", ""]
    bed.request_switch(SwitchRequest("b", 3))
    assert asked(bed, 4, silent=("b",)) == ["", "b", "", ""]
    (result,) = bed.switch_results
    assert result.message == "b never answered; the brake is in charge"


def test_the_effort_of_the_brake_is_held_until_a_newcomer_answers() -> None:
    bed = bench(max_missed=3)
    for _ in range(30):
        tick(bed, effort=(50.0, -50.0))
    bed.brake(True)
    bed.brake(False)
    asked(bed, 5)
    bed.request_switch(SwitchRequest("b", 0))
    before = []
    for _ in range(3):
        before.append(bed.truth().applied_effort)
        assert tick(bed, silent=("b",)) in ("", "b")
    assert np.abs(before[0]).max() < 10.0  # the brake's, not the 50 N m of long ago
    assert bed.truth().applied_effort.tolist() == before[1].tolist() != before[0].tolist()


def test_a_fallback_serves_as_often_as_it_is_needed() -> None:
    bed = bench(fallback=("b",), max_missed=1)
    assert asked(bed, 2, silent=("a",)) == ["a", "b"]
    bed.request_switch(SwitchRequest("c", 3))
    assert asked(bed, 2) == ["b", "c"]
    assert asked(bed, 3, silent=("c",)) == ["c", "b", "b"]
    assert kinds(bed, "fallback", "brake") == ["fallback", "fallback"]


def test_fallbacks_that_are_not_ready_are_passed_over() -> None:
    bed = bench(fallback=("b", "c"), max_missed=1)
    bed.set_ready_status("b", Refusal("no plan yet"))
    assert asked(bed, 3, silent=("a",)) == ["a", "c", "c"]


def test_how_far_one_is_behind_is_told_once_and_known_exactly() -> None:
    bed = bench()
    for tick in (2, 3, 4):
        bed.set_ready_status("b", Refusal(f"the bench is at {tick}", cause=Cause.BEHIND))
    bed.set_ready_status("b", Refusal("no plan yet", cause=Cause.NOT_READY))
    bed.set_ready_status("b", Refusal("no testbed yet", cause=Cause.NOT_READY))
    told = [event.data["reason"] for event in bed.events if event.kind == "not_ready"]
    assert told == ["the bench is at 2", "no plan yet", "no testbed yet"]


def test_mute_fallbacks_do_not_take_turns_for_ever() -> None:
    bed = bench(fallback=("b", "c"), max_missed=1)
    assert asked(bed, 5, silent=("a", "b", "c")) == ["a", "b", "c", "", ""]


def test_a_switch_is_checked_when_it_is_due() -> None:
    bed = bench()
    assert bed.request_switch(SwitchRequest("b", 3)) is None
    bed.set_ready_status("b", Refusal("it sends no heartbeat"))
    assert asked(bed, 5) == ["a"] * 5
    (result,) = bed.switch_results
    assert (result.ok, result.tick) == (False, 3)
    assert result.message == "switch to b dropped: b is not ready: it sends no heartbeat"
    (event,) = [e for e in bed.events if e.kind == "switch_dropped"]
    assert event.tick == 3
    bed.set_ready_status("b", None)
    bed.request_switch(SwitchRequest("b", 6))
    assert asked(bed, 2) == ["a", "b"]


def test_a_switch_to_who_is_in_charge_when_it_is_due_is_dropped() -> None:
    bed = bench()
    bed.request_switch(SwitchRequest("b", 2))
    bed.request_switch(SwitchRequest("b", 4))
    asked(bed, 5)
    assert [r.ok for r in bed.switch_results] == [True, False]
    assert "b is already in charge" in bed.switch_results[1].message


@pytest.mark.parametrize(
    ("act", "reason"),
    [(Bench.reset, "the bench was reset"), (lambda bed: asked(bed, 20), "the run is over")],
)
def test_a_switch_that_cannot_happen_any_more_is_dropped_with_the_reason(
    act: Any, reason: str
) -> None:
    bed = bench(duration=0.1, schedule=(ScheduleEntry(at=5.0, switch="c"),))
    bed.request_switch(SwitchRequest("b", 9))
    asked(bed, 3)
    if act is not Bench.reset:
        bed.handover.drop_all(Refusal(reason))
    else:
        act(bed)
    assert {r.request.controller: r.message for r in bed.switch_results} == {
        name: f"switch to {name} dropped: {reason}" for name in "bc"
    }
    assert kinds(bed, "switch_dropped") == ["switch_dropped"] * 2


def test_a_switch_behind_the_end_is_refused() -> None:
    bed = bench(duration=0.1)
    assert bed.request_switch(SwitchRequest("b", 9)) is None
    assert "ends at tick 10" in str(bed.request_switch(SwitchRequest("b", 10)))


def test_strict_with_zero_allows_no_step_at_all() -> None:
    bed = bench()
    asked(bed, 2)
    bed.request_switch(SwitchRequest("b", 3, strict=True, max_effort_step=0.0))
    asked(bed, 1)
    assert bed.question.controller == "b"
    assert not bed.offer(EffortCommand(3, 0, "b", np.array([1.0, -1.0 + 1e-12])))
    assert bed.question.controller == "a"
    assert "a stays in charge" in bed.switch_results[0].message


def test_the_latched_brake_holds_until_it_is_released_on_purpose() -> None:
    bed = bench(fallback=("b",))
    asked(bed, 3)
    bed.request_switch(SwitchRequest("b", 8))
    assert bed.brake(True, "me") is None
    assert str(bed.brake(True)) == "the brake is latched already"
    assert asked(bed, 3) == ["a", "", ""]  # from the next tick on
    refused = present(bed.request_switch(SwitchRequest("b", 9)))
    assert refused.cause is Cause.LATCHED
    assert str(refused) == "the brake is latched; release it first"
    assert [r.ok for r in bed.switch_results] == [False]
    bed.reset()
    assert asked(bed, 2) == ["", ""]  # a reset does not release it
    assert bed.brake(False) is None
    assert asked(bed, 2) == ["", ""]  # nor does anybody take over by himself
    assert bed.request_switch(SwitchRequest("b", 5)) is None
    assert asked(bed, 2) == ["", "b"]
    asks = [e for e in bed.events if e.kind == "brake_requested"]
    assert [(e.tick, e.data) for e in asks] == [
        (3, {"on": True, "tick": 4, "who": "me"}), (2, {"on": False, "tick": 3, "who": ""}),
    ]  # fmt: skip
    assert kinds(bed, "brake_latched", "brake_released") == ["brake_latched", "brake_released"]
    assert not bed.faulted


def test_a_brake_that_was_asked_for_before_a_reset_holds_from_tick_0_on() -> None:
    bed = bench(fallback=("b",))
    asked(bed, 3)
    assert bed.brake(True, "me") is None
    bed.reset()
    assert bed.handover.latched
    assert str(bed.brake(True)) == "the brake is latched already"
    assert asked(bed, 2) == ["", ""]
    assert bed.brake(False) is None
    bed.reset()  # so does its release
    assert not bed.handover.latched
    assert bed.request_switch(SwitchRequest("b", 2)) is None
    assert asked(bed, 3) == ["", "", "b"]
    told = [(e.kind, e.epoch, e.tick) for e in bed.events if e.kind.startswith("brake_")]
    assert told == [
        ("brake_requested", 0, 3), ("brake_latched", 1, 0),
        ("brake_requested", 1, 2), ("brake_released", 2, 0),
    ]  # fmt: skip


def test_a_brake_that_is_released_within_its_tick_takes_the_bench_all_the_same() -> None:
    bed = bench(fallback=("b",))
    asked(bed, 3)
    assert bed.brake(True) is None
    assert bed.brake(False) is None
    assert asked(bed, 3) == ["a", "", ""]
    assert kinds(bed, "brake_latched", "brake_released") == ["brake_latched", "brake_released"]
    assert bed.request_switch(SwitchRequest("a", 8)) is None


@pytest.mark.parametrize("newcomer", ["a", "b"])  # a is in charge until the brake is
def test_a_bench_that_rests_takes_a_switch_after_the_release_of_the_brake_and_none_before(
    newcomer: str,
) -> None:
    bed = bench(fallback=("b",))
    asked(bed, 3)
    bed.request_switch(SwitchRequest("c", 8))
    assert bed.brake(True) is None
    refused = present(bed.request_switch(SwitchRequest(newcomer, 4)))
    assert refused.cause is Cause.LATCHED
    assert bed.brake(False) is None
    assert bed.request_switch(SwitchRequest(newcomer, 4)) is None
    assert asked(bed, 6) == ["a", *newcomer * 5]
    results = [(r.request.controller, r.ok) for r in bed.switch_results]
    assert results == [("c", False), (newcomer, True)]  # c was asked for before the brake

    assert bed.brake(True) is None
    asked(bed, 2)
    assert bed.brake(False) is None
    assert bed.request_switch(SwitchRequest("c", bed.tick + 1)) is None
    assert asked(bed, 2) == ["", "c"]


def test_the_brake_in_the_middle_of_a_handover_answers_the_switch() -> None:
    bed = bench()
    bed.request_switch(SwitchRequest("b", 1))
    asked(bed, 1)
    bed.brake(True)
    tick(bed, silent=("b",))
    (result,) = bed.switch_results
    assert "the brake is latched" in result.message
    assert bed.question.controller == ""


@pytest.mark.parametrize("seed", range(20))
def test_every_switch_gets_one_result_whatever_happens(seed: Any) -> None:
    rng = np.random.default_rng(seed)
    bed = bench(fallback=("b", "c"), max_missed=2, duration=3.0)
    requested = 0
    silent: set[Any] = set()
    for _ in range(300):
        if bed.done:
            break
        name = "abcd"[rng.integers(4)]
        match rng.integers(12):
            case 0 | 1:
                request = SwitchRequest(
                    name, bed.tick + int(rng.integers(1, 30)), bool(rng.integers(2)), 1.0
                )
                requested += bed.request_switch(request) is None
            case 2:
                bed.set_ready_status(name, None if rng.integers(2) else Refusal("ill"))
            case 3:
                silent ^= {name}
            case 4 if rng.integers(5) == 0:
                bed.brake(bool(rng.integers(2)))
            case 5 if rng.integers(10) == 0:
                bed.reset()
        before = bed.question.controller
        tick(bed, silent, rng.normal(0.0, 1.0, 2))
        if bed.question.controller != before:
            assert not bed.handover.latched or bed.question.controller == ""
    bed.handover.drop_all(RUN_OVER)
    assert len(bed.switch_results) == requested
    told = kinds(bed, "switched", "switch_refused", "switch_dropped")
    never = [r for r in bed.switch_results if r.refused and r.refused.cause is Cause.NO_ANSWER]
    assert len(told) + len(never) == requested
