"""Compiled readers say tick by tick what numpy and scipy make of the same random numbers.

A campaign over the errors of every kind of instrument, delays, gaps and the lack of noise.
"""

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.instruments import (
    BodyState,
    Gyro,
    GyroSettings,
    Instrument,
    Resolver,
    ResolverSettings,
    StarTracker,
    StarTrackerSettings,
    SunSensor,
    SunSensorSettings,
    Tachometer,
    TachometerSettings,
)
from flexslew_plant.testbeds.instruments.instrument import TickReader, channels
from flexslew_plant.testbeds.instruments.packed_readers import packed_readers, read_instruments

PERIOD, TICKS = 0.05, 300
SUN = np.array([2.0, -1.0, 2.0]) / 3.0
Draws: TypeAlias = np.random.Generator | None
Plain: TypeAlias = Callable[[Any, Draws, list[BodyState]], Matrix]


def gyro_rows(settings: GyroSettings, rng: Draws, bodies: list[BodyState]) -> Matrix:
    """Return what Farrenkopf's gyro reads."""
    s, bias = settings, np.zeros(3)
    if rng is not None:
        bias = np.array(s.bias) + s.bias_spread * rng.standard_normal(3)
    skewed = Rotation.from_rotvec(s.misalignment).as_matrix().T
    rows = []
    for k, body in enumerate(bodies):
        rate = body.rate
        if k:
            turn = Rotation.from_quat(bodies[k - 1].attitude).inv() * Rotation.from_quat(body[0])
            rate = turn.as_rotvec() / PERIOD
        if rng is not None:
            walk, bridge, white = rng.standard_normal((3, 3))
            step = (k > 0) * s.rate_random_walk * np.sqrt(PERIOD) * walk
            mean = bias + step / 2.0 + s.rate_random_walk * np.sqrt(PERIOD / 12.0) * bridge
            noise = s.angle_random_walk / np.sqrt(PERIOD) * white
            rate = np.diag(1.0 + np.array(s.scale)) @ skewed @ rate + mean + noise
            bias = bias + step
        rows.append(rate)
    return np.array(rows)


def tracker_rows(settings: StarTrackerSettings, rng: Draws, bodies: list[BodyState]) -> Matrix:
    """Return the attitudes of a star tracker, late and with gaps."""
    s, late = settings, round(settings.delay / PERIOD)
    along = np.array(s.boresight) / np.linalg.norm(s.boresight)
    rows = [np.zeros(4)] * late
    for k, body in enumerate(bodies):
        chance, noise = (1.0, np.zeros(3))
        if rng is not None:
            chance, noise = rng.random(), rng.standard_normal(3)
        rate = float(np.linalg.norm(body.rate))
        part, more = (along @ noise) * along, s.rate_noise * rate
        turn = np.hypot(s.across, more) * (noise - part) + np.hypot(s.about, more) * part
        q = (Rotation.from_quat(body.attitude) * Rotation.from_rotvec(turn)).as_quat()
        gone = k % max(1, round(s.interval / PERIOD)) > 0 or chance < s.dropout
        gone = gone or (s.rate_limit is not None and rate > s.rate_limit)
        gone = gone or any(start <= k * PERIOD < end for start, end in s.blind)
        rows.append(np.zeros(4) if gone else q * np.sign(q[3]))
    return np.array(rows[: len(bodies)])


def sun_rows(settings: SunSensorSettings, rng: Draws, bodies: list[BodyState]) -> Matrix:
    """Return the directions of a Sun sensor."""
    rows = []
    for body in bodies:
        noise = np.zeros(3) if rng is None else settings.noise * rng.standard_normal(3)
        sun = Rotation.from_quat(body.attitude).inv().apply(SUN)
        off = sun + noise - (noise @ sun) * sun
        along = np.array(settings.boresight) / np.linalg.norm(settings.boresight)
        rows.append((along @ sun >= np.cos(settings.half_angle)) * off / np.linalg.norm(off))
    return np.array(rows)


def rotor_rows(
    settings: TachometerSettings | ResolverSettings, rng: Draws, bodies: list[BodyState]
) -> Matrix:
    """Return what tachometers or resolvers read."""
    is_speed = settings.kind == "tachometer"
    rows = np.array([body.wheels if is_speed else body.gimbals for body in bodies])
    return rows if rng is None else rows + settings.noise * rng.standard_normal(rows.shape)


def motion(rng: np.random.Generator, wheels: int, gimbals: int) -> list[BodyState]:
    """Return bodies that turn by rates which wander."""
    attitude, rate, bodies = Rotation.random(random_state=rng), np.zeros(3), []
    for _ in range(TICKS):
        rate = 0.97 * rate + 0.05 * rng.standard_normal(3)
        attitude = attitude * Rotation.from_rotvec(PERIOD * rate)
        speeds, angles = rng.standard_normal(wheels), rng.standard_normal(gimbals)
        sign = rng.choice([-1.0, 1.0])  # both signs of a quaternion are one attitude
        bodies.append(BodyState(sign * attitude.as_quat(), rate.copy(), speeds, angles))
    return bodies


