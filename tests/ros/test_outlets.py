"""Copies for the log: past DDS while the recorder alone listens, and always once in the log."""

from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Event
from time import monotonic
from typing import Any

import pytest
import rclpy
from flexslew_msgs.msg import PlantState
from rclpy.node import Node
from rclpy.serialization import serialize_message

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.replay.resim import resim
from flexslew_lab.ros.hidden_listener import HiddenListener
from flexslew_lab.run.domain import locked_domain
from flexslew_plant.direct.inbox import PART, RecorderInput
from flexslew_plant.direct.line import LARGEST
from flexslew_plant.direct.names import RECORDER, SETTING, address
from flexslew_plant.graph.topics import TOPICS, TRUTH
from flexslew_plant.ros.offers import qos
from flexslew_plant.ros.outlet import DirectPublisher, LoopCounter
from flexslew_plant.ros.outlets import DirectPublishers

from .bystander import beside
from .flight import LONG, Flight, slew

PATIENCE = 60.0  # on a busy machine [wall s]


class Counted:
    """A publisher with so many subscriptions."""

    def __init__(self, count: int) -> None:
        self.handle, self.listening = self, count

    def get_subscription_count(self) -> int:
        return self.listening


@pytest.mark.parametrize(
    ("on_line", "over_dds", "recorder_alone", "processors"),
    [
        (False, 0, False, 1),  # nobody hears copies
        (True, 0, False, 3),
        (True, 1, True, 3),  # the recorder's own
        (True, 1, False, None),  # never: somebody else's
        (True, 2, True, None),
        (False, 1, True, None),
    ],
)
def test_who_waits_awake_leaves_a_processor_to_who_hears_copies(
    on_line: bool, over_dds: int, recorder_alone: bool, processors: int | None
) -> None:
    outlet = DirectPublisher(Counted(over_dds))
    outlet.number, outlet.recorder_only = on_line - 1, recorder_alone
    enough = [n for n in range(1, 65) if outlet.can_busy_wait(n)]
    assert enough == ([] if processors is None else list(range(processors, 65)))


def test_within_a_turn_of_the_loop_nobody_comes_or_goes() -> None:
    dds, turns = Counted(0), LoopCounter()
    within, outside = DirectPublisher(dds, loop_counter=turns), DirectPublisher(dds)
    assert [one.received for one in (within, outside)] == [False, False]
    dds.listening = 1
    assert [one.received for one in (within, outside)] == [False, True]
    turns.count += 1
    assert [one.received for one in (within, outside)] == [True, True]


class Recorded:
    """A node that publishes the truth, and what a recorder hears of it."""

    def __init__(self, domain: int) -> None:
        context = rclpy.Context()
        context.init(domain_id=domain)
        self.context, self.node = context, Node("publishing", context=context)
        self.direct_publishers = DirectPublishers(self.node)
        self.offer = self.direct_publishers.publisher(TRUTH)
        self.listener: HiddenListener | None = None
        self.over_dds: list[bytes] = []
        self.others: list[bytes] = []
        self.log: list[bytes] = []
        self._executor = rclpy.executors.SingleThreadedExecutor(context=context)
        self._executor.add_node(self.node)

    def record(self) -> None:
        """Begin to listen, over DDS and directly."""
        node = Node("recorder", context=self.context)
        self.listener = HiddenListener(node, {"/truth": TOPICS[TRUTH]})
        where = address(self.context.get_domain_id(), "/measurement", RECORDER)
        self.inbox = RecorderInput(where, {"/truth": "/truth"}, ("_recorder", "/"))

    def overhear(self) -> Any:
        """Listen as anybody does."""
        hear = self.others.append
        return self.node.create_subscription(PlantState, TRUTH, hear, qos(TOPICS[TRUTH]), raw=True)

    def until(self, condition: Callable[[], bool]) -> None:
        """Serve the graph, and record, until something is true."""
        end = monotonic() + PATIENCE
        while not condition():
            assert monotonic() < end
            self.direct_publishers.turn()
            self.direct_publishers.look(monotonic())
            self._executor.spin_once(timeout_sec=0.01)
            if self.listener is not None:
                heard = [taken[:2] for taken in self.listener.take()]
                self.over_dds += [data for _, data in heard]
                self.log += [data for _, data in self.inbox.take(heard)]

    def publish(self, tick: int, tips: int = 2) -> bytes:
        data: bytes = serialize_message(PlantState(tick=tick, tip_deflection=[0.5] * tips))
        self.direct_publishers.turn()
        self.offer.publish(data)
        self.direct_publishers.send()
        return data

    def close(self) -> None:
        if self.listener is not None:
            self.listener.close()
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture
def recorded(monkeypatch: pytest.MonkeyPatch) -> Iterator[Recorded]:
    monkeypatch.setenv(SETTING, "auto")
    with locked_domain() as domain:
        it = Recorded(domain)
        try:
            yield it
        finally:
            it.close()


def part(number: int, data: bytes) -> bytes:
    return PART.pack(number, len(data)) + data


def alone_with_the_recorder(it: Recorded) -> None:
    """Wait until nothing goes over DDS any more."""
    it.record()
    it.until(lambda: it.offer.count == 1 and not it.offer.shared)
    assert it.offer.received


