from typing import Any

import numpy as np
import pytest

from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.hardware.sensor_step import nearest_multiple
from flexslew_plant.hardware.sensors import (
    Channel,
    Readings,
    Sensors,
    SensorSettings,
    sensor_numbers,
)
from flexslew_plant.testbeds import default_testbed

TRUTH = Readings(
    np.array([0.3, -0.2]), np.array([0.01, 0.02]), np.array([0.5, -0.5]), np.array([1e-3, -1e-3])
)


def sensors(seed: int = 1, /, **channels: Channel) -> Sensors:
    return Sensors(SensorSettings(**channels), default_testbed().model(), 0.01, [seed])


def test_by_default_the_truth_itself_is_read() -> None:
    assert sensors().read(TRUTH) is TRUTH


@pytest.mark.parametrize("name", Readings._fields)
def test_a_bias_shifts_its_own_channel_only(name: Any) -> None:
    read = sensors(**{name: Channel(bias=0.25)}).read(TRUTH)
    for field in Readings._fields:
        shift = 0.25 if field == name else 0.0
        np.testing.assert_allclose(getattr(read, field), getattr(TRUTH, field) + shift, rtol=1e-15)


def test_readings_are_multiples_of_the_quantum() -> None:
    read = sensors(joint_position=Channel(quantisation=0.07)).read(TRUTH)
    np.testing.assert_allclose(read.joint_position, [0.28, -0.21])


def test_a_value_keeps_its_multiple_up_to_its_margin() -> None:
    rng = np.random.default_rng(2)
    for value, quantum in zip(
        rng.standard_normal(200), 10.0 ** rng.uniform(-3, 1, 200), strict=True
    ):
        multiple, margin = nearest_multiple(value, quantum)
        within = {nearest_multiple(value + by * margin, quantum)[0] for by in (-0.99, 0.99)}
        beyond = {nearest_multiple(value + by * margin, quantum)[0] for by in (-1.01, 1.01)}
        assert within == {multiple} < beyond | {multiple}


def test_noises_of_many_ticks_are_those_of_one_tick_after_another() -> None:
    settings = SensorSettings(joint_velocity=Channel(noise=0.1), root_curvature=Channel(noise=2.0))
    numbers = sensor_numbers(settings, default_testbed().model())
    many, single = (np.random.default_rng(5) for _ in range(2))
    rows = [numbers.draw(single, 1)[0] for _ in range(50)]
    np.testing.assert_array_equal(numbers.draw(many, 50), rows)


def test_noise_has_its_deviation_and_no_mean() -> None:
    noisy = sensors(joint_velocity=Channel(noise=0.1))
    errors = np.array([noisy.read(TRUTH).joint_velocity for _ in range(4000)])
    errors -= TRUTH.joint_velocity
    assert np.std(errors) == pytest.approx(0.1, rel=0.03)
    assert abs(errors.mean()) < 0.005
    assert abs(np.corrcoef(errors.T)[0, 1]) < 0.05


def test_the_same_seed_gives_the_same_noise() -> None:
    channel = {"joint_position": Channel(noise=0.1), "tip_deflection": Channel(noise=0.1)}
    one, two, other = (sensors(seed, **channel) for seed in (5, 5, 6))
    for _ in range(10):
        a, b, c = (s.read(TRUTH) for s in (one, two, other))
        np.testing.assert_array_equal(np.concatenate(a), np.concatenate(b))
        assert not np.array_equal(a.joint_position, c.joint_position)


def test_the_bench_draws_fresh_noise_in_every_epoch() -> None:
    noisy = SensorSettings(joint_position=Channel(noise=1e-3))
    benches = [Bench(BenchSettings(sensors=noisy, seed=4)) for _ in range(2)]
    first = [bench.question.joint_position for bench in benches]
    np.testing.assert_array_equal(first[0], first[1])
    for bench in benches:
        bench.reset()
    second = [bench.question.joint_position for bench in benches]
    np.testing.assert_array_equal(second[0], second[1])
    assert not np.array_equal(first[0], second[0])