def instrument_of(kind: int, first: int, rng: np.random.Generator) -> tuple[Any, Any, Plain]:
    """Return an instrument with errors of any size, its settings and its equations."""

    def some(size: float) -> float:
        return float(rng.choice([0.0, size]))

    def pointed(size: float = 1.0) -> Any:
        return tuple((size * rng.standard_normal(3)).tolist())

    if kind == 0:
        settings: Any = GyroSettings(
            kind="gyro", angle_random_walk=some(1e-3), rate_random_walk=some(1e-3),
            bias=pointed(some(1e-3)), bias_spread=some(1e-3), scale=pointed(some(1e-2)),
            misalignment=pointed(some(0.1)),
        )  # fmt: skip
        return Gyro("", first, settings), settings, gyro_rows
    if kind == 1:
        settings = StarTrackerSettings(
            kind="star_tracker", boresight=pointed(), across=some(1e-4), about=some(1e-3),
            rate_noise=some(1e-2), rate_limit=0.25 if rng.random() < 0.5 else None,
            interval=some(0.2), delay=some(PERIOD * rng.integers(1, 6)), dropout=some(0.3),
            blind=((1.0, 2.0), (2.5, 2.6))[: rng.integers(0, 3)],
        )  # fmt: skip
        return StarTracker("", first, settings), settings, tracker_rows
    if kind == 2:
        settings = SunSensorSettings(
            kind="sun_sensor", boresight=pointed(), half_angle=1.5, noise=some(1e-3)
        )
        return SunSensor("", first, settings, SUN), settings, sun_rows
    if kind == 3:
        settings = TachometerSettings(kind="tachometer", noise=some(0.1))
        return Tachometer("", first, ("a", "b", "c", "d"), settings), settings, rotor_rows
    settings = ResolverSettings(kind="resolver", noise=some(0.1))
    return Resolver("", first, ("a", "b"), settings), settings, rotor_rows


def craft(rng: np.random.Generator) -> list[tuple[Instrument, Any, Plain]]:
    """Return instruments in any order, with their settings and equations."""
    sensors, first = list[tuple[Instrument, Any, Plain]](), int(rng.integers(0, 4))
    for kind in rng.permutation([0, 0, 1, 1, 1, 2, 3, 4])[: rng.integers(1, 9)]:
        sensors.append(instrument_of(kind, first, rng))
        first += len(sensors[-1][0].axes) + int(rng.integers(0, 2))
    return sensors


def streams(sensors: list[Any], exact: bool) -> list[Draws]:
    return [None if exact else np.random.default_rng([7, 0, k]) for k in range(len(sensors))]


@pytest.mark.first(8)
@pytest.mark.parametrize("seed", range(24))
def test_instruments_read_what_their_equations_say_of_the_same_random_numbers(seed: int) -> None:
    rng = np.random.default_rng([seed, 5])
    sensors, bodies, exact = craft(rng), motion(rng, 4, 2), seed % 4 == 0
    instruments = [one for one, _, _ in sensors]
    packed = packed_readers(instruments, PERIOD, streams(sensors, exact))
    memory, end = packed.memory.copy(), channels(instruments[-1]).stop + 2
    tips = np.full((TICKS, end), 9.0)
    for start in range(0, TICKS, 70):  # drawn chunk after chunk
        rows = packed.draw(70)
        for k in range(start, min(start + 70, TICKS)):
            body, drawn = np.concatenate(bodies[k]), rows[k - start]
            read_instruments(k, packed.layout, packed.constants, body, drawn, memory, tips[k])
    ticking = [
        TickReader(one, PERIOD, own)
        for one, own in zip(instruments, streams(sensors, exact), strict=True)
    ]
    others = np.ones(end, dtype=bool)
    rows_of = zip(sensors, ticking, streams(sensors, exact), strict=True)
    for (one, settings, plain), reader, own in rows_of:
        found, others[channels(one)] = tips[:, channels(one)], False
        each = np.array([reader(body) for body in bodies])
        assert each.tobytes() == np.ascontiguousarray(found).tobytes()
        # a rate is the quotient of a turn, with the rounding of a quaternion, and a short tick
        np.testing.assert_allclose(found, plain(settings, own, bodies), rtol=1e-12, atol=3e-14)
    assert (tips[:, others] == 9.0).all()


@pytest.mark.parametrize("uniform", [0, 1])
def test_random_numbers_of_many_ticks_are_those_of_one_tick_after_another(uniform: int) -> None:
    tracker = StarTracker("", 0, StarTrackerSettings(kind="star_tracker"))
    reader = tracker.reader(PERIOD, None)._replace(uniform=uniform)
    first, second = np.random.default_rng([3, 1, 4]), np.random.default_rng([3, 1, 4])
    found: Matrix = np.vstack([reader.draw(first, ticks) for ticks in (1, 500, 4000)])
    rows: list[Vector] = [
        np.concatenate((second.random(uniform), second.standard_normal(3))) for _ in found
    ]
    assert found.tobytes() == np.array(rows).tobytes()
    assert not reader.draw(None, 5).any()
