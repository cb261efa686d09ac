"""What is written is whole up to any moment: no question without its answer but the last ones."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from tests.plant.test_message_codec import transforms

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.messages.cdr import decode, encode
from flexslew_lab.log.recording.open_ticks import PATIENCE
from flexslew_lab.log.recording.recording_order import _SILENCE_TIMEOUT, Ordered, RecordingOrder

PERIOD = 10_000_000  # [ns]
TICKS = 150
ANSWERS = ("/effort_command", "/controller_state")
Message = tuple[str, bytes]


def message(topic: str, tick: int, epoch: int = 0, name: str = "pd", **more: object) -> Message:
    stamp = tick * PERIOD
    fields = {"stamp": stamp, "header": {"stamp": stamp}, "tick": tick, "epoch": epoch}
    return topic, encode(TOPICS[topic].type, fields | {"controller": name} | more)


def missed(tick: int) -> Message:
    return message("/events", tick, kind="missed", data="{}")


def tick_of(message: Ordered) -> int:
    return int(decode(TOPICS[message.topic].type, message.data).tick)


def rounds(seed: int) -> tuple[list[list[Message]], set[int]]:
    """Return what arrives in each round of a run under load, and which ticks are missed.

    Each topic keeps its order, as DDS does, and is held up by itself.
    """
    rng = np.random.default_rng(seed)
    lost = set(rng.choice(TICKS, 10, replace=False).tolist())
    arrivals: list[tuple[float, int, Message]] = []
    late = dict.fromkeys((*ANSWERS, "/measurement", "/truth", "/events"), 0.0)
    for tick in range(TICKS):
        topics = ["/measurement", "/truth", *(() if tick in lost else ANSWERS)]
        for topic in topics:
            held_up = rng.random() < 0.01
            delay = rng.exponential(0.3 if held_up else 0.002)
            late[topic] = max(late[topic], tick * 0.005 + min(delay, 0.9 * PATIENCE))
            arrivals.append((late[topic], len(arrivals), message(topic, tick)))
        if tick in lost:
            late["/events"] = max(late["/events"], (tick + 1) * 0.005)
            arrivals.append((late["/events"], len(arrivals), missed(tick)))
    arrivals.sort()
    end = int(arrivals[-1][0] / 0.01) + 1
    found: list[list[Message]] = [[] for _ in range(end + 1)]
    for at, _, arrived in arrivals:
        found[int(at / 0.01)].append(arrived)
    return found, lost


def written(seed: int) -> Iterator[tuple[list[Ordered], set[int]]]:
    """Yield everything that is written after each round: what a kill then leaves at most."""
    order, log = RecordingOrder(), []
    arriving, lost = rounds(seed)
    for number, arrived in enumerate(arriving):
        log += order.take(arrived, number * 0.01)
        yield log, lost
    yield log + order.take((), len(arriving) * 0.01, last=True), lost


@pytest.mark.first(30)
@pytest.mark.parametrize("seed", range(100))
def test_no_answer_is_missing_before_the_end_of_a_log_that_is_cut_anywhere(seed: int) -> None:
    asked: set[int] = set()
    answered: dict[str, set[int]] = {topic: set() for topic in ANSWERS}
    done, times = 0, []
    for log, lost in written(seed):
        for entry in log[done:]:
            times.append((entry.epoch, entry.at))
            if entry.topic == "/measurement":
                asked.add(tick_of(entry))
            elif entry.topic in ANSWERS:
                answered[entry.topic].add(tick_of(entry))
        done = len(log)
        for topic in ANSWERS:
            assert asked - answered[topic] <= lost
        assert asked == set(range(len(asked)))
    assert times == sorted(times)
    assert len(asked) == TICKS
    assert all(len(ticks) == TICKS - len(lost) for ticks in answered.values())


@pytest.mark.parametrize("seed", range(30))
def test_ticks_that_come_two_ways_are_in_order_whichever_way_is_slower(seed: int) -> None:
    """At first over DDS alone, which is held up; then on the line, which overtakes it."""
    rng = np.random.default_rng(seed)
    order, log = RecordingOrder(), list[Ordered]()
    changed, held_up = int(rng.integers(13, TICKS)), rng.uniform(0.0, 10.0)  # after a first tick
    arriving = []
    for tick in range(TICKS):
        for topic in ("/measurement", "/truth", *ANSWERS):
            both = topic in ("/measurement", "/truth")  # of the plant, whose DDS it is
            slow = held_up if both and changed - 12 <= tick < changed else 0.0
            arriving.append((tick * 0.005 + slow + rng.uniform(0.0, 0.004), message(topic, tick)))
    arriving.sort(key=lambda arrival: arrival[0])
    for at in np.arange(0.0, arriving[-1][0] + 0.01, 0.005):
        due = [which for when, which in arriving if at - 0.005 <= when < at]
        log += order.take(due, float(at))
    log += order.take((), float(at), last=True)
    assert [tick_of(m) for m in log if m.topic == "/measurement"] == list(range(TICKS))
    assert [m.at for m in log] == sorted(m.at for m in log)
    assert len(log) == 4 * TICKS


def test_a_tick_that_never_comes_is_given_up_and_the_next_gap_is_waited_for_again() -> None:
    order = RecordingOrder()
    write(order, message("/measurement", 0), *answers(0))
    for tick in (1, 2, 4, 5, 8, 9):  # 3, 6 and 7 are lost
        order.take([message(topic, tick) for topic in ("/measurement", "/truth", *ANSWERS)], 0.0)
    assert write(order, now=_SILENCE_TIMEOUT) == []
    assert {tick for _, tick in write(order, now=_SILENCE_TIMEOUT + 0.1)} == {4, 5}
    assert write(order, now=2.0 * _SILENCE_TIMEOUT) == []
    assert {tick for _, tick in write(order, now=2.0 * _SILENCE_TIMEOUT + 0.2)} == {8, 9}


def test_an_epoch_begins_with_the_first_tick_that_is_heard_of_it() -> None:
    order = RecordingOrder()
    for epoch, first in ((0, 7), (1, 0), (2, 3)):
        for tick in range(first, first + 3):
            write(order, message("/measurement", tick, epoch), *answers(tick, epoch=epoch))
    assert order.take((), 0.0, last=False) != []
    assert order.take((), 0.0, last=True) == []


def write(order: RecordingOrder, *messages: Message, now: float = 0.0) -> list[tuple[str, int]]:
    """Let the messages arrive, each question with the truth; return what else is written."""
    questions = [decode(TOPICS[t].type, data) for t, data in messages if t == "/measurement"]
    truths = [message("/truth", question.tick, question.epoch) for question in questions]
    found = order.take((*messages, *truths), now)
    return [(entry.topic, tick_of(entry)) for entry in found if entry.topic != "/truth"]


def test_an_answer_is_waited_for_no_longer_than_patience() -> None:
    order = RecordingOrder()
    write(order, message("/measurement", 0))
    assert write(order, message("/measurement", 1), now=0.5) == []
    found = write(order, message("/measurement", 2), now=0.1 + PATIENCE)
    assert found == [("/measurement", 0)]


def test_a_truth_that_was_heard_is_waited_for_and_one_that_never_comes_is_not() -> None:
    for heard in (True, False):
        order = RecordingOrder()
        first = [message(topic, 0) for topic in ("/measurement", *ANSWERS, "/truth")]
        order.take(first if heard else first[:-1], 0.0)
        order.take([message(topic, 1) for topic in ("/measurement", *ANSWERS)], 0.01)
        order.take((), 0.02)
        found = order.take([message("/measurement", 2)], 5.0 * PATIENCE)
        assert (1 in map(tick_of, found)) is not heard
        if heard:
            order.take([message("/truth", 1)], 5.0 * PATIENCE)
            assert 1 in map(tick_of, order.take((), 5.1 * PATIENCE))


def test_a_controller_that_never_says_its_state_is_waited_for_once() -> None:
    order = RecordingOrder()
    for tick in range(4):
        write(order, message("/measurement", tick), message("/effort_command", tick))
    assert [tick for _, tick in write(order, now=2 * PATIENCE)] == [0, 0, 1, 1, 2, 2, 3, 3]
    for tick in range(4, 7):
        found = write(order, message("/measurement", tick), message("/effort_command", tick))
    assert [tick for _, tick in found] == [5, 5]  # as soon as there is something newer


def answers(tick: int, name: str = "pd", epoch: int = 0) -> list[Message]:
    return [message(topic, tick, epoch, name) for topic in ANSWERS]


def test_an_answer_of_another_controller_settles_nothing_and_the_brake_needs_none() -> None:
    order = RecordingOrder()
    write(order, message("/measurement", 5), *answers(5, "other"))
    write(order, message("/measurement", 6, name=""))
    assert write(order) == []
    assert len(write(order, *answers(5))) == 6


def test_an_answer_may_come_before_its_question() -> None:
    order = RecordingOrder()
    write(order, *answers(5))
    write(order, message("/measurement", 5))
    assert len(write(order)) == 3


def test_a_refused_switch_asks_another_and_both_are_there() -> None:
    order = RecordingOrder()
    write(order, message("/measurement", 5, name="new"))
    write(order, message("/measurement", 5), message("/measurement", 6))
    assert write(order) == []
    assert len(write(order, *answers(5))) == 4


def test_a_repeated_question_that_was_answered_is_not_waited_for_again() -> None:
    order = RecordingOrder()
    write(order, message("/measurement", 5), *answers(5))
    again = message("/measurement", 5)
    assert len(write(order, again, message("/measurement", 6), *answers(6))) == 4
    assert len(write(order)) == 3


PLAN: dict[str, Any] = {"joint_names": ["a"], "period": 0.01, "position": [float("nan")]}


@pytest.mark.parametrize(
    "odd",
    [
        message("/events", 1, kind="note", data="{"),
        message("/events", 1, kind="note", data='{"text": 7}'),
        message("/events", 1, kind="note", data="{}", level=9),
        message("/testbed", 1, settings="{}", joint_names=["a"]),
        message("/controller_status", 1, settings="{"),
        message("/plan", 1, **PLAN),
        ("/clock", encode(TOPICS["/clock"].type, {"clock": -PERIOD})),
        ("/joint_states", encode(TOPICS["/joint_states"].type, {"header": {"stamp": -1}})),
    ],
)
def test_a_message_with_which_no_reader_takes_the_log_is_left_out(odd: Message) -> None:
    order = RecordingOrder()
    arrived = [message("/truth", 0), odd, message("/measurement", 0)]
    done = order.take(arrived, 0.0, last=True)
    assert [one.topic for one in done] == ["/measurement", "/truth"]
    assert order.invalid_topics == {odd[0]}


def test_a_status_stands_in_the_epoch_that_it_tells() -> None:
    """One that came before the first question of its epoch stood before the end of the last."""

    def status(tick: int, epoch: int) -> Message:
        return message("/controller_status", tick, epoch, settings="{}", last_tick=tick)

    order, last = RecordingOrder(), [message("/truth", 7), message("/measurement", 7)]
    again = [message("/measurement", 0, 1), message("/truth", 0, 1)]
    done = order.take([*last, status(7, 0), status(0, 1)], 0.0)
    done += order.take([*again, status(8, 0)], 0.1)
    done += order.take([], 0.2, last=True)
    told = [(one.topic, one.epoch, one.at // PERIOD) for one in done]
    assert told == [
        ("/measurement", 0, 7),
        ("/truth", 0, 7),
        ("/controller_status", 0, 7),
        ("/controller_status", 0, 8),
        ("/measurement", 1, 0),
        ("/truth", 1, 0),
        ("/controller_status", 1, 0),
    ]


@pytest.mark.parametrize("topic", ["/joint_states", "/tf", "/clock"])
@pytest.mark.parametrize(("ahead", "flown"), [(0, 1), (0, 4), (1, 4), (3, 4)])  # ticks
def test_what_is_displayed_ahead_of_the_first_question_of_an_epoch_is_of_that_epoch(
    topic: str, ahead: int, flown: int
) -> None:
    """Topics overtake one another on DDS, as where a log with a reset is played at full speed."""

    def shown(tick: int) -> Message:
        stamp = {"stamp": tick * PERIOD}
        if topic == "/tf":
            return topic, transforms({"header": stamp, "child_frame_id": "hub"})
        return topic, encode(TOPICS[topic].type, {"header": stamp, "clock": tick * PERIOD})

    def tick(number: int, epoch: int) -> list[Message]:
        return [message(name, number, epoch) for name in ("/measurement", "/truth", *ANSWERS)]

    order, done = RecordingOrder(), []
    for number in range(flown):
        done += order.take([*tick(number, 0), shown(number)], 0.01 * number)
    done += order.take([shown(number) for number in range(ahead)], 0.05)
    for number in range(4):
        more = [shown(number)] if number >= ahead else []
        done += order.take([*tick(number, 1), *more], 0.06 + 0.01 * number)
    done += order.take([], 1.0, last=True)
    assert [(one.epoch, one.at) for one in done] == sorted((one.epoch, one.at) for one in done)
    told = [(one.epoch, one.at // PERIOD) for one in done if one.topic == topic]
    assert told == [(0, k) for k in range(flown)] + [(1, k) for k in range(4)]


def test_a_display_that_goes_back_without_a_reset_is_not_kept_for_long() -> None:
    order = RecordingOrder()
    clock = [("/clock", encode(TOPICS["/clock"].type, {"clock": k * PERIOD})) for k in range(3)]
    for number in range(3):
        order.take([message("/measurement", number), message("/truth", number)], 0.0)
    found = order.take([clock[2], clock[0]], 0.1)
    found += order.take([clock[1]], 0.2)
    found += order.take([], 0.3 + PATIENCE)
    found += order.take([], 0.4 + PATIENCE)
    assert [one.topic for one in found if one.topic == "/clock"] == ["/clock"] * 3
