"""Controllers on sockets and over DDS in any mixture, swapped and held up at any moment."""

import os
import signal
from pathlib import Path
from threading import Timer
from time import sleep

import numpy as np
import pytest

from flexslew_plant.direct.names import SETTING
from tests.ros.flight import Flight, slew
from tests.ros.lines import alone, asked, over_dds, whole

pytestmark = pytest.mark.ros

LAWS = ("pd_feedforward", "lqr", "output_feedback")
TICKS = 1500


@pytest.mark.share(0.2)
def test_any_mixture_of_sockets_and_dds_gives_the_same_bits_and_a_whole_log(
    case: np.random.Generator, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(SETTING, "auto")
    remote = [name for name in LAWS if case.random() < 0.4]
    ticks = sorted(case.choice(np.arange(50, TICKS - 100), 4, replace=False).tolist())
    swaps = [f"{{at: {k / 100}, switch: {case.choice(LAWS)}}}" for k in ticks]
    more, extra = ", lqr: {}, output_feedback: {}", f"schedule: [{', '.join(swaps)}]"
    trial = slew(TICKS / 100, more=more, extra=extra)
    held_up = str(case.choice([*LAWS, "plant", "recorder"]))
    begin, pause = case.uniform(0.0, 0.3), case.uniform(0.0, 0.4)

    def hold_up(pids: dict[str, int], domain: int) -> None:
        def stop() -> None:
            os.kill(pids[held_up], signal.SIGSTOP)
            sleep(pause)
            os.kill(pids[held_up], signal.SIGCONT)

        Timer(begin, stop).start()

    flight = Flight(trial, tmp_path, 0, hold_up, change=over_dds(remote))
    assert flight.outcome == (0, ""), flight.log
    assert flight.metrics["trajectory_hash"] == alone(trial, tmp_path)
    assert flight.metrics["missed_ticks"] == 0
    whole(flight.bag, TICKS)
    ways = asked(flight.bag)
    assert not any("socket" in ways.get(name, ()) for name in remote)
