"""The filter with appendage modes is as good as it says, and better than the gyro alone.

The truth is the craft of `three_axes` by its own equations, pushed by white noise on its efforts.
"""

from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from tests.representatives import representatives

from flexslew_control.estimators.attitude_filter import GyroNoise, RigidFilter
from flexslew_control.estimators.attitude_steps import (
    BIAS as FIRST_BIAS,
)
from flexslew_control.estimators.attitude_steps import (
    MODES,
    initialize_attitude,
    update_attitude,
)
from flexslew_control.estimators.flexible_attitude_filter import (
    AppendageModesSettings,
    FlexibleFilter,
    flexible_filter,
)
from flexslew_lab.reproduce.scole_flights import example_values
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.instruments import BodyState, Gyro, GyroSettings
from flexslew_plant.testbeds.instruments.gyro import BIAS as OWN_BIAS
from flexslew_plant.testbeds.instruments.instrument import TickReader
from flexslew_plant.testbeds.orientation.attitude import (
    conjugate,
    product,
    quaternion,
    rotation_vector,
)

PERIOD, SEEDS, TICKS = 0.1, 40, 60
NOISE = GyroNoise(white=2e-4, walk=3e-6)
BIAS, TRACKER = 1e-4, 1e-4  # standard deviations [rad/s], [rad]
BLIND = range(30, 45)  # ticks without a star tracker, which else reads each second one
SETTINGS = AppendageModesSettings(effort_noise=1e-3, initial=1e-3)
TORQUE = np.array([0.2, -0.15, 0.1])  # of the slew, then back [N m]


def craft(name: str = "three_axes", settings: AppendageModesSettings = SETTINGS) -> FlexibleFilter:
    model = read_testbed(example_values(name)["testbed"], "testbed").model()
    return flexible_filter(model, NOISE, settings, PERIOD)


class Known(NamedTuple):
    """How far off a filter is, tick by tick, and what it says of that."""

    nees: Vector  # (ticks,)
    nis: Vector  # (ticks,)
    read: Vector  # innovations that count, (ticks,)
    turn: Vector  # error of the attitude, (ticks,) [rad]
    rate: Vector  # of the body rate, (ticks,) [rad/s]


