"""The filter of attitude and bias is as good as it says, at rest, slewing and through a dropout.

The truth turns by held rates, so its attitudes are exact; readings are those of the instruments.
"""

from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from flexslew_control.estimators.attitude_estimator import (
    AttitudeEstimator,
    AttitudeFilterSettings,
)
from flexslew_control.estimators.attitude_filter import GyroNoise, RigidFilter
from flexslew_control.law import Reference
from flexslew_plant.arrays import EMPTY, Matrix, Vector
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds.instruments import (
    BodyState,
    Gyro,
    GyroSettings,
    StarTracker,
    StarTrackerSettings,
    SunSensor,
    SunSensorSettings,
)
from flexslew_plant.testbeds.instruments.gyro import BIAS
from flexslew_plant.testbeds.instruments.instrument import Instrument, TickReader
from flexslew_plant.testbeds.orientation.attitude import AttitudeJoints, rotation_vector

PERIOD, SEEDS, TICKS = 0.1, 80, 45
GYRO: dict[str, Any] = {
    "angle_random_walk": 2e-5, "rate_random_walk": 3e-6, "bias_spread": 1e-4,
}  # fmt: skip
TRACKER: dict[str, Any] = {
    "across": 2e-5, "about": 1.5e-4, "rate_noise": 2e-3, "boresight": (0.3, -0.2, 0.9),
    "interval": 0.2, "delay": 0.2, "blind": ((2.0, 3.5),),
}  # fmt: skip
SUN: dict[str, Any] = {"noise": 1e-4, "half_angle": np.pi, "boresight": (1.0, 0.0, 0.0)}
RATES = {"rest": np.zeros(3), "slew": np.array([0.04, -0.03, 0.05])}  # [rad/s]
JOINTS = np.linalg.qr(np.random.default_rng(4).standard_normal((3, 3)))[0]  # not the body's axes


class Sensed(NamedTuple):
    """What a filter believes beside the truth, tick by tick."""

    error: Matrix  # of attitude [rad] and bias [rad/s], (ticks, 6)
    covariance: Matrix  # (ticks, 6, 6)
    innovation: Matrix  # (ticks, channels)
    nis: Vector  # (ticks,)


def instruments(sun: bool = False, **tracker: Any) -> tuple[Gyro, StarTracker, list[SunSensor]]:
    """Return the sensors of a craft, one after the other."""
    gyro = Gyro("gyro", 0, GyroSettings(kind="gyro", **GYRO))
    settings = StarTrackerSettings(kind="star_tracker", **{**TRACKER, **tracker})
    towards = np.array([2.0, 1.0, 2.0]) / 3.0
    seen = SunSensor("sun", 7, SunSensorSettings(kind="sun_sensor", **SUN), towards)
    return gyro, StarTracker("tracker", 3, settings), [seen] * sun


def truth(rate: Vector, seed: int, ticks: int) -> tuple[Rotation, Matrix]:
    """Return attitudes, and rates held since the tick before, that swing about a mean."""
    rng = np.random.default_rng([seed, 99])
    t = PERIOD * np.arange(ticks)
    swing = 0.3 * np.linalg.norm(rate) * rng.standard_normal(3)
    rates = rate + np.sin(0.8 * t + rng.uniform(0.0, 6.0))[:, None] * swing
    attitude = Rotation.random(random_state=int(seed))
    path = [attitude]
    for held in rates[1:]:
        path.append(path[-1] * Rotation.from_rotvec(PERIOD * held))
    return Rotation.concatenate(path), rates


