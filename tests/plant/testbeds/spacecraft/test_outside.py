"""Forces of orbits and wheels as machine code, and what they do to a craft, in plain NumPy."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.spacecraft.testbed import SpacecraftTestbed

GRAVITY, RADIUS, FIELD, SUNLIGHT = 3.986004418e14, 6.371e6, 3.12e-5, 4.56e-6
FOOT = {"si": 1.0, "slug_ft_lb": 0.3048}  # lengths in the units of the section [m]
POUND = {"si": 1.0, "slug_ft_lb": 4.4482216152605}  # forces [N]


def three(rng: np.random.Generator, size: float = 1.0) -> list[float]:
    x, y, z = (size * rng.standard_normal(3)).tolist()
    return [x, y, z]


def an_orbit(rng: np.random.Generator) -> dict[str, Any]:
    """Return an orbit of which each part is there three times of four."""
    parts: tuple[dict[str, Any], ...] = (
        {"dipole": three(rng)},
        {"drag_area": 3.0, "air_density": 1e-11, "drag_centre": three(rng)},
        {"solar_area": 8.0, "solar_centre": three(rng)},
        {"sun": three(rng)},
        {"gravity_gradient": False},
    )
    found: dict[str, Any] = {"altitude": rng.uniform(2e5, 4e7), "inclination": rng.uniform(-3, 3)}
    found["phase"] = rng.uniform(-3.0, 3.0)
    for part in parts:
        if rng.random() < 0.75:
            found |= part
    return found


def a_wheel(rng: np.random.Generator) -> dict[str, Any]:
    """Return a wheel with up to four harmonics, perhaps none."""
    wheel: dict[str, Any] = {"axis": three(rng), "inertia": 0.05, "limit": 1.0, "place": three(rng)}
    for key in ("static_imbalance", "dynamic_imbalance"):
        if rng.random() < 0.5:
            wheel[key] = rng.uniform(1e-6, 1e-3)
    keys = ("order", "force", "force_phase", "torque", "torque_phase")
    lines = rng.uniform(0.3, 6.0, (rng.integers(0, 3), 5))
    wheel["harmonics"] = [dict(zip(keys, line.tolist(), strict=True)) for line in lines]
    return wheel


def a_craft(rng: np.random.Generator) -> dict[str, Any]:
    """Return a craft with a boom on a driven hinge, whose joint stands before the wheels'."""
    beam = {"kind": "beam", "length": 6.0, "linear_density": 0.4, "bending_stiffness": 300.0}
    return {
        "kind": "spacecraft",
        "units": str(rng.choice(list(FOOT))),
        "platform": {
            "mass": 150.0,
            "centre": three(rng, 0.03),
            "inertia": {"xx": 40.0, "yy": 35.0, "zz": 30.0, "xy": 1.0, "yz": -2.0},
        },
        "appendages": {
            "boom": {
                "hinge": {"kind": "driven", "place": [0.0, 0.5, 0.1]},
                "shape": beam | {"modes": 2},
            }
        },
        "wheels": {name: a_wheel(rng) for name in "abc"[: rng.integers(1, 4)]},
        "orbit": an_orbit(rng) if rng.random() < 0.8 else None,
    }


def test_forces_and_pushes_are_those_of_a_plain_derivation() -> None:
    rng, seen = np.random.default_rng(41), 0
    for _ in range(60):
        testbed: Any = read_testbed(a_craft(rng), "here")
        model = testbed.model()
        x = rng.standard_normal(model.positions + model.coordinates)
        x[3:7] /= np.linalg.norm(x[3:7])
        x[model.positions - model.modes : model.positions] *= 0.01  # deflections are small
        first = model.positions + 7  # speeds of the wheels, behind the hinge's
        x[first : first + len(testbed.wheels)] *= 80.0
        t, span = rng.uniform(0.0, 3e4), float(rng.choice([0.0, *rng.uniform(-0.3, 0.3, 3)]))
        parts = np.array([*on_orbit(testbed, x, t), *of_wheels(testbed, x, span)])
        assert (model.outside is None) == (not parts.size)
        if model.outside is None:
            assert model.apply_impulse(x, span, t) is x
            continue
        seen += 1
        expected = np.zeros(model.coordinates)
        expected[:6] = parts.sum(axis=0)
        largest = np.abs(parts).max()  # of what may cancel
        np.testing.assert_allclose(model.outside(x, t, span), expected, 0.0, 1e-12 * largest)
        mass = model.mass_matrix(x[: model.positions], t)
        change = np.concatenate((np.zeros(model.positions), np.linalg.solve(mass, expected)))
        change *= abs(span)
        most = 1e-12 * np.abs(change).max()
        np.testing.assert_allclose(model.apply_impulse(x, span, t), x + change, 1e-12, most)
    assert seen > 40


