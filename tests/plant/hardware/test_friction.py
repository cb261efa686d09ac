"""Friction: stable at any period, of second order, it holds, and it never gives energy."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flexslew_lab.trial.sources import trial_path
from flexslew_lab.trial.trial import bench_settings, load_trial
from flexslew_plant.bench.bench import Bench
from flexslew_plant.errors import BadInput
from flexslew_plant.hardware.actuator import ActuatorSettings
from flexslew_plant.hardware.friction import Friction, balanced, friction_velocity
from flexslew_plant.settings import validated
from flexslew_plant.testbeds.csa import CsaTestbed
from flexslew_plant.testbeds.oscillators.floating_oscillator import FloatingOscillatorTestbed

OSCILLATOR = FloatingOscillatorTestbed().model()  # masses of 1 kg, a spring of 1 N/m
CSA = CsaTestbed(modes=2).model()


def flown(
    model: Any, x: Any, period: Any, ticks: Any, effort: Any = lambda time: 0.0, **actuator: Any
) -> Any:
    """Return the states at the ticks, (ticks + 1, 2 n), without a bench around."""
    friction = Friction(model.resolved_motors, ActuatorSettings(**actuator), period)
    m, n = model.joints, model.coordinates
    states = [np.array(x, dtype=float)]
    for k in range(ticks):
        now, u = states[-1], np.broadcast_to(effort(k * period), m).astype(float)
        mobility = model.jacobian(now, u)[1][n : n + m]

        def step(total: Any, now: Any = now) -> Any:
            return model.advance(now, total, period)

        states.append(friction.advance(now, u, mobility, step))
    return np.array(states)


def test_a_joint_slides_as_the_closed_forms_say() -> None:
    viscous = friction_velocity(0.7, 0.3, 4.0, 0.0, 1e-4, 0.5)
    assert viscous == pytest.approx(0.075 + (0.7 - 0.075) * np.exp(-2.0), rel=1e-12)
    for v, coulomb, speed, dt in ((0.3, 0.2, 0.1, 1.0), (-2e-4, 0.05, 1e-4, 0.01)):
        # v' = -b tanh(v / v_c): sinh(v / v_c) shrinks with exp(-b t / v_c)
        left = np.sinh(v / speed) * np.exp(-coulomb * dt / speed)
        assert friction_velocity(v, 0.0, 0.0, coulomb, speed, dt) == pytest.approx(
            speed * np.arcsinh(left), abs=1e-6 * speed
        )
    creep = 1e-4 * np.arctanh(0.5)
    assert friction_velocity(creep, 0.05, 0.0, 0.1, 1e-4, 10.0) == pytest.approx(creep, rel=1e-9)
    assert friction_velocity(3.0, 0.05, 0.0, 0.1, 1e-4, 1e4) == pytest.approx(creep, rel=1e-6)


def test_a_joint_slides_as_a_stiff_solver_says() -> None:
    rng = np.random.default_rng(4)
    for _ in range(20):
        speed, dt = 10.0 ** rng.uniform(-4, 0), 10.0 ** rng.uniform(-3, 0)
        v, g = rng.normal(0.0, 20.0 * speed), rng.normal(0.0, 3.0)
        viscous, coulomb = 10.0 ** rng.uniform(-2, 3), abs(rng.normal(0.0, 2.0))

        def rate(
            t: Any,
            s: Any,
            g: Any = g,
            viscous: Any = viscous,
            coulomb: Any = coulomb,
            speed: Any = speed,
        ) -> Any:
            return g / speed - viscous * s - coulomb / speed * np.tanh(s)

        exact = solve_ivp(rate, (0.0, dt), [v / speed], "Radau", rtol=1e-9, atol=1e-9).y[0, -1]
        found = friction_velocity(v, g, viscous, coulomb, speed, dt)
        assert found == pytest.approx(exact * speed, rel=1e-6, abs=1e-5 * speed)


def test_the_friction_of_many_coupled_joints_is_in_balance() -> None:
    rng = np.random.default_rng(6)
    for _ in range(20):
        half = rng.normal(size=(4, 4))
        mobility = half @ half.T + 0.01 * np.eye(4)
        free, v = rng.normal(size=4), rng.normal(size=4)
        law, dt = np.array([np.full(4, 0.3), np.full(4, 0.5)]), 0.05
        r = balanced(np.zeros(4), free, mobility, v, law, 1e-3, dt)
        for i, a in enumerate(np.diag(mobility)):
            g = free[i] + mobility[i] @ r - a * r[i]
            after = friction_velocity(v[i], g, a * 0.3, a * 0.5, 1e-3, dt)
            assert after == pytest.approx(v[i] + dt * (g + a * r[i]), abs=1e-7)


@pytest.mark.parametrize(("period", "end"), [(0.001, 2.0), (0.01, 20.0), (0.1, 20.0)])
def test_dry_friction_holds_half_of_its_force(period: float, end: float) -> None:
    ticks, start = round(end / period), np.zeros(4)
    states = flown(OSCILLATOR, start, period, ticks, lambda t: 0.05, coulomb_friction=0.1)
    rate = 1e-4 * np.arctanh(0.5)  # where F tanh(v / v_c) = 0.05 N: 1.1 mm in 20 s
    assert states[-1, 0] == pytest.approx(rate * end, rel=0.01)
    assert abs(states[ticks // 10 :, 2] - rate).max() < 0.01 * rate  # and it does not chatter


@pytest.mark.parametrize(
    ("model", "start", "effort", "friction"),
    [
        (
            OSCILLATOR,
            [0.0, 0.5, 1.0, -1.0],
            lambda t: 0.2 * np.cos(t),
            {"viscous_friction": 0.7, "coulomb_friction": 0.3, "coulomb_speed": 0.2},
        ),
        (
            CSA,
            [0.0, 0.3, 0.1, 0.0, 0.3, -0.2, 0.1, 0.0],
            lambda t: np.array([30.0 * np.cos(t), 10.0]),
            {"viscous_friction": 1000.0, "coulomb_friction": 100.0, "coulomb_speed": 0.05},
        ),
    ],
)
def test_the_error_falls_with_the_square_of_the_period(
    model: Any, start: Any, effort: Any, friction: Any
) -> None:
    hold, end = 0.4, 2.0  # the effort is held, so that every period flies the same
    n, m = model.coordinates, model.joints

    def held(time: Any) -> Any:
        return effort(np.floor(time / hold + 1e-9) * hold)

    def smooth(t: Any, x: Any, u: Any) -> Any:
        v = x[n : n + m]
        c, f, speed = friction.values()
        return model.derivative(x, u - c * v - f * np.tanh(v / speed))

    x = np.array(start)
    for k in range(round(end / hold)):
        u = np.broadcast_to(held(k * hold), m).astype(float)
        x = solve_ivp(smooth, (0.0, hold), x, "DOP853", args=(u,), rtol=1e-12, atol=1e-13).y[:, -1]
    errors = [
        abs(flown(model, start, p, round(end / p), held, **friction)[-1] - x).max()
        for p in (0.04, 0.02, 0.01)
    ]
    assert errors[-1] < 1e-4
    np.testing.assert_allclose([errors[0] / errors[1], errors[1] / errors[2]], 4.0, atol=0.1)


def campaign() -> Iterator[Any]:
    rng = np.random.default_rng(8)
    for number in range(24):
        model = (OSCILLATOR, CSA)[number % 2]
        inertia = (1.0, 5000.0)[number % 2]
        n = model.coordinates
        yield pytest.param(
            model,
            np.concatenate((rng.normal(0.0, 0.3, n), rng.normal(0.0, 0.3, n))),
            10.0 ** rng.uniform(-3.0, -1.0),
            {
                "viscous_friction": inertia * 10.0 ** rng.uniform(-2.0, 8.0) * (number % 3 != 0),
                "coulomb_friction": inertia * 10.0 ** rng.uniform(-2.0, 3.0) * (number % 3 != 1),
                "coulomb_speed": 10.0 ** rng.uniform(-7.0, -1.0),
            },
            id=f"case {number}",
        )


@pytest.mark.parametrize(("model", "start", "period", "friction"), list(campaign()))
def test_no_period_and_no_friction_ever_gives_energy(
    model: Any, start: Any, period: Any, friction: Any
) -> None:
    states = flown(model, start, period, 150, **friction)
    energies = np.array([model.energy(x) for x in states])
    assert np.diff(energies).max() <= 1e-12 * energies[0]
    m, n = model.joints, model.coordinates
    later = abs(states[1:, n : n + m]).max()
    assert later <= abs(start[n:]).max() + np.sqrt(2.0 * energies[0])


def test_what_rests_stays_at_rest() -> None:
    states = flown(CSA, np.zeros(8), 0.01, 20, coulomb_friction=3.0, viscous_friction=2.0)
    np.testing.assert_array_equal(states, 0.0)


@pytest.mark.parametrize("key", ["viscous_friction", "coulomb_friction"])
def test_friction_is_refused_where_actuators_are_no_motors_in_joints(key: str) -> None:
    trial = load_trial(trial_path("scole_s_open"))
    actuator = validated(ActuatorSettings, {key: 0.1}, "here")
    with pytest.raises(BadInput, match=r"friction are not allowed here: .* give 0\.0"):
        Bench(bench_settings(replace(trial, actuator=actuator)))
