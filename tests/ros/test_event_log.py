"""What a node shows to people of its events: all of them, but of a flood a few."""

from types import SimpleNamespace
from typing import Any

import pytest

from flexslew_plant.events import AnswerMissing, Fact, SwitchDropped, event_of
from flexslew_plant.refusal import Cause
from flexslew_plant.ros import event_log
from flexslew_plant.ros.event_log import EventLog


def test_of_many_missed_ticks_the_topic_has_all_and_the_log_a_few(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A supervisor that reads nothing for a while must not hold up the plant by a full pipe."""
    published, logged = list[Any](), list[str]()
    handle = SimpleNamespace(publish_raw=published.append, get_subscription_count=lambda: 0)
    topic = SimpleNamespace(handle=handle, topic_name="/events")
    monkeypatch.setattr(event_log, "publisher", lambda node, name: topic)
    logger = SimpleNamespace(warning=logged.append)
    node: Any = SimpleNamespace(get_logger=lambda: logger)
    one = EventLog(node)

    def tell(what: Fact) -> None:
        one.tell(event_of(what, 3, 0.03, 0, "plant"))

    for number in range(1, 1001):
        tell(AnswerMissing("lqr", number))
    assert len(published) == 1000
    shown = [int(words.rpartition("(")[2].split()[0]) for words in logged]
    assert shown == [1, 2, 4, 8, 16, 32, 64, 128, 256, 512]
    tell(AnswerMissing("lqr", 1))  # the next flood begins anew
    tell(SwitchDropped("lqr", Cause.NOT_READY))
    assert len(logged) == 12
