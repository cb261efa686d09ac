"""A plant with a clock of its own, on a transport and a wall clock that the test moves."""

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from flexslew_lab.run.in_process import run_bench
from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.errors import BadInput
from flexslew_plant.events import PlantTicksMissed, WallTimes
from flexslew_plant.external.messages import (
    Message,
    MessageKind,
    PlantFault,
    decoded,
    json_bytes,
    number_bytes,
)
from flexslew_plant.external.own_clock import ClockedPlant, ClockLimits
from flexslew_plant.external.plant_link import Hello, PlantLink
from flexslew_plant.measurement import EffortCommand
from flexslew_plant.testbeds.black_box.external import ExternalTestbed
from flexslew_plant.testbeds.black_box.plant_address import PlantAddress

PERIOD = 0.1  # [s]
DESCRIPTION = {
    "protocol": 1,
    "joints": [{"name": "hub", "unit": "rad", "limit": 1.0}],
    "clock": "own",
    "period": PERIOD,
    "brake": True,
}


class Rig:
    """A rig of one joint whose position is its tick; it is also the wall clock.

    Args:
        lost: ticks whose measurement gets lost.
        ends: tick after which it is silent.
        brakes: whether it acknowledges BRAKE.
        deaf: how many efforts get lost before one starts its clock.
    """

    name = "rig"
    timeout = 5.0

    def __init__(
        self, lost: tuple[int, ...] = (), ends: int = 1000, brakes: bool = True, deaf: int = 0
    ) -> None:
        self.lost, self.ends, self.brakes, self.deaf = lost, ends, brakes, deaf
        self.now = self.start = 0.0
        self.epoch = self.tick = 0
        self.runs = False
        self.sent: list[tuple[int, float]] = []  # tick and value of each effort
        self.error = ""

    def ask(self, question: bytes, kind: MessageKind, epoch: int, tick: int) -> Message:
        asked = decoded(question).kind
        body = b""
        if asked == MessageKind.HELLO:
            body = json_bytes(DESCRIPTION)
        elif asked == MessageKind.RESET:
            self.epoch, self.tick, self.runs, body = epoch, 0, False, number_bytes(np.zeros(2))
        elif not self.brakes:
            raise PlantFault("rig: no answer within 1 s")
        else:
            self.runs = False
        return Message(kind, epoch, tick, body)

    def send(self, message: bytes) -> None:
        effort = decoded(message)
        assert (effort.kind, effort.epoch) == (MessageKind.EFFORT, self.epoch)
        self.sent.append((effort.tick, float(np.frombuffer(effort.body)[0])))
        if self.deaf:
            self.deaf -= 1
        elif not self.runs and effort.tick == 0:
            self.runs, self.start = True, self.now

    def receive(self, timeout: float) -> Message | None:
        if self.error:
            return Message(MessageKind.ERROR, self.epoch, self.tick, self.error.encode())
        end = self.now + timeout
        while self.runs and self.tick < self.ends:
            due = self.start + (self.tick + 1) * PERIOD
            if due > end:
                break
            self.now = max(self.now, due)
            self.tick += 1
            if self.tick not in self.lost:
                body = number_bytes(np.array([float(self.tick), 0.0]))
                return Message(MessageKind.MEASUREMENT, self.epoch, self.tick, body)
        self.now = end
        return None

    def set_timeout(self, timeout: float) -> None:
        self.timeout = timeout

    def close(self) -> int:
        return 0


def plant_of(rig: Rig, watchdog: int = 5, missed: int = 3) -> ClockedPlant:
    link = PlantLink(rig, Hello(PERIOD, {}, {}))
    plant = ClockedPlant(link, PERIOD, ClockLimits(2.0, watchdog, missed), lambda: rig.now)
    plant.reset()
    return plant


def fly(plant: ClockedPlant, ticks: int, think: Callable[[int], None] = lambda tick: None) -> Any:
    """Return the positions of some ticks; the effort of a tick is its number."""
    found = []
    for tick in range(ticks):
        think(tick)
        found.append(float(plant.advance(np.array([float(tick)]))[0]))
    return found


def test_each_measurement_is_answered_by_the_effort_of_its_tick() -> None:
    rig = Rig()
    plant = plant_of(rig)
    assert fly(plant, 20, lambda tick: setattr(rig, "now", rig.now + 0.02)) == list(range(1, 21))
    assert rig.sent == [(tick, float(tick)) for tick in range(20)]
    plant.stop()
    response, interval = plant.facts
    assert isinstance(response, WallTimes)
    assert isinstance(interval, WallTimes)
    assert (response.quantity, response.steps, interval.steps) == ("response", 19, 19)
    assert (response.median, response.jitter) == pytest.approx((0.02, 0.0), rel=0.01, abs=1e-12)
    assert (interval.least, interval.longest) == pytest.approx((PERIOD, PERIOD))


def test_an_effort_that_starts_the_clock_is_repeated_and_no_other() -> None:
    rig = Rig(deaf=3)
    assert fly(plant_of(rig), 3) == [1.0, 2.0, 3.0]
    assert [tick for tick, _ in rig.sent] == [0, 0, 0, 0, 1, 2]


def test_a_lost_measurement_is_a_missed_tick_with_the_one_before_in_its_place() -> None:
    rig = Rig(lost=(4, 5, 9))
    plant = plant_of(rig)
    assert fly(plant, 11) == [1.0, 2.0, 3.0, 3.0, 3.0, 6.0, 7.0, 8.0, 8.0, 10.0, 11.0]
    assert list(plant.facts) == [PlantTicksMissed(5, 2, 2, 0), PlantTicksMissed(9, 1, 1, 0)]