def on_orbit(testbed: SpacecraftTestbed, x: Vector, t: float) -> list[Vector]:
    """Return force and torque of each part of the orbit, (6,) each."""
    o = testbed.orbit
    if o is None:
        return []
    model = testbed.model()
    q = x[: model.positions].copy()
    q[model.positions - model.modes :] = 0.0  # undeformed, hinges as they stand
    whole = model.mass_matrix(q, t)
    mass, first = whole[0, 0], whole[[5, 3, 4], [1, 2, 0]]
    at = first / mass
    inertia = whole[3:6, 3:6] - mass * (at @ at * np.eye(3) - np.outer(at, at))
    distance = RADIUS + o.altitude
    rate = np.sqrt(GRAVITY / distance**3)
    plane = Rotation.from_rotvec([o.inclination, 0.0, 0.0])
    angle = o.phase + rate * t
    place = plane.apply([np.cos(angle), np.sin(angle), 0.0])
    velocity = rate * distance * plane.apply([-np.sin(angle), np.cos(angle), 0.0])
    body = Rotation.from_quat(x[3:7]).inv().apply
    south = np.array([0.0, 0.0, -1.0])
    field = FIELD * (RADIUS / distance) ** 3 * (3.0 * (south @ place) * place - south)
    air = -0.5 * o.air_density * o.drag_area * np.linalg.norm(velocity) * velocity
    light = -SUNLIGHT * o.solar_area * np.array(o.sun) / np.linalg.norm(o.sun)
    torques = [
        np.cross(o.dipole, body(field)),
        np.cross(o.drag_centre, body(air)),
        np.cross(o.solar_centre, body(light)),
    ]
    if o.gravity_gradient:
        torques.append(3.0 * rate**2 * np.cross(body(place), inertia @ body(place)))
    return [np.concatenate((np.zeros(3), torque)) for torque in torques]


def of_wheels(testbed: SpacecraftTestbed, x: Vector, span: float) -> list[Vector]:
    """Return force and torque of each harmonic of each wheel, (6,) each."""
    found = []
    length, force = FOOT[testbed.units], POUND[testbed.units]
    for k, wheel in enumerate(testbed.wheels.values()):
        angle, speed = x[8 + k], x[testbed.craft.sizes[0] + 7 + k]
        plane, place = across(np.array(wheel.axis)), length * np.array(wheel.place)
        lines = [
            (h.order, h.force, h.force_phase, h.torque, h.torque_phase) for h in wheel.harmonics
        ]
        lines.append((1.0, wheel.static_imbalance, 0.0, wheel.dynamic_imbalance, 0.0))
        for order, push, push_phase, turn, turn_phase in lines:
            step = 1j * order * speed * span
            mean = np.expm1(step) / step if step else 1.0  # of e^(i order speed s) over the span
            to = speed**2 * np.exp(1j * order * angle) * mean
            pushed = force * push * turned(plane, to * np.exp(1j * push_phase))
            other = force * length * turn * turned(plane, to * np.exp(1j * turn_phase))
            if push or turn:
                found.append(np.concatenate((pushed, np.cross(place, pushed) + other)))
    return found


def turned(plane: Matrix, amount: complex) -> Vector:
    found: Vector = amount.real * plane[0] + amount.imag * plane[1]
    return found


def across(axis: Vector) -> Matrix:
    """Return the x axis without its part along an axis (or y, see Harmonic), and what follows."""
    axis = axis / np.linalg.norm(axis)
    along = np.eye(3)[int(abs(axis[0]) >= np.sqrt(0.5))]
    first = np.cross(axis, np.cross(along, axis))
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(axis, first)])


@pytest.mark.parametrize("size", [20, 22])
def test_a_state_that_does_not_fit_is_not_pushed(size: int) -> None:
    wheel = {"axis": [0.0, 0.0, 1.0], "inertia": 0.05, "limit": 1.0, "static_imbalance": 1e-4}
    given = a_craft(np.random.default_rng(0)) | {"wheels": {"one": wheel}}
    model = read_testbed(given, "here").model()
    assert model.apply_impulse(np.ones(21), 0.1, 0.0).shape == (21,)
    with pytest.raises(ValueError, match="does not fit"):
        model.apply_impulse(np.ones(size), 0.1, 0.0)
