"""Torques of an orbit: against other derivations, energies that stay, and motion over 1,000 s."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flexslew_plant.arrays import Vector
from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import EffortCommand
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.spacecraft.orbit import GRAVITY, RADIUS

INERTIA = np.array([10.0, 16.0, 20.0])  # [kg m^2]
PERIOD, LASTING = 1.0, 1000.0  # [s]
ALTITUDE = 500e3  # [m]
RATE = float(np.sqrt(GRAVITY / (RADIUS + ALTITUDE) ** 3))  # [rad/s]


def drifted(orbit: dict[str, Any], yaw: float = 0.0) -> Bench:
    """Return a bench on which a craft has drifted on an orbit, from rest at a turn about z."""
    testbed = read_testbed(
        {
            "kind": "spacecraft",
            "platform": {
                "mass": 50.0,
                "centre": [0.1, 0.0, 0.0],
                # about the body origin: that about the centre of mass, and 50 kg at 0.1 m
                "inertia": {"xx": INERTIA[0], "yy": INERTIA[1] + 0.5, "zz": INERTIA[2] + 0.5},
            },
            "appendages": {},
            "initial": {"yaw": yaw},
            "orbit": {"altitude": ALTITUDE, **orbit},
        },
        "here",
    )
    bench = Bench(BenchSettings(testbed=testbed, period=PERIOD, duration=LASTING + 1.0))
    for _ in range(round(LASTING / PERIOD)):
        asked = bench.question
        assert bench.offer(EffortCommand(asked.tick, asked.epoch, asked.controller, np.zeros(3)))
        bench.advance()
    return bench


def turned(bench: Bench, axis: int = 2) -> float:
    """Return the turn about z or another axis, after nothing else has moved [rad]."""
    *v, w = bench.truth().position[3:7]
    assert max(map(abs, np.delete(v, axis))) < 1e-12
    return float(2.0 * np.arctan2(v[axis], w))


def swung(acceleration: Any, start: float) -> float:
    """Return the angle of a pendulum after LASTING, from rest [rad]."""
    found = solve_ivp(
        lambda t, y: [y[1], acceleration(t, y[0])], (0.0, LASTING), [start, 0.0],
        rtol=1e-11, atol=1e-13,
    )  # fmt: skip
    return float(found.y[0, -1])


def test_the_gravity_gradient_turns_a_craft_as_the_equation_of_its_pitch_says() -> None:
    ratio = 1.5 * RATE**2 * (INERTIA[1] - INERTIA[0]) / INERTIA[2]
    expected = swung(lambda t, angle: ratio * np.sin(2.0 * (RATE * t - angle)), 0.3)
    found = turned(drifted({}, 0.3))
    assert found == pytest.approx(expected, abs=1e-6)
    assert abs(found - 0.3) > 0.02


def test_sunlight_swings_a_craft_as_a_pendulum() -> None:
    light = {"solar_area": 8.0, "solar_centre": [0.0, 1.5, 0.0], "gravity_gradient": False}
    push = 4.56e-6 * 8.0 * 1.5 / INERTIA[2]  # the Sun along x: c x (-P A s)
    expected = swung(lambda t, angle: push * np.cos(angle), 0.0)
    found = turned(drifted(light))
    assert found == pytest.approx(expected, abs=1e-6)
    assert abs(found) > 0.1


def test_air_swings_a_craft_about_its_course_as_a_pendulum() -> None:
    air = {"drag_area": 3.0, "air_density": 1e-12, "drag_centre": [0.0, 0.4, 0.0]}
    speed = RATE * (RADIUS + ALTITUDE)
    push = 0.5 * 1e-12 * speed**2 * 3.0 * 0.4 / INERTIA[2]
    expected = swung(lambda t, angle: push * np.sin(angle - RATE * t), 0.3)
    found = turned(drifted({**air, "gravity_gradient": False}, 0.3))
    assert found == pytest.approx(expected, abs=1e-6)
    assert abs(found - 0.3) > 0.04


def test_a_dipole_above_the_equator_swings_as_a_pendulum() -> None:
    field = 3.12e-5 * (RADIUS / (RADIUS + ALTITUDE)) ** 3  # along z, everywhere on this orbit
    push = 0.5 * field / INERTIA[0]  # 0.5 A m^2 along y: m x B is about x
    expected = swung(lambda t, angle: push * np.cos(angle), 0.0)
    found = turned(drifted({"dipole": [0.0, 0.5, 0.0], "gravity_gradient": False}), axis=0)
    assert found == pytest.approx(expected, abs=1e-6)
    assert abs(found) > 0.1


def boomed(**hinge: Any) -> Any:
    """Return a craft on an orbit with a heavy boom."""
    beam = {
        "kind": "beam", "length": 6.0, "linear_density": 2.0, "bending_stiffness": 3e3,
        "modes": 1, "along": [0.0, 1.0, 0.0], "across": [0.0, 0.0, 1.0],
    }  # fmt: skip
    joint = {"place": [0.0, 0.5, 0.1], "axis": [1.0, 0.0, 0.0], **hinge}
    values = {
        "kind": "spacecraft",
        "platform": {"mass": 150.0, "inertia": {"xx": 40.0, "yy": 35.0, "zz": 30.0}},
        "appendages": {"boom": {"hinge": joint, "shape": beam}},
        "orbit": {"altitude": ALTITUDE, "inclination": 0.4, "phase": 0.3},
    }
    return read_testbed(values, "here").model()


@pytest.mark.parametrize("angle", [-2.0, -0.4, 0.9, np.pi / 2])
def test_gravity_turns_a_craft_with_its_hinges_where_they_stand(angle: float) -> None:
    def torque(model: Any, hinges: list[float]) -> Vector:
        x = np.zeros(model.positions + model.coordinates)
        x[3:7], x[7 : 7 + len(hinges)] = np.array([0.1, 0.5, -0.5, 0.7]), hinges
        return np.asarray(model.outside(x, 100.0, 0.0)[3:6])

    built_so = torque(boomed(turned={"axis": [1.0, 0.0, 0.0], "angle": angle}), [])
    for model, hinges in (
        (boomed(kind="driven"), [angle]),
        (boomed(kind="passive"), [angle]),
        (boomed(motion={"to": angle, "duration": 5.0}), []),  # over since 95 s
    ):
        np.testing.assert_allclose(torque(model, hinges), built_so, rtol=1e-11)
    assert np.linalg.norm(built_so - torque(boomed(), [])) > 0.2 * np.linalg.norm(built_so)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"altitude": 1.7e308}, r"altitude: 1\.7e\+308 .* less than or equal to 10+$"),
        ({"sun": [0.0, 0.0, 0.0], "solar_area": 1.0}, r"orbit\.sun: .* has no direction"),
        ({"sun": [1e200, 0.0, 0.0], "solar_area": 1.0}, r"orbit\.sun: .* has no direction"),
    ],
)
def test_an_orbit_that_cannot_be_is_refused_by_its_key(keys: dict[str, Any], words: str) -> None:
    orbit = {"altitude": 5e5, **keys}
    with pytest.raises(BadInput, match=words):
        read_testbed({"kind": "spacecraft", "orbit": orbit}, "here")


def test_only_a_free_platform_has_an_orbit() -> None:
    held = {"kind": "spacecraft", "platform": {"motion": "pivot"}, "orbit": {"altitude": 5e5}}
    with pytest.raises(BadInput, match="orbit"):
        read_testbed(held, "here")
