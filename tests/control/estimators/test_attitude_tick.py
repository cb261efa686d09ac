"""The compiled tick believes what AttitudeEstimator believes, and its steps are Kalman's.

A campaign over delays, gaps, sensors, joints and noises; readings are those of the instruments.
"""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.representatives import products

from flexslew_control.estimators.attitude_estimator import (
    AttitudeEstimator,
    AttitudeFilterSettings,
)
from flexslew_control.estimators.attitude_filter import GyroNoise, RigidFilter, copied
from flexslew_control.estimators.attitude_steps import (
    BIAS,
    AttitudeEstimate,
    rigid_errors,
    update_attitude,
    update_direction,
    write_cross_axes,
)
from flexslew_control.estimators.attitude_tick import (
    AttitudeNumbers,
    attitude_memory,
    attitude_tick,
    numbers_of,
)
from flexslew_control.law import Reference
from flexslew_plant.arrays import EMPTY, Matrix, Vector
from flexslew_plant.measurement import Measurement
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
from flexslew_plant.testbeds.instruments.instrument import TickReader, channels
from flexslew_plant.testbeds.orientation.attitude import AttitudeJoints, skew

PERIOD, TICKS = 0.1, 250


class Flight(NamedTuple):
    """What a filter is told, tick by tick."""

    tips: Matrix
    measured: Matrix  # positions, then velocities of the joints
    reference: Matrix


def craft(
    rng: np.random.Generator, trackers: int, suns: int, delays: tuple[int, ...]
) -> tuple[AttitudeEstimator, list[Instrument]]:
    """Return an estimator, and the sensors in the order of their channels."""
    gyro = Gyro(
        "", 0, GyroSettings(
            kind="gyro", angle_random_walk=2e-5, rate_random_walk=rng.choice([0.0, 3e-6]),
            bias_spread=1e-3, scale=(1e-3, 0.0, -1e-3), misalignment=(0.0, 1e-3, 0.0),
        )
    )  # fmt: skip
    first, stars, dials = 4, list[StarTracker](), list[SunSensor]()  # channel 3 is not theirs
    for k in range(trackers):
        settings = StarTrackerSettings(
            kind="star_tracker", boresight=tuple(rng.standard_normal(3).tolist()), across=2e-5,
            about=1.5e-4, rate_noise=rng.choice([0.0, 2e-3]), rate_limit=rng.choice([0.2, 9.0]),
            interval=rng.choice([0.0, 0.3]), delay=PERIOD * delays[k], dropout=rng.choice([0, 0.3]),
            blind=((0.0, 0.5), (8.0, 12.0))[: rng.integers(0, 3)],
        )  # fmt: skip
        stars.append(StarTracker("", first, settings))
        first += 4
    for _ in range(suns):
        seen = SunSensorSettings(kind="sun_sensor", noise=1e-4, half_angle=1.8)
        towards = rng.standard_normal(3)
        dials.append(SunSensor("", first, seen, towards / np.linalg.norm(towards)))
        first += 3
    axes = rng.standard_normal((3, 3))
    if rng.random() < 0.5:  # a joint in the middle that reads something else
        axes = np.insert(axes, 1, 0.0, axis=0)
    filter_ = AttitudeFilterSettings(noise_factor=rng.choice([1.0, 3.0]), initial_bias=1e-3)
    factor, s = filter_.noise_factor, gyro.settings
    it = AttitudeEstimator(
        AttitudeJoints(axes), gyro, tuple(stars), tuple(dials), filter_, PERIOD,
        RigidFilter(GyroNoise(factor * s.angle_random_walk, factor * s.rate_random_walk), PERIOD),
    )  # fmt: skip
    return it, [gyro, *stars, *dials]


