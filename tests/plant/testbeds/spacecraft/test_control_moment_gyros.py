"""Gyros exchange momentum with the craft, and lose none of it."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.present import present

from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import initial_state, read_testbed
from flexslew_plant.testbeds.spacecraft.testbed import SpacecraftTestbed

INERTIA = np.array([10.0, 14.0, 18.0])


def craft(seed: int, count: int = 4, **more: Any) -> SpacecraftTestbed:
    """Return a rigid craft about its centre of mass with gyros along any axes."""
    rng = np.random.default_rng(seed)
    frames = Rotation.random(count, random_state=rng).as_matrix()
    platform = {"inertia": dict(zip(("xx", "yy", "zz"), INERTIA.tolist(), strict=True))}
    values = {
        "kind": "spacecraft", "platform": platform, "appendages": {}, "actuators": {},
        "control_moment_gyros": {
            f"gyro_{k}": {"axis": f[0].tolist(), "rotor": f[1].tolist(),
                          "momentum": float(rng.uniform(0.5, 2.0))}
            for k, f in enumerate(frames)
        },
        **more,
    }  # fmt: skip
    found = read_testbed(values, "here")
    assert isinstance(found, SpacecraftTestbed)
    return found


def flown(bench: SpacecraftTestbed, seed: int, ticks: int = 300) -> list[Vector]:
    """Return the states under random efforts, from a rest whose rotors store something."""
    rng, model, x = np.random.default_rng(seed), bench.model(), initial_state(bench)
    states = [x]
    for _ in range(ticks):
        x = model.advance(x, rng.uniform(-1.0, 1.0, model.joints), 0.05)
        states.append(x)
    return states


@pytest.mark.parametrize("seed", range(5))
def test_no_effort_changes_the_momentum_of_craft_and_rotors(seed: int) -> None:
    bench = craft(seed, 3 + seed % 3)
    model = bench.model()

    def momentum(x: Vector) -> Vector:
        _, v = model.split(x)
        body = INERTIA * v[3:6] + bench.spins(v[None]).stored[0]
        return np.asarray(Rotation.from_quat(x[3:7]).apply(body))

    states = flown(bench, seed)
    angles = np.array([model.split(x)[1][6:] for x in states])
    assert abs(angles).max() > 0.5
    for x in states:
        np.testing.assert_allclose(momentum(x), momentum(states[0]), atol=1e-8)
    assert model.energy(states[0]) == 0.0  # without what the rotors' motors keep
    _, v = model.split(states[-1])
    assert model.energy(states[-1]) == pytest.approx(0.5 * v[3:6] @ (INERTIA * v[3:6]), rel=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_an_effort_turns_its_gimbal_back_and_the_craft_along_the_torque_as_it_stands(
    seed: int,
) -> None:
    bench = craft(seed)
    model, x = bench.model(), flown(bench, seed)[-1].copy()
    x[model.positions : model.positions + 6] = 0.0  # not turning: no gyroscopic torque
    gyros, angles = [*bench.control_moment_gyros.values()], model.split(x)[1][6:]
    for k, (gyro, angle) in enumerate(zip(gyros, angles, strict=True)):
        slope = model.derivative(x, 0.3 * np.eye(4)[k])[model.positions :]
        assert slope[6 + k] == pytest.approx(-0.3 / gyro.momentum, rel=1e-12)
        turned = Rotation.from_rotvec(angle * np.array(gyro.axis))
        along = turned.apply(np.cross(gyro.axis, gyro.rotor))
        np.testing.assert_allclose(INERTIA * slope[3:6], 0.3 * along, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_the_jacobian_knows_how_torques_turn_with_their_gimbals(seed: int) -> None:
    """Against central differences along v, whose error with steps of 1e-6 is that of rounding."""
    bench = craft(seed)
    model, x = bench.model(), flown(bench, seed)[-1]
    effort = np.random.default_rng(seed).uniform(-1.0, 1.0, 4)
    slopes, inputs = model.jacobian(x, effort)
    n, first = model.coordinates, model.positions
    for k in range(n):
        step = np.zeros(x.size)
        step[first + k] = 1e-6
        ahead, back = (model.derivative(x + s * step, effort)[first:] for s in (1.0, -1.0))
        np.testing.assert_allclose(slopes[n:, n + k], (ahead - back) / 2e-6, atol=1e-6)
    for k, one in enumerate(np.eye(4)):
        change = model.derivative(x, effort + one)[first:] - model.derivative(x, effort)[first:]
        np.testing.assert_allclose(inputs[n:, k], change, atol=1e-9)


def test_a_resolver_reads_every_gimbal() -> None:
    bench = craft(1, 5, sensors={"angle": {"kind": "resolver"}})
    model, x = bench.model(), flown(bench, 1, 20)[-1]
    assert model.appendages.names == tuple(f"angle_gyro_{k}" for k in range(5))
    (instrument,) = model.appendages.instruments
    body = present(model.appendages.body)(x)
    np.testing.assert_array_equal(instrument.exact(body), model.split(x)[1][6:])


GYRO = {"axis": [1.0, 0.0, 0.0], "rotor": [0.0, 1.0, 0.0], "momentum": 1.0}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"sensors": {"r": {"kind": "resolver"}}}, "sensors.r: the platform has no gimbals"),
        ({"control_moment_gyros": {"a": {**GYRO, "rotor": [0.1, 1.0, 0.0]}}}, "at right angles"),
        ({"control_moment_gyros": {"a": GYRO}, "platform": {"motion": "held"}}, "motion: free"),
        ({"control_moment_gyros": {"a": {**GYRO, "momentum": 0.0}}}, "momentum"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        read_testbed({"kind": "spacecraft", "appendages": {}, **changes}, "here")
