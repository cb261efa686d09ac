"""The recorder's ends of its lines: everything once, whichever way it comes, and strangers."""

import os
from itertools import count, repeat

import numpy as np
import pytest

from flexslew_plant.direct.inbox import DDS_FLAG, PART, RecorderInput
from flexslew_plant.direct.line import DirectLine, call, facts
from flexslew_plant.direct.names import RECORDER, address
from flexslew_plant.graph.topics import LOOP_DEPTH
from flexslew_plant.message_codec import HEAD

numbers = count(1000 * os.getpid())  # of benches that nobody else has
HEARD = {"/b/truth": "/truth", "/b/events": "/events"}


@pytest.fixture
def place() -> bytes:
    return address(next(numbers), "/b/measurement", RECORDER)


@pytest.fixture
def inbox(place: bytes) -> RecorderInput:
    return RecorderInput(place, HEARD, ("_recorder", "/b"))


def part(number: int, data: bytes) -> bytes:
    return PART.pack(number, len(HEAD + data)) + HEAD + data


def taken(inbox: RecorderInput, *over_dds: tuple[str, bytes]) -> list[tuple[str, bytes]]:
    """Return what an inbox yields, without the heads."""
    heard = [(topic, HEAD + data) for topic, data in over_dds]
    return [(topic, data[len(HEAD) :]) for topic, data in inbox.take(heard)]


def greeted(inbox: RecorderInput, place: bytes, *names: str) -> DirectLine:
    """Return a publisher's end after both have said who they are."""
    line = call(place)
    assert line is not None
    line.notify({"topics": list(names)})
    assert taken(inbox) == []
    heard = [name for name in names if name in HEARD]
    said = {"node": "_recorder", "namespace": "/b", "heard": heard}
    assert facts(line.receive() or b"") == said
    return line


def test_parts_come_in_their_order_under_the_recorder_s_names(
    inbox: RecorderInput, place: bytes
) -> None:
    line = greeted(inbox, place, "/b/truth", "/b/elsewhere", "/b/events")
    line.send(part(1, b"event") + part(0, b"") + part(0, b"truth"))
    line.send(part(0, b"more"))
    assert taken(inbox, ("/joint_states", b"over DDS")) == [
        ("/events", b"event"), ("/truth", b""), ("/truth", b"truth"), ("/truth", b"more"),
        ("/joint_states", b"over DDS"),
    ]  # fmt: skip


def test_what_was_sent_before_the_end_of_a_publisher_is_taken(
    inbox: RecorderInput, place: bytes
) -> None:
    line = greeted(inbox, place, "/b/truth")
    line.send(part(0, b"last words"))
    line.close()
    assert taken(inbox) == [("/truth", b"last words")]
    greeted(inbox, place, "/b/truth").send(part(0, b"next"))
    assert taken(inbox) == [("/truth", b"next")]


def test_everything_comes_as_often_as_it_was_published(
    inbox: RecorderInput, place: bytes, case: np.random.Generator
) -> None:
    line = greeted(inbox, place, "/b/truth")
    published: list[bytes] = []
    late: list[tuple[str, bytes]] = []  # what DDS has still to bring
    queued: list[bytes] = []  # what the line has
    found: list[bytes] = []
    for _ in range(300):
        data = b"%d" % case.integers(20)  # a question is repeated now and then
        published.append(data)
        way = case.integers(3)  # the line alone, both, DDS alone: of a publisher without a line
        if way < 2:
            queued.append(part(DDS_FLAG * int(way), data))
        if way > 0:
            late.append(("/truth", data))
        if case.random() < 0.3:
            for _ in range(int(case.integers(len(queued) + 1))):
                line.send(queued.pop(0))
        if case.random() < 0.3:
            arrived = [late.pop(0) for _ in range(int(case.integers(len(late) + 1)))]
            found += [data for _, data in taken(inbox, *arrived)]
    for message in queued:
        line.send(message)
    found += [data for _, data in taken(inbox, *late)]
    # of the same bytes from two publishers one may be taken for the copy of the other
    assert {*found} == {*published}
    alone = [data for data in published if published.count(data) == 1]
    assert all(found.count(data) == 1 for data in alone)


def test_a_publisher_that_goes_both_ways_is_heard_once(
    inbox: RecorderInput, place: bytes, case: np.random.Generator
) -> None:
    line = greeted(inbox, place, "/b/truth")
    published = [b"%d" % case.integers(20) for _ in range(300)]
    ways: list[list[bytes]] = [list(published), list(published)]  # line, DDS
    found: list[bytes] = []
    while any(ways):
        several = int(case.integers(1, 9))
        for _ in range(int(case.integers(1, 9))):
            if ways[0]:
                line.send(part(DDS_FLAG, ways[0].pop(0)))
        some, ways[1] = ways[1][:several], ways[1][several:]
        found += [data for _, data in taken(inbox, *zip(repeat("/truth"), some))]
    assert sorted(found) == sorted(published)
    assert not inbox._once


def test_what_never_comes_the_other_way_is_forgotten(inbox: RecorderInput, place: bytes) -> None:
    greeted(inbox, place, "/b/truth")
    for k in range(3 * LOOP_DEPTH):
        assert taken(inbox, ("/truth", b"%d" % k)) == [("/truth", b"%d" % k)]
    assert len(inbox._once) <= 2 * LOOP_DEPTH


@pytest.mark.parametrize(
    "words",
    [b"", b"?", b"[]", b"{}", b'{"topics": "/b/truth"}', b'{"topics": [1, null, {}]}'],
)
def test_whoever_says_nothing_of_the_kind_disturbs_nobody(
    inbox: RecorderInput, place: bytes, words: bytes
) -> None:
    line, stranger = greeted(inbox, place, "/b/truth"), call(place)
    assert stranger is not None
    if words:
        stranger.send(words)
    line.send(part(0, b"one"))
    assert taken(inbox) == [("/truth", b"one")]
    stranger.close()
    line.send(part(0, b"two"))
    assert taken(inbox) == [("/truth", b"two")]


@pytest.mark.parametrize(
    "wrong",
    [
        b"?",
        part(7, b"data"),
        part(0, b"good") + b"\0\1",
        part(0, b"good")[:-1],
        PART.pack(0, 4) + b"good",
    ],
)
def test_a_publisher_that_is_not_understood_is_let_go(
    inbox: RecorderInput, place: bytes, wrong: bytes
) -> None:
    line, other = (greeted(inbox, place, "/b/truth") for _ in range(2))
    line.send(wrong)
    other.send(part(0, b"right"))
    assert ("/truth", b"right") in taken(inbox)
    line.send(part(0, b"gone"))
    other.send(part(0, b"there"))
    assert taken(inbox) == [("/truth", b"there")]