def flight(rng: np.random.Generator, it: AttitudeEstimator, sensors: list[Instrument]) -> Flight:
    """Return the readings of a craft that turns by rates which wander, some of them broken."""
    attitude, rate = Rotation.random(random_state=rng), np.zeros(3)
    joints, end = len(it.joints.axes), channels(sensors[-1]).stop
    noise = rng.random() < 0.8
    readers = [TickReader(one, PERIOD, rng.spawn(1)[0] if noise else None) for one in sensors]
    tips = rng.standard_normal((TICKS, end))
    for k in range(TICKS):
        rate = 0.97 * rate + 0.02 * rng.standard_normal(3)
        attitude = attitude * Rotation.from_rotvec(PERIOD * rate)
        for one, read in zip(sensors, readers, strict=True):
            tips[k, channels(one)] = read(BodyState(attitude.as_quat(), rate))
            if one is not it.gyro and rng.random() < 0.05:
                tips[k, channels(one)] = rng.choice([np.nan, 0.0])
    moved = np.cumsum(0.05 * rng.standard_normal((TICKS, joints)), axis=0)
    reference = np.ascontiguousarray(moved if rng.random() < 0.8 else np.zeros((TICKS, joints)))
    return Flight(tips, rng.standard_normal((TICKS, 2 * joints)), reference)


def estimated(it: AttitudeEstimator, flown: Flight) -> Matrix:
    """Return positions and velocities that the estimator believes."""
    rows = []
    for k, (tips, measured, reference) in enumerate(zip(*flown, strict=True)):
        position, velocity = np.split(measured, 2)
        still = np.zeros(len(position))
        it.expect(Reference(reference, still, still, EMPTY))
        seen = Measurement(k, 0, k * PERIOD, "", position, velocity, tips, tips, still)
        if k == 0:
            it.reset(seen)
        found = it.update(seen)
        rows.append(np.concatenate((found.position, found.velocity)))
    return np.array(rows)


def ticked(numbers: AttitudeNumbers, flown: Flight) -> Matrix:
    """Return the same of the compiled tick."""
    memory = np.full(attitude_memory(numbers, flown.tips.shape[1]), 7.0)
    believed = np.empty_like(flown.measured)
    for k, given in enumerate(zip(*flown, strict=True)):
        attitude_tick(k, numbers, *given, memory, believed[k])
    return believed


@pytest.mark.parametrize(
    ("delays", "suns"), products([(0,), (1,), (4,), (0, 3), (2, 2), (5, 1)], [0, 1, 2])
)
def test_the_compiled_tick_believes_what_the_estimator_believes(
    delays: tuple[int, ...], suns: int
) -> None:
    for seed in range(6):
        rng = np.random.default_rng([seed, suns, *delays])
        it, sensors = craft(rng, len(delays), suns, delays)
        flown = flight(rng, it, sensors)
        expected, found = estimated(it, flown), ticked(it.numbers, flown)
        moving = np.flatnonzero(it.joints.reads)
        # the belief says something: it is neither the reference nor what the joints measure
        assert abs(found[:, : len(it.joints.axes)] - flown.reference)[:, moving].max() > 1e-3
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


def test_members_beside_each_other_have_constants_of_their_own() -> None:
    crafts = [craft(np.random.default_rng(5), 2, 1, delays)[0] for delays in ((0, 2), (1, 3))]
    each = [it.numbers for it in crafts]
    both = AttitudeNumbers(*(np.array(parts) for parts in zip(*each, strict=True)))
    for member, own in enumerate(each):
        for part, expected in zip(numbers_of(both, member), own, strict=True):
            assert part.dtype == expected.dtype
            np.testing.assert_array_equal(part, expected)


def belief(rng: np.random.Generator) -> AttitudeEstimate:
    """Return any belief."""
    root = np.diag([1e-4] * 3 + [1e-5] * 3) @ rng.standard_normal((6, 6))
    attitude = Rotation.random(random_state=rng).as_quat()
    state = np.concatenate((attitude, 1e-3 * rng.standard_normal(3)))
    return AttitudeEstimate(state, root @ root.T)


def require_kalman(
    before: AttitudeEstimate,
    after: AttitudeEstimate,
    shows: Matrix,
    noise: Matrix,
    innovation: Vector,
    nis: float,
) -> None:
    """Require the correction that the textbook has, in the form P - K H P."""
    p, h = before.covariance, np.hstack((shows, np.zeros_like(shows)))
    s = h @ p @ h.T + noise
    gain = p @ h.T @ np.linalg.inv(s)
    error = gain @ innovation
    turned = Rotation.from_quat(before.state[:BIAS]) * Rotation.from_rotvec(error[:3])
    off = (turned.inv() * Rotation.from_quat(after.state[:BIAS])).as_rotvec()
    np.testing.assert_allclose(off, 0.0, atol=1e-15)
    expected = before.state[BIAS:] + error[3:]
    np.testing.assert_allclose(after.state[BIAS:], expected, rtol=1e-12, atol=1e-18)
    size = np.sqrt(np.diag(p))
    scaled = (after.covariance - (p - gain @ h @ p)) / np.outer(size, size)
    np.testing.assert_allclose(scaled, 0.0, atol=1e-12)
    assert nis == pytest.approx(innovation @ np.linalg.solve(s, innovation), rel=1e-11)


