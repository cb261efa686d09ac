import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from flexslew_plant.hardware.actuator import Actuator, ActuatorSettings

LIMIT, PERIOD = np.array([150.0, 100.0]), 0.01


def actuator(**settings: Any) -> Actuator:
    return Actuator(ActuatorSettings(**settings), LIMIT, PERIOD)


def test_by_default_the_demand_is_the_effort() -> None:
    demand = np.array([12.5, -33.25])
    motor = actuator()
    np.testing.assert_array_equal(motor.apply(demand), demand)
    assert motor.saturated is False


def test_the_limit_of_each_joint_holds_and_is_told() -> None:
    motor = actuator()
    np.testing.assert_array_equal(motor.apply(np.array([400.0, -400.0])), [150.0, -100.0])
    assert motor.saturated is True
    motor.apply(np.array([150.0, -100.0]))
    assert motor.saturated is False


def test_the_slew_rate_bounds_every_change() -> None:
    motor = actuator(slew_rate=500.0)
    efforts = np.array([motor.apply(np.array([12.0, -12.0])) for _ in range(4)])
    # 5 N m a tick, and each tick has the mean of its ramp: the third ends after 4 ms at 12 N m
    np.testing.assert_allclose(efforts[:, 0], [2.5, 7.5, 12.0 - 0.5 * 2.0 * 0.4, 12.0])
    np.testing.assert_allclose(efforts[:, 1], -efforts[:, 0])


EVERY = 0.1  # seconds from one of the demands to the next
DEMANDS = np.random.default_rng(5).uniform(-9.0, 9.0, 30)


@cache
def ramped(rate: float, lag: float) -> Any:
    """Return the impulse of the continuous response up to every change of the demand.

    Integrated in steps of 20 us, which the ramp and the lag take piece by piece.
    """
    u, z, impulse, found = 0.0, 0.0, 0.0, []
    steps = round(EVERY / 2e-5)
    dt = EVERY / steps
    kept = math.exp(-dt / lag) if lag else 0.0
    for demand in DEMANDS.tolist():
        for _ in range(steps):
            before = u
            u += min(max(demand - u, -rate * dt), rate * dt)
            if not lag:
                impulse += 0.5 * (before + u) * dt
                continue
            slope = (u - before) / dt
            after = u - slope * lag + (z - before + slope * lag) * kept
            impulse += 0.5 * (before + u) * dt - lag * (after - z)
            z = after
        found.append(impulse)
    return np.array(found)


@pytest.mark.parametrize("lag", [0.0, 0.004, 0.3])
@pytest.mark.parametrize("rate", [30.0, 177.0, 2500.0])
@pytest.mark.parametrize("period", [0.1, 0.05, 0.02, 0.01, 0.001])
def test_the_impulse_of_a_slew_rate_does_not_depend_on_the_period(
    period: float, rate: float, lag: float
) -> None:
    motor = Actuator(ActuatorSettings(slew_rate=rate, lag=lag), np.array([150.0]), period)
    impulse, found = 0.0, []
    for demand in DEMANDS:
        for _ in range(round(EVERY / period)):
            impulse += float(motor.apply(np.array([demand]))[0]) * period
        found.append(impulse)
    # the comparison meets the demand at the end of a step of 20 us: half a step of one change
    most = 30 * 2e-5 * rate * 2e-5
    np.testing.assert_allclose(found, ramped(rate, lag), rtol=0.0, atol=most + 1e-12)


