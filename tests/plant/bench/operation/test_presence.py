import pytest

from flexslew_plant.bench.operation.presence import BEAT_EVERY, SILENT_AFTER, Beat, Presence

OLD, YOUNG = Beat("a", "controller", 5, 100), Beat("a", "controller", 4, 200)


def test_who_beats_is_alive_and_who_stops_is_silent_within_a_second() -> None:
    presence = Presence()
    assert not presence.silent("a", 0.0)  # never heard is not silent
    presence.hear(OLD, 10.0)
    assert presence.alive(10.0 + 0.99 * SILENT_AFTER) == {"a": OLD}
    assert presence.silent("a", 11.0)
    presence.hear(OLD, 12.0)
    assert not presence.silent("a", 12.5)


def test_the_silence_of_a_listener_that_did_not_listen_counts_against_nobody() -> None:
    presence = Presence()
    presence.hear(OLD, 10.0)
    presence.excuse(30.0)
    assert not presence.silent("a", 40.5)


def test_of_two_with_one_name_the_younger_steps_back() -> None:
    presence = Presence()
    presence.hear(OLD, 0.0)
    presence.hear(YOUNG, 0.0)
    assert presence.older(YOUNG, 0.5) == OLD
    assert presence.older(OLD, 0.5) is None
    assert presence.younger(OLD, 0.5) == [YOUNG]
    assert presence.alive(0.5) == {"a": OLD}
    assert presence.older(YOUNG, 5.0) is None  # the older one has gone


@pytest.mark.parametrize("role", ["plant", "planner"])
def test_two_of_which_a_bench_has_one_are_rivals_under_any_name(role: str) -> None:
    presence = Presence()
    first, second = Beat("one", role, 1, 1), Beat("other", role, 2, 2)
    presence.hear(first, 0.0)
    assert presence.older(second, 0.1) == first
    assert presence.older(Beat("b", "controller", 3, 3), 0.1) is None


def test_who_is_silent_for_long_is_lost_and_a_stranger_is_not() -> None:
    presence = Presence()
    presence.hear(OLD, 0.0)
    assert presence.lost(["a", "stranger"], 5.0, 4.0) == set()
    assert presence.lost(["a", "stranger"], 5.0, 6.0) == {"a"}


def test_who_misses_a_beat_is_overdue_long_before_it_is_silent() -> None:
    presence = Presence()
    presence.hear(OLD, 10.0)
    assert presence.overdue(10.0 + BEAT_EVERY) == []
    assert presence.overdue(10.0 + 0.5 * SILENT_AFTER) == [OLD]
    presence.hear(OLD, 11.0)
    assert presence.overdue(11.1) == []
