import pytest

from flexslew_plant.bench.operation.presence import (
    HEARTBEAT_PERIOD,
    HEARTBEAT_TIMEOUT,
    Heartbeat,
    Heartbeats,
)

OLD, YOUNG = Heartbeat("a", "controller", 5, 100), Heartbeat("a", "controller", 4, 200)


def test_who_beats_is_alive_and_who_stops_is_silent_within_a_second() -> None:
    presence = Heartbeats()
    assert not presence.inactive("a", 0.0)  # never heard is not silent
    presence.receive(OLD, 10.0)
    assert presence.alive(10.0 + 0.99 * HEARTBEAT_TIMEOUT) == {"a": OLD}
    assert presence.inactive("a", 11.0)
    presence.receive(OLD, 12.0)
    assert not presence.inactive("a", 12.5)


def test_the_silence_of_a_listener_that_did_not_listen_counts_against_nobody() -> None:
    presence = Heartbeats()
    presence.receive(OLD, 10.0)
    presence.extend_timeouts(30.0)
    assert not presence.inactive("a", 40.5)


def test_of_two_with_one_name_the_younger_steps_back() -> None:
    presence = Heartbeats()
    presence.receive(OLD, 0.0)
    presence.receive(YOUNG, 0.0)
    assert presence.previous(YOUNG, 0.5) == OLD
    assert presence.previous(OLD, 0.5) is None
    assert presence.later(OLD, 0.5) == [YOUNG]
    assert presence.alive(0.5) == {"a": OLD}
    assert presence.previous(YOUNG, 5.0) is None  # the older one has gone


@pytest.mark.parametrize("role", ["plant", "planner"])
def test_two_of_which_a_bench_has_one_are_rivals_under_any_name(role: str) -> None:
    presence = Heartbeats()
    first, second = Heartbeat("one", role, 1, 1), Heartbeat("other", role, 2, 2)
    presence.receive(first, 0.0)
    assert presence.previous(second, 0.1) == first
    assert presence.previous(Heartbeat("b", "controller", 3, 3), 0.1) is None


def test_who_is_silent_for_long_is_lost_and_a_stranger_is_not() -> None:
    presence = Heartbeats()
    presence.receive(OLD, 0.0)
    assert presence.lost(["a", "stranger"], 5.0, 4.0) == set()
    assert presence.lost(["a", "stranger"], 5.0, 6.0) == {"a"}


def test_who_misses_a_beat_is_overdue_long_before_it_is_silent() -> None:
    presence = Heartbeats()
    presence.receive(OLD, 10.0)
    assert presence.late_heartbeats(10.0 + HEARTBEAT_PERIOD) == []
    assert presence.late_heartbeats(10.0 + 0.5 * HEARTBEAT_TIMEOUT) == [OLD]
    presence.receive(OLD, 11.0)
    assert presence.late_heartbeats(11.1) == []