@pytest.mark.parametrize("period", [0.05, 0.01])
def test_a_flight_under_a_slew_rate_is_the_same_at_every_period(period: float) -> None:
    # a unit mass under a demand that steps every 0.1 s: the rate after 3 s is the impulse
    demands = np.repeat([2.0, -1.0, 3.0, 0.0, -2.0], 6)
    motor = Actuator(ActuatorSettings(slew_rate=20.0), np.array([150.0]), period)
    rate = sum(
        float(motor.apply(np.array([d]))[0]) * period
        for d in demands
        for _ in range(round(0.1 / period))
    )
    # every step of the demand by c is late by c / rate: the impulse misses c |c| / (2 rate)
    steps = np.diff(np.concatenate(([0.0], demands)))
    expected = 0.1 * demands.sum() - (steps * abs(steps)).sum() / 40.0
    assert rate == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("periods", [0.1, 0.3, 1.0, 5.0, 30.0, 100.0])
def test_the_impulse_of_every_tick_is_that_of_the_continuous_lag(periods: float) -> None:
    demands = np.random.default_rng(3).uniform(-90.0, 90.0, (60, 2))
    lag = periods * PERIOD
    motor, torque = actuator(lag=lag), np.zeros(2)
    # (torque, impulse, demand)' = ((demand - torque) / lag, torque, 0)
    tick = expm(PERIOD * np.array([[-1.0 / lag, 0.0, 1.0 / lag], [1.0, 0.0, 0.0], [0.0] * 3]))
    for demand in demands:
        torque, impulse, _ = tick @ np.array([torque, np.zeros(2), demand])
        np.testing.assert_allclose(motor.apply(demand) * PERIOD, impulse, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("lag", [0.001, 0.005, 0.05, 1.0])
def test_a_lag_delays_a_step_by_its_time_constant(lag: float) -> None:
    motor, step = actuator(lag=lag), np.array([10.0, -10.0])
    ticks = max(10, round(40.0 * lag / PERIOD))
    missing = sum(step - motor.apply(step) for _ in range(ticks)) * PERIOD
    np.testing.assert_allclose(missing / step, lag, rtol=1e-12)


def test_torques_are_multiples_of_the_quantum() -> None:
    motor = actuator(quantisation=0.5)
    np.testing.assert_allclose(motor.apply(np.array([1.3, -7.1])), [1.5, -7.0])


def test_a_coarse_quantum_does_not_stop_a_slow_ramp() -> None:
    motor = actuator(quantisation=1.0, slew_rate=20.0)  # 0.2 N m a tick
    for _ in range(200):
        effort = motor.apply(np.array([3.0, 3.0]))
    np.testing.assert_allclose(effort, 3.0)


def test_quantised_torques_stay_within_the_limit() -> None:
    motor = Actuator(ActuatorSettings(quantisation=4.0), np.array([11.0, 11.0]), PERIOD)
    np.testing.assert_array_equal(motor.apply(np.array([30.0, -30.0])), [8.0, -8.0])


def test_a_limit_that_is_a_multiple_of_the_quantum_can_be_given() -> None:
    for quantum in (0.1, 0.2, 0.7, 1.0 / 3.0, 0.05, 2.5):
        for parts in range(1, 60):
            limit = float(f"{parts * quantum:.14g}")  # 0.3 / 0.1 is less than 3
            motor = Actuator(ActuatorSettings(quantisation=quantum), np.array([limit]), PERIOD)
            given = [motor.apply(np.array([demand]))[0] for demand in (2.0 * limit, -limit)]
            np.testing.assert_allclose(given, [limit, -limit], rtol=1e-12)
            assert np.abs(given).max() <= limit


def test_reset_forgets() -> None:
    motor = actuator(lag=0.05, slew_rate=100.0)
    fresh = [motor.apply(np.array([5.0, 5.0])).copy() for _ in range(3)]
    motor.reset()
    again = [motor.apply(np.array([5.0, 5.0])).copy() for _ in range(3)]
    np.testing.assert_array_equal(fresh, again)


@pytest.mark.parametrize("settings", [{}, {"lag": 0.1}, {"slew_rate": 50.0}])
def test_the_demand_is_left_alone(settings: Any) -> None:
    demand = np.array([300.0, 20.0])
    actuator(**settings).apply(demand)
    np.testing.assert_array_equal(demand, [300.0, 20.0])
