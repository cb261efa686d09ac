"""A recorder that is killed under load: what its log lacks."""

import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.recording.bag_writer import CHUNK_SIZE
from flexslew_lab.log.recover import recover
from tests.ros.bystander import beside, busy
from tests.ros.flight import Flight, slew

pytestmark = pytest.mark.ros

MOST = 100  # ticks, or one chunk


class Killing:
    """Stops the plant, kills the recorder, then the plant, whose last tick is noted."""

    def __init__(self, after: int) -> None:
        self._after = after  # measurements that are heard before
        self.tick = -1

    def __call__(self, pids: dict[str, int], domain: int) -> None:
        with beside(domain) as bench:
            with busy(2):
                bench.until(lambda: bench.received >= self._after)
                os.kill(pids["plant"], signal.SIGSTOP)
                os.kill(pids["recorder"], signal.SIGKILL)
            quiet = 0
            while quiet < 5:
                before = bench.received
                bench.listen(0.2)
                quiet = quiet + 1 if bench.received == before else 0
            os.kill(pids["plant"], signal.SIGKILL)
            self.tick = bench.tick
        raise KeyboardInterrupt  # what the others do then is not asked here


@pytest.mark.share(0.2)
def test_a_killed_recorder_lacks_a_chunk_or_a_second_at_the_end_and_nothing_before(
    tmp_path: Path, case: np.random.Generator
) -> None:
    patient = replace(slew(duration=600.0), answer_timeout=10.0)  # of the plant with its recorder
    killing = Killing(int(case.integers(1, 300)))
    flight = Flight(patient, tmp_path, int(case.integers(1, 300)), killing)
    assert flight.outcome.exit_code == 130
    recovery = recover(flight.bag)
    assert recovery.lost == {}
    assert recovery.missing_ticks == 0
    bag = BagReader(flight.bag)
    asked = set(bag.columns("/measurement")["tick"].tolist())
    states = bag.columns("/controller_state")["tick"].tolist()
    efforts = bag.columns("/effort_command")["tick"].tolist()
    missed = {event.tick for event in bag.overview.events if event.kind == "missed"}
    last = max(asked)
    assert asked == set(range(last + 1))
    assert asked - set(states) <= missed | {last}
    assert asked - set(efforts) <= missed | {last}
    size = sum(len(m.data) + 31 for m in bag.messages())
    chunk = CHUNK_SIZE / (size / (last + 1))  # ticks in one
    print(f"killed at tick {killing.tick}, {killing.tick - last} ticks lost")
    assert killing.tick - last <= max(MOST, chunk)
