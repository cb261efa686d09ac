"""Gyro, star tracker and Sun sensor: what they read, how far off, when, and what is refused."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import EffortCommand
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.instruments import (
    BodyState,
    Gyro,
    GyroSettings,
    Instrument,
    StarTracker,
    StarTrackerSettings,
    SunSensor,
    SunSensorSettings,
)
from flexslew_plant.testbeds.instruments.instrument import TickReader

PERIOD = 0.05
RATE = np.array([0.03, -0.05, 0.02])  # [rad/s]
EXACT: dict[str, Any] = {
    "gyro": {"kind": "gyro"},
    "tracker": {"kind": "star_tracker"},
    "sun": {"kind": "sun_sensor", "sun": [0.0, 3.0, 4.0]},
}


def gyro(**keys: Any) -> Gyro:
    return Gyro("gyro", 0, GyroSettings(kind="gyro", **keys))


def tracker(**keys: Any) -> StarTracker:
    return StarTracker("tracker", 3, StarTrackerSettings(kind="star_tracker", **keys))


def sun_sensor(**keys: Any) -> SunSensor:
    return SunSensor("sun", 7, SunSensorSettings(kind="sun_sensor", **keys), np.eye(3)[0])


def turning(ticks: int, rate: Vector = RATE) -> tuple[Matrix, Matrix]:
    """Return quaternions of a craft that turns by one rate, and the rates."""
    start = Rotation.from_rotvec([0.4, 2.5, -1.0])
    turns = Rotation.from_rotvec(PERIOD * np.arange(ticks)[:, None] * rate)
    return (start * turns).as_quat(), np.tile(rate, (ticks, 1))


def read(instrument: Instrument, attitudes: Matrix, rates: Matrix, seed: int | None = 1) -> Matrix:
    """Return its readings tick by tick."""
    reader = TickReader(instrument, PERIOD, None if seed is None else np.random.default_rng(seed))
    return np.array([reader(BodyState(q, w)) for q, w in zip(attitudes, rates, strict=True)])


def off(read_: Matrix, true: Matrix) -> Matrix:
    """Return by which small turn in body axes quaternions are off."""
    turn = Rotation.from_quat(true).inv() * Rotation.from_quat(read_)
    return np.asarray(turn.as_rotvec())


def test_a_gyro_without_errors_adds_up_to_the_turn() -> None:
    rates = 0.2 * np.random.default_rng(3).standard_normal((40, 3))
    path = [Rotation.identity()]
    for rate in rates[1:]:
        path.append(path[-1] * Rotation.from_rotvec(PERIOD * rate))
    readings = read(gyro(), Rotation.concatenate(path).as_quat(), rates)
    np.testing.assert_allclose(readings, rates, atol=1e-14)


def test_the_noises_of_a_gyro_are_as_large_as_it_says() -> None:
    ticks = 4000
    white = read(gyro(angle_random_walk=1e-3), *turning(ticks)) - RATE
    assert white.std() == pytest.approx(1e-3 / np.sqrt(PERIOD), rel=0.02)
    total = PERIOD * white.sum(axis=0)  # an angle that walks at random
    assert abs(total).max() < 4.0 * 1e-3 * np.sqrt(PERIOD * ticks)
    walked = read(gyro(rate_random_walk=1e-3), *turning(ticks)) - RATE
    steps = np.diff(walked, axis=0)
    # the mean of a walk over a tick: differences of two have 2/3 of the variance of its steps
    assert steps.std() == pytest.approx(1e-3 * np.sqrt(PERIOD * 2.0 / 3.0), rel=0.02)
    starts = [read(gyro(bias_spread=2e-3), *turning(1), seed=k)[0] - RATE for k in range(400)]
    assert np.std(starts) == pytest.approx(2e-3, rel=0.08)


def test_the_noise_of_a_star_tracker_is_that_of_its_axes_and_of_the_rate() -> None:
    boresight = np.array([2.0, 1.0, -2.0]) / 3.0
    it = tracker(across=1e-4, about=1e-3, boresight=tuple(3.0 * boresight), rate_noise=5e-3)
    for rate in (np.zeros(3), RATE):
        attitudes, rates = turning(2500, rate)
        errors = off(read(it, attitudes, rates), attitudes)
        more = (5e-3 * np.linalg.norm(rate)) ** 2
        about = errors @ boresight
        across = errors - np.outer(about, boresight)
        assert about.std() == pytest.approx(np.sqrt(1e-6 + more), rel=0.05)
        size = np.sqrt((across**2).sum(axis=1).mean() / 2.0)
        assert size == pytest.approx(np.sqrt(1e-8 + more), rel=0.05)


def test_a_star_tracker_that_turns_too_fast_or_loses_readings_gives_none() -> None:
    assert not read(tracker(rate_limit=0.05), *turning(5)).any()
    assert read(tracker(rate_limit=0.07), *turning(5)).any(axis=1).all()
    lost = ~read(tracker(dropout=0.3), *turning(2000)).any(axis=1)
    assert lost.mean() == pytest.approx(0.3, abs=0.04)


@pytest.mark.parametrize("period", [0.01, 0.03, 0.07, 0.1, 0.3, 1.0 / 3.0])
def test_a_star_tracker_is_blind_in_the_ticks_of_its_spans(period: float) -> None:
    body, ticks = BodyState(np.array([0.0, 0.0, 0.0, 1.0]), RATE), 200
    for start in range(0, ticks - 7):
        times = round(start * period, 12), round((start + 7) * period, 12)
        it = tracker(blind=(times, (1e307, 1.7e308)))
        reader = TickReader(it, period, np.random.default_rng(1))
        gaps = [k for k in range(ticks) if not reader(body).any()]
        assert gaps == list(range(start, start + 7))
    rng = np.random.default_rng(1)
    for times in np.sort(rng.uniform(0.0, ticks * period, (20, 2))):  # rounded, like all times
        reader = TickReader(tracker(blind=(tuple(times),)), period, np.random.default_rng(1))
        gaps = [k for k in range(ticks) if not reader(body).any()]
        first, last = np.round(times / period).astype(int)
        assert gaps == list(range(first, min(last, ticks)))


def test_a_sun_sensor_reads_a_unit_vector_while_it_sees_the_sun() -> None:
    attitudes, rates = turning(4000, np.array([0.0, 0.1, 0.02]))
    it = sun_sensor(noise=1e-3, half_angle=0.7)
    true = Rotation.from_quat(attitudes).inv().apply([1.0, 0.0, 0.0])
    found = read(it, attitudes, rates)
    seen = found.any(axis=1)
    np.testing.assert_array_equal(seen, true[:, 2] >= np.cos(0.7))
    assert 200 < seen.sum() < 3800
    np.testing.assert_allclose(np.linalg.norm(found[seen], axis=1), 1.0, atol=1e-14)
    errors = found[seen] - true[seen]
    assert np.sqrt((errors**2).sum(axis=1).mean() / 2.0) == pytest.approx(1e-3, rel=0.06)


def craft(**keys: Any) -> Any:
    """Return a testbed with these keys of its section."""
    return read_testbed({"kind": "spacecraft", "platform": {"mass": 50.0}, **keys}, "here")


def test_on_the_bench_they_read_the_truth_and_repeat_themselves_by_the_seed() -> None:
    noisy = {**EXACT, "gyro": {"kind": "gyro", "angle_random_walk": 1e-4}}
    for sensors, exact in ((EXACT, True), (noisy, False)):
        testbed = craft(sensors=sensors, initial={"roll": 0.3, "yaw": 4.0})
        rows = []
        for seed in (1, 1, 2):
            bench = Bench(BenchSettings(testbed=testbed, period=0.1, duration=2.0, seed=seed))
            names = bench.appendages.names
            assert names[:3] == ("gyro_x", "gyro_y", "gyro_z")
            assert names[3:] == tuple(
                f"tracker_{axis}" for axis in ("qx", "qy", "qz", "qw")
            ) + tuple(f"sun_{axis}" for axis in "xyz")
            tips = []
            for _ in range(20):
                asked = bench.question
                tips.append(asked.tip_deflection)
                push = np.array([1.0, -2.0, 0.5])
                assert bench.offer(EffortCommand(asked.tick, 0, asked.controller, push))
                before = bench.truth()
                bench.advance()
                q = Rotation.from_quat(before.position[3:7])
                assert abs(off(tips[-1][None, 3:7], before.position[None, 3:7])).max() < 1e-14
                np.testing.assert_allclose(tips[-1][7:], q.inv().apply([0.0, 0.6, 0.8]), atol=1e-14)
            rows.append(np.array(tips))
        assert rows[0].tobytes() == rows[1].tobytes()
        assert (rows[0].tobytes() == rows[2].tobytes()) == exact


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (
            {"platform": {"motion": "held"}, "sensors": {"g": {"kind": "gyro"}}},
            r"testbed\.sensors\.g: only a free platform has an attitude; use motion: free",
        ),
        (
            {"sensors": {"s": {"kind": "sun_sensor"}}},
            r"testbed\.sensors\.s\.sun: is required where there is no orbit",
        ),
        (
            {"sensors": {"t": {"kind": "star_tracker", "blind": [[2.0, 1.0]]}}},
            r"testbed\.sensors\.t\.blind\.0: \[2\.0, 1\.0\] is not allowed: the later time last",
        ),
        (
            {"sensors": {"t": {"kind": "star_tracker", "boresight": [0, 0, 0]}}},
            r"testbed\.sensors\.t\.boresight: .* has no direction",
        ),
        (
            {"sensors": {"t": {"kind": "star_trackr"}}},
            r"sensors\.t\.?k?i?n?d?.*star_trackr",
        ),
        (
            {
                "sensors": {
                    "t": {"kind": "gyro"},
                    "t_x": {"kind": "accelerometer"},
                }
            },
            r"testbed\.sensors\.t_x: this name is taken",
        ),
    ],
)
def test_what_cannot_be_is_refused_by_its_key(keys: dict[str, Any], words: str) -> None:
    with pytest.raises(BadInput, match=words) as error:
        craft(**keys)
    assert "\n" not in str(error.value)