def test_for_the_recorder_alone_nothing_goes_over_dds(recorded: Recorded) -> None:
    assert not recorded.offer.received
    alone_with_the_recorder(recorded)
    sent = [recorded.publish(tick) for tick in range(50)]
    recorded.until(lambda: len(recorded.log) >= 50)
    until = monotonic() + 0.5
    recorded.until(lambda: monotonic() > until)
    assert recorded.log == sent
    assert recorded.over_dds == []


def test_a_node_that_is_killed_takes_no_more_than_8_kb_along(recorded: Recorded) -> None:
    alone_with_the_recorder(recorded)
    messages = [
        serialize_message(PlantState(tick=k, tip_deflection=[0.5] * 100)) for k in range(97)
    ]
    for data in messages:  # within one turn of the loop, which then is never reached
        recorded.offer.publish(data)
    heard: list[bytes] = []
    until = monotonic() + 0.5
    while monotonic() < until:
        heard += [data for _, data in recorded.inbox.take([])]
    assert heard == messages[: len(heard)]
    assert sum(len(part(0, data)) for data in messages[len(heard) :]) <= 8192


def test_who_else_listens_hears_all_and_the_log_has_it_once(recorded: Recorded) -> None:
    alone_with_the_recorder(recorded)
    before = recorded.publish(0)
    other = recorded.overhear()
    recorded.until(lambda: recorded.offer.count == 2)
    sent = [recorded.publish(tick) for tick in range(1, 50)]
    recorded.until(lambda: len(recorded.others) >= 49)
    recorded.until(lambda: len(recorded.over_dds) >= 49)
    assert recorded.others == sent
    assert recorded.log == [before, *sent]
    recorded.node.destroy_subscription(other)
    recorded.until(lambda: not recorded.offer.shared)
    after = recorded.publish(50)
    recorded.until(lambda: recorded.log[-1] == after)
    assert len(recorded.over_dds) == 49


def test_a_second_recorder_of_the_same_name_hears_all(recorded: Recorded) -> None:
    alone_with_the_recorder(recorded)
    second = HiddenListener(Node("recorder", context=recorded.context), {"/truth": TOPICS[TRUTH]})
    recorded.until(lambda: recorded.offer.count == 2)
    until = monotonic() + 0.5
    recorded.until(lambda: monotonic() > until)  # the graph is looked at
    sent = [recorded.publish(tick) for tick in range(50)]
    heard: list[bytes] = []

    def hear() -> bool:
        heard.extend(data for _, data, _ in second.take())
        return len(heard) >= 50

    recorded.until(hear)
    recorded.until(lambda: len(recorded.over_dds) >= 50)
    assert heard == sent == recorded.log
    second.close()


def test_a_message_too_large_for_the_line_goes_over_dds(recorded: Recorded) -> None:
    alone_with_the_recorder(recorded)
    sent = [recorded.publish(0), recorded.publish(1, LARGEST // 8), recorded.publish(2)]
    recorded.until(lambda: len(recorded.log) == 3)
    assert sorted(recorded.log) == sorted(sent)
    assert recorded.over_dds == [sent[1]]


def test_without_direct_lines_all_of_it_goes_over_dds(
    recorded: Recorded, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(SETTING, "dds")
    recorded.direct_publishers = DirectPublishers(recorded.node)
    recorded.offer = recorded.direct_publishers.publisher(TRUTH)
    recorded.record()
    recorded.until(lambda: recorded.offer.count == 1)
    sent = [recorded.publish(tick) for tick in range(50)]
    recorded.until(lambda: len(recorded.log) >= 50)
    assert recorded.log == sent == recorded.over_dds


def test_a_recorder_that_comes_again_is_found(recorded: Recorded) -> None:
    alone_with_the_recorder(recorded)
    assert recorded.listener is not None
    recorded.listener.close()
    recorded.listener = None
    del recorded.inbox
    recorded.until(lambda: not recorded.offer.received)
    alone_with_the_recorder(recorded)
    sent = recorded.publish(7)
    recorded.until(lambda: bool(recorded.log))
    assert recorded.log == [sent]


@pytest.mark.ros
@pytest.mark.parametrize("transport", ["auto", "dds"])
def test_a_log_has_every_tick_once_whoever_listens_in(
    transport: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(SETTING, transport)
    heard: list[int] = []

    def overhear(pids: dict[str, int], domain: int) -> None:
        with beside(domain) as one:
            one.pass_by(1)
            before = one.received
            one.pass_by(300)
            heard.append(one.received - before)
        Event().wait(0.5)  # some ticks more, for the recorder alone
        raise KeyboardInterrupt

    trial = slew(LONG, 10.0, extra="max_missed: 100000")
    flight = Flight(trial, tmp_path, 0, overhear)
    assert flight.outcome.exit_code == 130
    assert heard[0] >= 300
    assert resim(flight.bag).identical
    ticks = BagReader(flight.bag).columns("/truth", {"tick"})["tick"].tolist()
    assert ticks == [*range(len(ticks))]
    assert flight.metrics["log_complete"]