def sensed(
    rate: Vector, seed: int, sun: bool = False, ticks: int = TICKS, **tracker: Any
) -> Sensed:
    """Return what the filter makes of a flight."""
    gyro, star, suns = instruments(sun, **tracker)
    path, rates = truth(rate, seed, ticks)
    sensors: list[Instrument] = [gyro, star, *suns]
    readers = [
        (one, TickReader(one, PERIOD, np.random.default_rng([seed, one.first]))) for one in sensors
    ]
    reader: Any = readers[0][1]
    it = AttitudeEstimator(
        AttitudeJoints(JOINTS), gyro, (star,), tuple(suns),
        AttitudeFilterSettings(initial_bias=GYRO["bias_spread"]), PERIOD,
        RigidFilter(GyroNoise(GYRO["angle_random_walk"], GYRO["rate_random_walk"]), PERIOD),
    )  # fmt: skip
    rows = []
    for k, (q, w) in enumerate(zip(path.as_quat(), rates, strict=True)):
        tip = np.concatenate([read(BodyState(q, w)) for _, read in readers])
        still = np.zeros(3)
        it.expect(Reference(still, still, still, EMPTY))
        seen = Measurement(k, 0, k * PERIOD, "", still, still, tip, np.zeros(tip.size), still)
        if k == 0:
            it.reset(seen)
        found = it.update(seen)
        believed = Rotation.from_rotvec(JOINTS.T @ found.position)
        bias = tip[:3] - JOINTS.T @ found.velocity
        off = rotation_vector((believed.inv() * path[k]).as_quat())
        error = np.concatenate((off, reader.memory[BIAS] - bias))
        rows.append((error, found.covariance, found.innovation, found.nis))
    return Sensed(*map(np.array, zip(*rows, strict=True)))


def band(share: float, degrees: float, count: int) -> tuple[float, float]:
    """Return where the mean of `count` squares with so many degrees in all lies that often."""
    outside = 0.5 * (1.0 - share)
    return chi2.ppf(outside, degrees) / count, chi2.ppf(1.0 - outside, degrees) / count


@pytest.mark.slow
@pytest.mark.parametrize(("rate", "sun"), [("rest", False), ("slew", True)])
def test_errors_and_innovations_are_as_large_as_the_covariance_says(rate: str, sun: bool) -> None:
    runs = [sensed(RATES[rate], seed, sun) for seed in range(SEEDS)]
    first = 2 + round(TRACKER["delay"] / PERIOD)  # from the first reading on
    nees = np.array(
        [
            [e @ np.linalg.solve(p, e) for e, p in zip(run.error, run.covariance, strict=True)]
            for run in runs
        ]
    )[:, first:]
    average = nees.mean(axis=0)  # over the seeds, tick by tick
    low, high = band(0.95, SEEDS * 6, SEEDS)
    assert low < average.mean() < high
    low, high = band(1.0 - 0.05 / average.size, SEEDS * 6, SEEDS)  # of all ticks together
    assert low < average.min()
    assert average.max() < high
    used = np.array([run.innovation != 0.0 for run in runs]).sum()
    nis = np.array([run.nis for run in runs]).sum()
    low, high = band(0.95, int(used), int(used))
    assert low < nis / used < high


def test_a_dropout_lets_the_error_grow_and_the_next_reading_ends_it() -> None:
    runs = [sensed(RATES["slew"], seed) for seed in range(12)]
    start, end = (round((t + TRACKER["delay"]) / PERIOD) for t in TRACKER["blind"][0])
    sigma = np.array([np.sqrt(run.covariance[:, 0, 0]) for run in runs]).mean(axis=0)
    assert sigma[end - 1] > 1.5 * sigma[start - 1]
    assert sigma[end + 4] < 0.9 * sigma[end - 1]
    assert all((run.innovation[start + 1 : end] == 0.0).all() for run in runs)


def test_a_late_reading_counts_for_its_own_time() -> None:
    """Late by two ticks at 0.07 rad/s it would be 200 sigma off if it counted for the present."""
    off = [
        np.linalg.norm(sensed(RATES["slew"], seed, delay=delay, rate_noise=0.0).error[-15:, :3])
        for delay in (0.0, 0.2)
        for seed in range(6)
    ]
    assert np.mean(off[6:]) < 1.5 * np.mean(off[:6])


def test_the_error_does_not_depend_on_the_inertial_frame() -> None:
    """The same noises from other frames: the same errors, up to rounding."""
    one = sensed(RATES["slew"], 3)
    frame = Rotation.from_rotvec([2.0, -1.0, 0.7])
    known = truth

    def turned(rate: Vector, seed: int, ticks: int) -> tuple[Rotation, Matrix]:
        path, rates = known(rate, seed, ticks)
        return frame * path, rates

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(globals(), "truth", turned)
        two = sensed(RATES["slew"], 3)
    np.testing.assert_allclose(two.error[2:], one.error[2:], atol=1e-9)
    np.testing.assert_allclose(two.innovation, one.innovation, atol=1e-9)
