from typing import Any

from flexslew_lab.log.checks.end_check import check_ends
from flexslew_plant.events import Event, event_of, fact_of


def event(kind: str, tick: int, epoch: int = 0, source: str = "plant", **data: Any) -> Event:
    return event_of(fact_of(kind, data), tick, 0.0, epoch, source)


def wrong(first: Any, last: Any, *events: Any) -> list[Any]:
    return [f.detail for f in check_ends(first, last, events) if not f.ok]


def test_a_log_from_tick_0_to_the_plant_s_last_word_is_whole() -> None:
    assert wrong({0: 0}, {0: 500}, event("finished", 500)) == []
    assert wrong({0: 0}, {0: 123}, event("interrupted", 123)) == []
    resets = event("reset", 0, 1, from_tick=70), event("finished", 500, 1)
    assert wrong({0: 0, 1: 0}, {0: 70, 1: 500}, *resets) == []


def test_ticks_before_the_recorder_came_are_counted() -> None:
    assert wrong({0: 42}, {0: 500}, event("finished", 500)) == [
        "42 ticks missing: epoch 0 begins at tick 42"
    ]


def test_ticks_after_the_recorder_left_are_counted_where_the_plant_tells_them() -> None:
    late = event("finished", 500), event("finished", 500, source="recorder")
    assert wrong({0: 0}, {0: 460}, *late) == ["40 ticks missing: epoch 0 was flown to tick 500"]
    reset = event("reset", 0, 1, from_tick=70), event("finished", 5, 1)
    assert wrong({0: 0, 1: 0}, {0: 60, 1: 5}, *reset) == [
        "10 ticks missing: epoch 0 was flown to tick 70"
    ]


def test_a_bench_that_is_reset_again_before_it_starts_lacks_no_tick() -> None:
    resets = [event("reset", 0, epoch, from_tick=30 * (epoch == 1)) for epoch in (1, 2, 3)]
    starts = event("started", 0), event("started", 0, 3)
    last = event("finished", 5, 3)
    assert wrong({0: 0, 3: 0}, {0: 30, 3: 5}, *starts, *resets, last) == []
    # one that started had a truth at tick 0
    again = event("started", 0, 2)
    assert wrong({0: 0, 3: 0}, {0: 30, 3: 5}, *starts, *resets, again, last) == [
        "1 tick missing: epoch 2 was flown to tick 0"
    ]


def test_a_log_without_the_plant_s_last_word_says_so() -> None:
    assert wrong({0: 0}, {0: 460}, event("started", 0)) == [
        "the plant's final event is missing: it may have run on from tick 460"
    ]
