"""Friction of reaction wheels and hinge motors, by closed forms, a stiff solver and energy."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flexslew_control.analysis.rest import linear_matrices, rest_of
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.errors import BadInput
from flexslew_plant.hardware.actuator import ActuatorSettings
from flexslew_plant.hardware.friction import Friction
from flexslew_plant.settings import validated
from flexslew_plant.testbeds import Testbed, read_testbed
from flexslew_plant.testbeds.model import Model

WHEEL = {"axis": [0.0, 0.0, 1.0], "inertia": 0.1, "limit": 1.0}
BEAM = {
    "shape": {
        "kind": "beam",
        "length": 2.0,
        "linear_density": 0.5,
        "bending_stiffness": 100.0,
        "along": [0.0, 1.0, 0.0],
        "modes": 2,
    }
}


def craft(motion: str = "free", boom: Any = BEAM, spring: float = 0.0) -> Testbed:
    """Return a platform with a wheel and, on a driven hinge, a boom."""
    hinge = {"kind": "driven", "axis": [1.0, 0.0, 0.0], "place": [0.0, 0.5, 0.0], "spring": spring}
    values: dict[str, Any] = {
        "kind": "spacecraft",
        "platform": {"motion": motion, "mass": 100.0},
        "wheels": {"wheel": WHEEL},
        "appendages": {"boom": {**boom, "hinge": hinge}} if boom else {},
        "actuators": {},
    }
    values["platform"]["inertia"] = {"xx": 5.0, "yy": 6.0, "zz": 2.0}
    return read_testbed(values, "test")


def flown(
    model: Model,
    x: Vector,
    period: float,
    ticks: int,
    effort: Callable[[float], Vector],
    **own: Any,
) -> Matrix:
    """Return the states at the ticks, shape (ticks + 1, size of x)."""
    friction = Friction(model.resolved_motors, validated(ActuatorSettings, own, "test"), period)
    states = [x]
    for k in range(ticks):
        now, u = states[-1], effort(k * period)

        def step(total: Vector, now: Vector = now) -> Vector:
            return model.advance(now, total, period)

        states.append(friction.advance(now, u, model.mobility(now, u), step))
    return np.array(states)


def spinning(model: Model, speed: float) -> Vector:
    """Return the state at rest but for the wheel."""
    x = np.concatenate((model.rest({}), np.zeros(model.coordinates)))
    x[model.resolved_motors.rate[list(model.resolved_motors.names).index("wheel")]] = speed
    return x


@pytest.mark.parametrize("speed", [30.0, -30.0])
@pytest.mark.parametrize("motion", ["held", "free"])
def test_a_wheel_spins_down_as_the_closed_form_says(motion: str, speed: float) -> None:
    model = craft(motion, boom=None).model()
    # J w' = -c w - F sign(w), on a free platform with J Iz / (J + Iz) less the share of Iz
    inertia = 0.1 if motion == "held" else 0.1 * (1.0 - 0.1 / 2.0)
    c, dry, period, ticks = 0.01, 0.05, 0.05, 600
    own = {"viscous_friction": c, "coulomb_friction": dry}
    x = spinning(model, speed)
    states = flown(model, x, period, ticks, lambda t: np.zeros(1), **own)
    t = period * np.arange(ticks + 1)
    sliding = (30.0 + dry / c) * np.exp(-c * t / inertia) - dry / c
    stop = inertia / c * np.log1p(c * 30.0 / dry)
    assert 0.5 * t[-1] < stop < t[-1]
    rate = states[:, model.resolved_motors.rate[0]] * np.sign(speed)
    np.testing.assert_allclose(rate, np.maximum(sliding, 0.0), atol=2e-4)  # it sticks: v_c = 1e-4
    assert abs(rate[t > stop + period]).max() < 1e-9
    if motion == "free":  # the wheel's momentum is in the platform then
        momentum = [model.momentum(x)[5] for x in states]
        np.testing.assert_allclose(momentum, 0.1 * speed, rtol=1e-9)
        assert states[-1, model.positions + 5] == pytest.approx(0.05 * speed, rel=1e-6)


def test_a_craft_turns_by_a_wheel_with_friction_as_the_closed_form_says_over_1000_s() -> None:
    """W' = -(u + c W) / (J (1 - J / I)) of the wheel's speed, w = -J W / I of the platform."""
    model = craft(boom=None).model()
    c, u, period, ticks = 0.001, 5e-5, 0.5, 2000
    own = {"viscous_friction": c}
    x = flown(model, spinning(model, 0.0), period, ticks, lambda t: np.array([u]), **own)[-1]
    t, pace = period * ticks, c / (0.1 * (1.0 - 0.1 / 2.0))
    turn = 0.1 / 2.0 * u / c * (t + np.expm1(-pace * t) / pace)
    assert turn > 1.0
    assert 2.0 * np.arctan2(x[5], x[6]) == pytest.approx(turn, abs=1e-6)


def test_a_hinge_sticks_below_its_dry_friction_and_swings_to_the_next_stop_above() -> None:
    inertia = {"xx": 1.5, "yy": 0.5, "zz": 1.5}
    body = {"mass": 1.0, "centre": [0.0, 1.0, 0.0], "inertia": inertia}
    model = craft("held", {"body": body}, 40.0).model()
    motors = model.resolved_motors
    hinge = list(motors.names).index("boom_hinge")
    rest = np.concatenate((model.rest({"boom_hinge": 0.02}), np.zeros(model.coordinates)))
    own = {"coulomb_friction": {"boom_hinge": 1.0}}  # the spring pulls with .8 N m

    def angles(pull: float) -> Vector:
        u = np.zeros(len(motors.names))
        u[hinge] = pull
        states = flown(model, rest, 0.01, 100, lambda t: u, **own)
        return np.asarray(states[:, motors.position[hinge]])

    creep = 1e-4 * np.arctanh(0.8)  # rad in 1 s, where F tanh(v / v_c) = .8 N m
    assert abs(angles(0.0) - 0.02).max() <= 1.01 * creep
    # by -.4 N m: half a period of 40 q = 1 - .4 - 40 q about q = .015; -.8 N m do not move it then
    loose = angles(-0.4)
    assert loose[60] == pytest.approx(0.01, abs=2e-5)
    assert abs(loose[60:] - loose[60]).max() <= 1.01 * creep


def test_motors_that_turn_round_move_as_a_stiff_solver_says() -> None:
    model = craft("free", spring=3.0).model()
    names, chosen, _, rate, sign = model.resolved_motors
    c, dry, speed, hold, end = 0.03, 0.2, 0.1, 0.25, 2.5

    def effort(t: float) -> Vector:
        t = np.floor(t / hold + 1e-9) * hold
        wave = {"wheel": 0.6 * np.cos(3.0 * t), "boom_hinge": -np.cos(2.0 * t)}
        return np.array([wave[name] for name in names])

    def smooth(t: float, x: Vector, u: Vector) -> Vector:
        v = sign * x[rate]
        total = u.copy()
        total[chosen] -= c * v + dry * np.tanh(v / speed)
        return model.derivative(x, total, t)

    start = spinning(model, 1.0)
    x = start
    for k in range(round(end / hold)):
        u = effort(k * hold)
        x = solve_ivp(smooth, (0.0, hold), x, "DOP853", args=(u,), rtol=1e-11, atol=1e-12).y[:, -1]
    own = {"viscous_friction": c, "coulomb_friction": dry, "coulomb_speed": speed}
    errors = []
    for period in (0.0125, 0.00625):
        states = flown(model, start, period, round(end / period), effort, **own)
        turned = np.sign(states[:, rate])
        assert all((one > 0).any() and (one < 0).any() for one in turned.T)  # rates cross zero
        errors.append(abs(states[-1] - x).max())
    assert errors[-1] < 1e-3
    assert errors[-2] / errors[-1] == pytest.approx(4.0, abs=0.4)


@pytest.mark.parametrize("seed", range(6))
def test_friction_never_gives_energy(seed: int) -> None:
    rng = np.random.default_rng([28, seed])
    model = craft("free", spring=float(rng.uniform(0.0, 20.0))).model()
    x = np.concatenate((model.rest({}), rng.normal(0.0, 0.3, model.coordinates)))
    own = {
        "viscous_friction": 10.0 ** rng.uniform(-2.0, 4.0) * (seed % 3 != 0),
        "coulomb_friction": 10.0 ** rng.uniform(-2.0, 2.0) * (seed % 3 != 1),
        "coulomb_speed": 10.0 ** rng.uniform(-6.0, -1.0),
    }
    states = flown(model, x, 10.0 ** rng.uniform(-3.0, -1.5), 100, lambda t: np.zeros(2), **own)
    energies = np.array([model.energy(x) for x in states])
    assert np.diff(energies).max() <= 1e-9 * energies[0]
    assert energies[-1] < energies[0]


@pytest.mark.slow
def test_the_bench_rubs_its_wheels_and_names_what_is_no_motor() -> None:
    testbed = craft("held", boom=None)
    actuator = validated(ActuatorSettings, {"coulomb_friction": {"wheel": 0.2}}, "test")
    settings = BenchSettings(testbed=testbed, period=0.1, duration=1.0, actuator=actuator)
    bench = Bench(settings)
    for demand, speed in ((0.15, 0.0), (0.7, -5.0 * 0.1)):  # on the wheel -.5 N m, .1 s, .1 kg m^2
        bench.reset()
        after = bench._integrate(np.array([demand]))
        assert after[-1] == pytest.approx(speed, abs=2e-4)
    for key in ("viscous_friction", "coulomb_friction"):
        wrong = validated(ActuatorSettings, {key: {"pitch": 0.2}}, "test")
        with pytest.raises(BadInput, match=rf"{key}: .*names of motors: wheel") as refused:
            Bench(replace(settings, actuator=wrong))
        assert "pitch" in str(refused.value)


def test_small_motions_have_the_friction_of_motors_at_rest() -> None:
    testbed = craft("free", spring=3.0)
    rest = rest_of(testbed)
    model, actuator = rest.model, ActuatorSettings(viscous_friction=2.0)
    free, rubbed = linear_matrices(rest)[0], linear_matrices(rest, actuator)[0]
    n, h = model.coordinates, 1e-6
    for k, at in enumerate(model.resolved_motors.rate):
        x = rest.state
        x[at] = h
        u = np.zeros(model.efforts)
        u[model.resolved_motors.efforts[k]] = -2.0 * model.resolved_motors.sign[k] * h
        moved = model.derivative(x, u) - model.derivative(x, 0.0 * u)
        column = at - model.positions + n
        np.testing.assert_allclose(
            (rubbed - free)[n:, column], moved[model.positions :] / h, atol=1e-8
        )