@pytest.mark.parametrize("seed", range(30))
def test_corrections_are_those_of_a_kalman_filter(seed: int) -> None:
    rng = np.random.default_rng([seed, 1])
    it, root = belief(rng), 1e-4 * rng.standard_normal((3, 3))
    true, noise = Rotation.from_quat(it.state[:BIAS]), root @ root.T + 1e-9 * np.eye(3)
    off = 1e-3 * rng.standard_normal(3)
    measured = rng.choice([-1.0, 1.0]) * (true * Rotation.from_rotvec(off)).as_quat()
    after, innovation = copied(it), np.empty(3)
    nis = update_attitude(rigid_errors(), after, measured, noise, innovation)
    np.testing.assert_allclose(innovation, off, rtol=1e-11)
    require_kalman(it, after, np.eye(3), noise, innovation, nis)
    inertial = rng.standard_normal(3)
    inertial /= np.linalg.norm(inertial)
    seen, sigma = true.inv().apply(inertial), 1e-4
    read = seen + 1e-4 * rng.standard_normal(3)
    two = cross_axes(seen)
    after, innovation = copied(it), np.empty(2)
    nis = update_direction(rigid_errors(), after, read, inertial, sigma, innovation)
    np.testing.assert_allclose(innovation, two @ read, atol=1e-15)
    shows, flat = two @ skew(seen), sigma**2 * np.eye(2)
    require_kalman(it, after, shows, flat, innovation, nis)


@pytest.mark.parametrize("seed", range(30))
def test_a_belief_is_carried_as_farrenkopf_has_it(seed: int) -> None:
    rng = np.random.default_rng([seed, 2])
    it, noise, dt = belief(rng), GyroNoise(2e-4, 3e-6), 0.1
    reading = 0.3 * rng.standard_normal(3)
    turn = (reading - it.state[BIAS:]) * dt
    after = RigidFilter(noise, dt).propagate(it, reading, EMPTY).estimate
    q = (Rotation.from_quat(it.state[:BIAS]) * Rotation.from_rotvec(turn)).as_quat()
    attitude = after.state[:BIAS]
    np.testing.assert_allclose(attitude * np.sign(attitude @ q), q, atol=1e-15)
    step = np.eye(6)
    step[:3, :3] = Rotation.from_rotvec(turn).as_matrix().T
    step[:3, 3:] = -dt * (np.eye(3) - 0.5 * skew(turn))
    grown = np.array(
        [[noise[0] ** 2 * dt + noise[1] ** 2 * dt**3 / 3.0, -0.5 * noise[1] ** 2 * dt**2],
         [-0.5 * noise[1] ** 2 * dt**2, noise[1] ** 2 * dt]]
    )  # fmt: skip
    expected = step @ it.covariance @ step.T + np.kron(grown, np.eye(3))
    size = np.sqrt(np.diag(expected))
    scaled = (after.covariance - expected) / np.outer(size, size)
    np.testing.assert_allclose(scaled, 0.0, atol=1e-13)


def cross_axes(seen: Vector) -> Matrix:
    """Return two unit vectors across a direction and each other, shape (2, 3)."""
    two = np.empty((2, 3))
    write_cross_axes(seen[0], seen[1], seen[2], two)
    return two


@pytest.mark.parametrize("seed", range(20))
def test_two_directions_are_across_the_third_as_in_its_svd(seed: int) -> None:
    seen = np.random.default_rng([seed, 3]).standard_normal(3)
    seen = np.sign(seen) * np.eye(3)[seed % 3] if seed < 6 else seen / np.linalg.norm(seen)
    np.testing.assert_allclose(cross_axes(seen), np.linalg.svd(seen[None])[2][1:], atol=1e-14)
