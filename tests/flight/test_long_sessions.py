"""Long sessions on one bench: its last epoch is that of a bench that was just started, bit for bit,
and all of them are flown again from the log.

`--cases 1000` draws a thousand.
"""

from pathlib import Path
from typing import Any

import numpy as np
from tests.flight.test_random_schedules import recorded
from tests.wire_bench import WireBench

from flexslew_lab.replay.resim import resim
from flexslew_lab.trial.trial import Trial, parse_trial
from flexslew_plant.bench.records import SwitchRequest
from flexslew_plant.yaml_data import yaml_text

LAWS = ("pd_feedforward", "proportional_integral", "lqr")
LAST = 60  # tick of the last epoch
HARM: tuple[dict[str, Any], ...] = (
    {"fault": {"kind": "command_lost", "probability": 0.3}},
    {"fault": {"kind": "command_late", "probability": 0.4, "ticks": 2}},
    {"fault": {"kind": "actuator_stuck", "joint": "base_yaw"}},
    {"fault": {"kind": "command_delay", "ticks": 2.5}},
    {"fault": {"kind": "sensor_freeze", "channel": "joint_position"}},
    {"fault": {"kind": "sensor_nan", "channel": "joint_velocity"}},
    {"fault": {"kind": "sensor_bias", "channel": "joint_position", "bias": 0.01}},
    {"disturbance": {"hub_pitch": 30.0}},
)


def trial(rng: np.random.Generator) -> Trial:
    """Return a bench with motors, sensors and a schedule that remember something."""
    values: dict[str, Any] = {
        "name": "long_session",
        "duration": 3.0,
        "max_missed": 3,
        "allow_faults": True,
        "testbed": {"modes": 1, "initial": {"hub_pitch": 0.05}},
        "controllers": {name: {} for name in LAWS} | {"lqr": {"monitor": {}}},
        "active": str(rng.choice(LAWS)),
        "fallback": ["pd_feedforward"],
        "sensors": {"joint_position": {"noise": 1e-5}},
        "actuator": {"lag": 0.05, "slew_rate": 2000.0},
        "schedule": [
            {"at": 0.1, "until": 0.3, "fault": {"kind": "command_delay", "ticks": 3}},
            {"at": 0.4, "switch": str(rng.choice(LAWS))},
        ],
    }
    if rng.random() < 0.5:
        values["plausibility"] = {"rate_difference": 0.1}
    return parse_trial(yaml_text(values), "test")


def reset(bench: WireBench) -> None:
    """Reset the bench; its controllers hear of it with its state."""
    bench.session.reset()
    for host in bench.hosts.values():
        host.begin_epoch(bench.bench.epoch)
    bench.fly(0)


def flown(bench: WireBench, rng: np.random.Generator) -> None:
    """Do whatever an operator may, and reset the bench with the brake released."""
    for _ in range(int(rng.integers(2, 8))):
        tick, what = bench.bench.tick, rng.random()
        if what < 0.4:
            bench.session.start()
            missed = {tick + 2 + k: set(LAWS) for k in range(int(rng.integers(0, 4)))}
            bench.fly(tick + int(rng.integers(1, 50)), missed)
        elif what < 0.6:
            request = SwitchRequest(str(rng.choice(LAWS)), tick + int(rng.integers(1, 20)))
            bench.session.switch(request, bench.now)
        elif what < 0.75:
            harm = HARM[int(rng.integers(len(HARM)))]
            until = {"until": (tick + 60) * 0.01} if rng.random() < 0.5 else {}
            bench.bench.inject(yaml_text(harm | until), tick + int(rng.integers(1, 20)))
        elif what < 0.9:
            bench.session.brake(not bench.bench.handover.latched)
        else:
            bench.session.pause(bench.now)
    if bench.bench.handover.latched:
        bench.session.brake(False)
        reset(bench)
    reset(bench)


def last_epoch(bench: WireBench) -> list[Any]:
    """Fly the last epoch; return its truths."""
    if bench.bench.handover.latched:  # asked for just before the reset
        bench.session.brake(False)
        reset(bench)
        reset(bench)
    assert bench.session.start().ok
    bench.fly(LAST)
    return [truth for truth in bench.truth_log if truth.epoch == bench.bench.epoch]


def test_the_last_epoch_is_that_of_a_new_bench(case: np.random.Generator, tmp_path: Path) -> None:
    chosen = trial(case)
    bench, writer = recorded(tmp_path / "bag", chosen)
    with writer:
        for _ in range(int(case.integers(1, 4))):
            flown(bench, case)
        found = last_epoch(bench)
    new = WireBench(chosen)
    while new.bench.epoch < bench.bench.epoch:
        reset(new)
    for name in new.hosts:
        new.start(name)
    expected = last_epoch(new)
    assert len(found) == len(expected) == LAST + 1
    for one, other in zip(found, expected, strict=True):
        for here, there in zip(one, other, strict=True):
            np.testing.assert_array_equal(here, there)
    assert resim(tmp_path / "bag").identical
