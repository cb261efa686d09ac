"""Thrusters in pulses: what they may do in a tick, and what their impulse adds up to."""

from typing import Any

import numpy as np
import pytest

from flexslew_lab.trial.trial import bench_settings, parse_trial
from flexslew_plant.bench.bench import Bench
from flexslew_plant.errors import BadInput
from flexslew_plant.hardware.actuator import Actuator, ActuatorSettings, minimum_impulse

PERIOD, LIMIT, SHORTEST = 0.1, np.array([2.0, 0.5, 3.0]), np.array([0.02, 0.1, 0.0])


def pulsed(demands: Any) -> Any:
    it = Actuator(ActuatorSettings(), LIMIT, PERIOD, SHORTEST * LIMIT)
    return np.array([it.apply(demand) for demand in demands])


@pytest.mark.parametrize("seed", range(5))
def test_every_tick_is_a_pulse_and_the_impulse_is_right_to_one_shortest_pulse(seed: int) -> None:
    rng = np.random.default_rng(seed)
    demands = rng.uniform(-1.0, 1.0, (400, 3)) * LIMIT * rng.choice([0.01, 0.3, 1.0], (400, 1))
    given = pulsed(demands)
    widths = np.abs(given) * PERIOD / LIMIT
    on = widths[:, :2] > 0.0
    assert (widths[:, :2][on] > np.tile(SHORTEST[:2], (400, 1))[on] - 1e-12).all()
    assert (widths <= PERIOD + 1e-12).all()
    assert set(np.round(np.abs(given[:, 1]), 12)) <= {0.0, 0.5}  # on or off for whole ticks
    owed = np.cumsum(demands - given, axis=0) * PERIOD
    assert (np.abs(owed) <= SHORTEST * LIMIT + 1e-12).all()
    np.testing.assert_array_equal(given[:, 2], demands[:, 2])


def test_a_small_demand_comes_as_rare_pulses() -> None:
    given = pulsed(np.tile([0.01, 0.0, 0.0], (400, 1)))[:, 0]
    assert np.count_nonzero(given) == 10  # 0.4 N m s in pulses of 0.04
    assert set(np.round(given, 12)) == {0.0, 0.4}


def test_what_is_beyond_the_limit_is_not_owed_for_ever() -> None:
    given = pulsed(np.vstack((np.tile([9.0, 9.0, 0.0], (50, 1)), np.zeros((3, 3)))))
    np.testing.assert_allclose(given[:50, :2], np.tile(LIMIT[:2], (50, 1)))
    assert (given[51:, :2] == 0.0).all()


def test_a_pulse_as_long_as_a_tick_but_for_rounding_is_given() -> None:
    tick, pulse = 0.3, 0.1 + 0.2
    assert pulse > tick
    settings, limit = ActuatorSettings(shortest_pulse=pulse), np.array([1.0])
    it = Actuator(settings, limit, tick, minimum_impulse(settings, ("jet",), limit, tick))
    given = [float(it.apply(np.array([0.5]))[0]) for _ in range(6)]
    assert given == [0.0, 1.0, 0.0, 1.0, 0.0, 1.0]


def bench(pulse: str) -> Bench:
    text = f"name: t\nduration: 1.0\nactuator: {{shortest_pulse: {pulse}}}\nplan: {{method: none}}"
    return Bench(bench_settings(parse_trial(text, "here")))


def test_on_the_bench_a_reset_forgets_what_was_owed() -> None:
    it = bench("{hub_pitch: 0.005}")
    asked = np.array([1.0, 1.0])
    rows = []
    for _ in range(2):
        it.reset()
        rows.append([it.actuator.apply(asked) for _ in range(80)])
    np.testing.assert_array_equal(rows[0], rows[1])
    base, hub = np.array(rows[0]).T
    assert set(base) == {1.0}
    assert set(np.round(hub, 9)) == {0.0, 75.0}


@pytest.mark.parametrize(
    ("pulse", "words"),
    [
        ("{elbow: 0.005}", "shortest_pulse: .*elbow.*names of actuators: base_yaw, hub_pitch"),
        ("0.02", r"shortest_pulse: 0\.02 is not allowed: at most one tick, 0\.01 s"),
    ],
)
def test_a_pulse_that_cannot_be_is_refused(pulse: str, words: str) -> None:
    with pytest.raises(BadInput, match=words) as error:
        bench(pulse)
    assert "\n" not in str(error.value)