def flown(
    it: FlexibleFilter, chosen: Any, seed: int, slew: bool, bias: float = BIAS, ticks: int = TICKS
) -> Known:
    """Return the errors of a filter in a flight; NEES of all states of FlexibleFilter."""
    rng, model, n, m = np.random.default_rng(seed), it.model, it.platform.small.coordinates, 3
    settings = GyroSettings(
        kind="gyro", angle_random_walk=NOISE.white, rate_random_walk=NOISE.walk, bias_spread=bias
    )
    reader = TickReader(Gyro("gyro", 0, settings), PERIOD, rng)
    own = it.platform.small.linear
    bent = it.settings.initial * rng.standard_normal((2, n - m))
    bent[1] *= np.sqrt(np.diag(own.stiffness) / np.diag(own.mass))[m:]
    q = model.rest({})
    q[q.size - model.modes :] = it.found.elastic(model.modes) @ bent[0]
    x = np.concatenate((q, it.found.basis[:, m:] @ bent[1]))
    start = Rotation.random(random_state=seed).as_quat()
    to_coordinates = np.linalg.pinv(it.found.basis)
    elastic = np.linalg.pinv(it.found.elastic(model.modes))

    def body(x: Vector) -> tuple[Vector, Vector]:
        position, rate = model.joint_state(x)
        return product(start, it.joints.orientation(position)), it.joints.rotation_vector_of(rate)

    def tracked(attitude: Vector) -> Vector:
        return product(attitude, quaternion(TRACKER * rng.standard_normal(3)))

    attitude, rate = body(x)
    belief = chosen.begin(start, reader(BodyState(attitude, rate)), (1.0, bias))
    noise = TRACKER**2 * np.eye(3)
    initialize_attitude(chosen.errors, belief, tracked(attitude), noise)
    rows = []
    for k in range(ticks):
        effort = slew * TORQUE * (1.0 if k < TICKS // 2 else -1.0)
        pushed = effort + SETTINGS.effort_noise / np.sqrt(PERIOD) * rng.standard_normal(m)
        x = model.advance(x, pushed, PERIOD, 2)
        attitude, rate = body(x)
        reading = reader(BodyState(attitude, rate))
        told = chosen.propagate(belief, reading, effort)
        belief, nis, read = told.estimate, told.nis, told.innovation.size
        if k % 2 and k not in BLIND:
            measured, read = tracked(attitude), read + 3
            nis += update_attitude(chosen.errors, belief, measured, noise, np.empty(3))
        turn = rotation_vector(product(conjugate(belief.state[:FIRST_BIAS]), attitude))
        off, nees = rate - chosen.rate(belief, reading), 0.0
        if chosen is it:
            q, v = model.split(x)
            own_bias, modes, rates = np.split(belief.state[FIRST_BIAS:], [3, 3 + model.modes])
            error = np.concatenate((
                it.joints.axes @ turn, reader.memory[OWN_BIAS] - own_bias,
                elastic @ (q[q.size - model.modes :] - modes), to_coordinates @ (v - rates),
            ))  # fmt: skip
            nees = float(error @ np.linalg.solve(belief.covariance, error))
        rows.append((nees, nis, read, np.linalg.norm(turn), np.linalg.norm(off)))
    return Known(*np.array(rows).T)


def band(share: float, degrees: float, count: int) -> tuple[float, float]:
    """Return where the mean of `count` squares with so many degrees in all lies that often."""
    outside = 0.5 * (1.0 - share)
    return chi2.ppf(outside, degrees) / count, chi2.ppf(1.0 - outside, degrees) / count


@pytest.mark.slow
@pytest.mark.parametrize("slew", representatives([False, True], True), ids=["rest", "slew"])
def test_errors_and_innovations_are_as_large_as_the_covariance_says(slew: bool) -> None:
    """At rest and slewing, modes and rates included, all through a dropout of the star tracker."""
    it = craft()
    runs = [flown(it, it, seed, slew) for seed in range(SEEDS)]
    states = 2 * it.platform.small.coordinates + 3
    nees: Matrix = np.array([run.nees for run in runs])
    low, high = band(0.95, SEEDS * states, SEEDS)
    average = nees.mean(axis=0)  # over the seeds, tick by tick
    assert low < average.mean() < high
    low, high = band(1.0 - 0.05 / average.size, SEEDS * states, SEEDS)  # of all ticks together
    assert low < average.min()
    assert average.max() < high
    used = np.array([run.read for run in runs]).sum()
    low, high = band(0.95, int(used), int(used))
    assert low < np.array([run.nis for run in runs]).sum() / used < high


@pytest.mark.parametrize(
    ("bias", "initial", "least", "most"),
    [
        (5e-3, 1e-3, 0.8, 1.25),
        (BIAS, 1e-2, 0.8, 1.25),
        (1e-2, 1e-3, 1.2, 2.5),  # of 15 states 27 and 84: twice either error, and more
        (BIAS, 3e-2, 3.0, 12.0),
    ],
)
def test_errors_of_the_start_that_the_filter_covers_are_those_that_the_docs_state(
    bias: float, initial: float, least: float, most: float
) -> None:
    """NEES over the number of states, at the worst tick of 20: its small motions are linear."""
    it = craft(settings=AppendageModesSettings(effort_noise=1e-3, initial=initial))
    runs = [flown(it, it, seed, True, bias, ticks=20).nees for seed in range(12)]
    states = 2 * it.platform.small.coordinates + 3
    assert least < np.mean(runs, axis=0).max() / states < most


def test_with_modes_attitude_and_rate_are_known_better_than_by_the_gyro_alone() -> None:
    it = craft()
    runs = [
        [flown(it, one, seed, slew=True) for seed in range(6)]
        for one in (it, RigidFilter(NOISE, PERIOD))
    ]
    turn, rate = (
        [np.sqrt(np.mean([getattr(run, name)[10:] ** 2 for run in each])) for each in runs]
        for name in ("turn", "rate")
    )
    assert turn[0] < 0.8 * turn[1]
    assert rate[0] < 0.3 * rate[1]


def test_a_craft_that_more_joints_turn_is_refused_with_what_to_do() -> None:
    with pytest.raises(BadInput, match=r"three joints that turn it, and no others"):
        craft("observatory")


@pytest.mark.parametrize("seed", range(3))
def test_the_gyro_tells_as_much_where_the_attitude_is_unknown(seed: int) -> None:
    """An attitude known to a radian hides nothing of a gyro that is right to 1e-5 rad/s."""
    rng = np.random.default_rng(seed)
    model = read_testbed(example_values("three_axes")["testbed"], "testbed").model()
    it = flexible_filter(model, GyroNoise(2e-6, 0.0), SETTINGS, 0.02)
    efforts, readings = 0.2 * rng.standard_normal((8, 3)), 1e-2 * rng.standard_normal((8, 3))
    start = Rotation.random(random_state=seed).as_quat()
    beliefs = []
    for sigma in (1e-5, 1.0):
        belief = it.begin(start, readings[0], (sigma, BIAS))
        for effort, reading in zip(efforts, readings, strict=True):
            belief = it.propagate(belief, reading, effort).estimate
        beliefs.append(np.split(belief.state, [FIRST_BIAS, MODES, MODES + model.modes]))
    for known, unknown in zip(*beliefs, strict=True):
        assert abs(unknown - known).max() < 1e-10 * abs(known).max()
