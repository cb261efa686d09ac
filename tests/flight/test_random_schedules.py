"""Random schedules of switches, tunings, missed ticks, controllers that are killed and started
again and others that hear nothing for a while: live against the run from its log.

`--cases 1000` draws a thousand.
"""

from pathlib import Path
from typing import Any

import numpy as np
from tests.present import present
from tests.wire_bench import WireBench

from flexslew_lab.log.recording.bag_observer import BagObserver
from flexslew_lab.log.recording.bag_writer import BagWriter
from flexslew_lab.replay.resim import resim
from flexslew_lab.trial.trial import Trial, parse_trial, trial_text
from flexslew_plant.bench.records import SwitchRequest

LAWS = ("pd_feedforward", "proportional_integral", "lqr")
TEXT = """
name: random_schedule
duration: 3.0
max_missed: 3
testbed: {initial: {base_yaw: 0.02, hub_pitch: -0.01}}
controllers: {pd_feedforward: {}, proportional_integral: {}, lqr: {}}
fallback: [lqr, pd_feedforward]
schedule: [{at: 0.0, disturbance: {base_yaw: 20.0, hub_pitch: -15.0}}]  # it moves
"""
TUNED: dict[str, dict[str, Any]] = {
    "pd_feedforward": {"kp": [400.0, 410.0]},
    "lqr": {"weights": {"joint": 60.0}},
}
LAST = 250


def recorded(folder: Path, trial: Trial, named: bool = True) -> tuple[WireBench, BagWriter]:
    """Return a bench whose messages go into a bag, which names the trial or not."""
    bench = WireBench(trial)
    writer = BagWriter(folder, {"trial": trial_text(trial)} if named else {})
    bench.observer = observer = BagObserver(writer)
    controllers = {name: present(host.controller) for name, host in bench.hosts.items()}
    observer.notify(trial, bench.bench, None, controllers)
    return bench, writer


def flown(folder: Path, rng: np.random.Generator, named: bool = True) -> WireBench:
    """Fly one random schedule into a bag."""
    bench, writer = recorded(folder, parse_trial(TEXT, "test"), named)
    with writer:
        tick = 0
        while tick < LAST:
            tick += int(rng.integers(1, 12))
            name = str(rng.choice(LAWS))
            what = rng.random()
            deaf: dict[int, set[str]] = {}
            if what < 0.6:
                strict, step = bool(rng.random() < 0.7), float(rng.choice([0.0, 0.0, 50.0]))
                at = bench.bench.tick + int(rng.integers(1, 4))
                bench.session.switch(SwitchRequest(name, at, strict, step), bench.now)
                if rng.random() < 0.6:  # the tick of the switch is missed by some
                    deaf = {at: {one for one in LAWS if one != name or rng.random() < 0.3}}
            elif what < 0.7 and name in TUNED:
                bench.hosts[name].tune(TUNED[name])
            elif what < 0.76:
                bench.start(name)
            elif what < 0.82:
                bench.sleep(name, int(rng.integers(1, 6)))
            else:
                first = bench.bench.tick + int(rng.integers(0, 4))
                deaf = {first + k: {*LAWS} for k in range(int(rng.integers(1, 4)))}
            bench.fly(tick, deaf)
        bench.fly(LAST + 10)
    return bench


def test_what_was_flown_is_flown_again_to_the_last_bit(
    case: np.random.Generator, tmp_path: Path
) -> None:
    # a recorder that somebody starts by hand knows of no trial
    bench = flown(tmp_path / "bag", case, named=bool(case.integers(2)))
    again = resim(tmp_path / "bag")
    assert again.first_difference is None
    assert again.identical
    assert again.ticks > LAST
    assert bench.bench.drive.missed == again.replayed["missed"] > 0


def test_a_strict_switch_that_is_refused_on_a_missed_tick_has_asked_the_predecessor(
    tmp_path: Path,
) -> None:
    bench, writer = recorded(tmp_path / "bag", parse_trial(TEXT, "test"))
    with writer:
        first = "proportional_integral"
        bench.session.switch(SwitchRequest(first, 1), bench.now)
        for at in range(20, LAST, 6):  # a newcomer's first effort differs by rounding at most
            newcomer = "lqr" if bench.bench.drive.active == first else first
            before = bench.bench.drive.active
            bench.session.switch(SwitchRequest(newcomer, at, True, 0.0), bench.now)
            bench.fly(at + 5, {at: {before}})
    refused = {event.tick for event in bench.of_kind("switch_refused")}
    assert refused
    assert refused <= {event.tick for event in bench.of_kind("missed")}
    again = resim(tmp_path / "bag")
    assert again.identical, again.first_difference