def test_efforts_that_leave_after_the_next_measurement_are_late() -> None:
    rig = Rig()
    plant = plant_of(rig)

    def think(tick: int) -> None:
        rig.now += 2.5 * PERIOD if tick == 5 else 0.01

    assert fly(plant, 12, think) == list(range(1, 13))
    (missed,) = plant.facts
    assert isinstance(missed, PlantTicksMissed)
    assert (missed.lost, missed.late, missed.ticks) == (0, 2, 2)


def test_too_many_missed_ticks_in_a_row_end_the_run_with_the_brake() -> None:
    rig = Rig(lost=tuple(range(5, 9)))
    plant = plant_of(rig)
    with pytest.raises(PlantFault, match="4 ticks in a row are missed, 4 lost and 0 late; 3 are"):
        fly(plant, 20)
    assert not rig.runs
    assert [type(fact) for fact in plant.facts] == [PlantTicksMissed]


@pytest.mark.parametrize(("brakes", "words"), [(True, "is on"), (False, "is not acknowledged")])
def test_a_silent_rig_is_lost_after_the_watchdog_and_braked(brakes: bool, words: str) -> None:
    rig = Rig(ends=7, brakes=brakes)
    plant = plant_of(rig)
    expected = f"rig: no measurement for 0.5 s after tick 7; its brake {words}"
    with pytest.raises(PlantFault, match=re.escape(expected)):
        fly(plant, 20)
    assert rig.now == pytest.approx(0.7 + 0.5)
    assert rig.runs is not brakes


def test_a_stall_of_the_bench_is_no_silence_of_the_rig() -> None:
    rig = Rig()
    plant = plant_of(rig, watchdog=2, missed=10)

    def think(tick: int) -> None:
        rig.now += 8.0 * PERIOD if tick == 5 else 0.0

    assert fly(plant, 20, think) == list(range(1, 21))


def test_an_error_of_the_rig_ends_the_run() -> None:
    rig = Rig()
    plant = plant_of(rig)
    fly(plant, 3)
    rig.error = "the hub is too hot"
    with pytest.raises(PlantFault, match="rig: reports: the hub is too hot"):
        fly(plant, 1)


def test_a_reset_brakes_and_begins_again() -> None:
    rig = Rig()
    plant = plant_of(rig)
    fly(plant, 5)
    assert plant.reset()[0] == 0.0
    assert not rig.runs
    assert (fly(plant, 3), rig.epoch) == ([1.0, 2.0, 3.0], 1)


def test_a_brake_that_is_not_acknowledged_is_a_fault() -> None:
    plant = plant_of(Rig(brakes=False))
    fly(plant, 2)
    with pytest.raises(PlantFault, match="its brake is not acknowledged: rig: no answer"):
        plant.stop()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"clock": "sun"}, "clock: 'sun'; allowed: bench, own"),
        ({"period": 0.0}, "period: 0.0; give the period of its clock, above 0"),
        ({"brake": False}, "brake: false; a plant with a clock of its own needs a brake"),
        ({"brake": "yes"}, "brake: 'yes'; give true or false"),
    ],
)
def test_a_description_without_what_a_rig_needs_is_refused(
    change: dict[str, Any], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for key, value in change.items():
        monkeypatch.setitem(DESCRIPTION, key, value)
    with pytest.raises(PlantFault, match=re.escape(f"rig: its description: {words}")):
        plant_of(Rig())


def rig_testbed(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(PlantAddress, "connect", lambda address: rig)
    return ExternalTestbed(
        serial="/dev/ttyX", clock="own", joints=("hub",), joint_units=("rad",), effort_limit=(1.0,)
    )


def test_a_rig_of_another_period_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    testbed = rig_testbed(Rig(), monkeypatch)
    with pytest.raises(BadInput, match=r"period: 0\.02 is not allowed: /dev/ttyX measures each 0"):
        testbed.start(0.02)


@pytest.mark.parametrize(("brakes", "words"), [(True, "is on"), (False, "is not acknowledged")])
def test_without_a_controller_the_brake_of_the_rig_ends_the_run(
    brakes: bool, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = Rig(brakes=brakes)
    testbed = rig_testbed(rig, monkeypatch)
    bench = Bench(BenchSettings(testbed=testbed, period=PERIOD, duration=10.0, active="a"))
    for tick in range(100):
        if tick == 4:
            assert bench.brake(True) is None
        if bench.done:
            break
        bench.offer(EffortCommand(bench.tick, 0, bench.drive.active, np.zeros(1)))
        bench.advance()
    assert (bench.tick, bench.faulted, rig.runs) == (5, True, not brakes)
    assert f"no controller is active; its brake {words}" in bench.failure


def test_however_a_run_ends_the_rig_is_braked(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig()
    testbed = rig_testbed(rig, monkeypatch)
    bench = Bench(BenchSettings(testbed=testbed, period=PERIOD, duration=10.0, active="a"))

    receive = rig.receive

    def interrupted(timeout: float) -> Message | None:
        if rig.tick == 3:
            raise KeyboardInterrupt
        return receive(timeout)

    monkeypatch.setattr(rig, "receive", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_bench(bench, {})
    assert (rig.tick, rig.runs) == (3, False)
