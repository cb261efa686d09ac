"""Joint sensors that contradict each other, and what the drive does then."""

import numpy as np
import pytest
from tests.present import present

from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.hardware.plausibility import Plausibility, PlausibilitySettings
from flexslew_plant.measurement import EffortCommand
from flexslew_plant.settings import validated

PERIOD = 0.01  # [s]
SETTINGS = PlausibilitySettings()


def findings(position: object, velocity: object) -> list[int]:
    """Return the ticks at which two histories, shape (ticks, joints), contradict each other."""
    check = Plausibility(SETTINGS, PERIOD)
    pairs = zip(np.asarray(position), np.asarray(velocity), strict=True)
    return [tick for tick, (q, v) in enumerate(pairs) if check.look(q, v) is not None]


@pytest.mark.parametrize("seed", range(5))
def test_a_joint_that_moves_as_its_rate_says_is_plausible(seed: int) -> None:
    rng = np.random.default_rng(seed)
    t = np.arange(2000)[:, None] * PERIOD
    frequency = rng.uniform(0.1, 6.0, 2)  # [rad/s]; the trapezoidal rule errs by (omega T)^2 / 12
    noise = SETTINGS.rate_difference * SETTINGS.window * PERIOD / 12.0  # six sigma of a difference
    q = np.sin(frequency * t) + noise * rng.standard_normal((2000, 2))
    assert findings(q, frequency * np.cos(frequency * t)) == []


@pytest.mark.parametrize(("joint", "rate"), [(0, 0.05), (1, -0.2)])
def test_an_encoder_that_stands_still_while_the_joint_moves_is_found(
    joint: int, rate: float
) -> None:
    q, v = np.zeros((100, 2)), np.zeros((100, 2))
    v[:, joint] = rate
    found = findings(q, v)
    assert 0 < found[0] <= SETTINGS.window
    assert len(found) > 1  # again and again


def test_a_jump_of_an_encoder_is_found_at_once_and_what_follows_is_plausible() -> None:
    q = np.zeros((100, 2))
    q[40:, 1] = 0.01
    assert findings(q, np.zeros((100, 2))) == [40]


def test_what_is_not_a_number_is_not_plausible() -> None:
    check, ones = Plausibility(SETTINGS, PERIOD), np.ones(2)
    assert check.look(ones, ones * 0.0) is None
    found = present(check.look(ones, np.array([0.0, np.nan])))
    assert found.joint == 1
    assert np.isfinite(found.difference)


def test_everybody_who_flies_on_contradictory_sensors_loses_the_bench_and_then_it_brakes() -> None:
    lie = {"kind": "sensor_dropout", "channel": "joint_velocity"}
    values = {
        "fallback": ["second", "third"], "plausibility": {}, "allow_faults": True,
        "schedule": [{"at": 0.5, "fault": lie}],
    }  # fmt: skip
    bench = Bench(validated(BenchSettings, values, "test"))
    in_charge = []
    for _ in range(200):
        question = bench.question
        in_charge.append(question.controller)
        effort = np.array([50.0, 20.0])
        bench.offer(EffortCommand(question.tick, question.epoch, question.controller, effort))
        bench.advance()
    assert list(dict.fromkeys(in_charge)) == ["pd_feedforward", "second", "third", ""]
    assert in_charge[:50] == ["pd_feedforward"] * 50
    kinds = [e.kind for e in bench.events if e.kind in ("implausible", "fallback", "brake")]
    assert kinds == ["implausible", "fallback"] * 2 + ["implausible", "brake"]
    assert bench.faulted
    bench.reset()
    assert bench.question.controller == "pd_feedforward"
