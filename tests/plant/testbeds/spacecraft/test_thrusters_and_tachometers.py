"""Thrusters push one way, at a lever; tachometers read wheels; both in any number."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.present import present

from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.errors import BadInput
from flexslew_plant.hardware.actuator import Actuator, ActuatorSettings
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.instruments import TachometerSettings
from flexslew_plant.testbeds.spacecraft.testbed import SpacecraftTestbed

BOX = {"mass": 50.0, "inertia": {"xx": 10.0, "yy": 14.0, "zz": 18.0}}


def craft(rng: np.random.Generator, wheels: int = 0, thrusters: int = 1) -> SpacecraftTestbed:
    """Return a rigid craft whose origin is not its centre of mass, drives along any axes."""
    axes = rng.standard_normal((wheels, 3))
    platform = {**BOX, "centre": rng.uniform(-0.2, 0.2, 3).tolist()}
    found = read_testbed(
        {
            "kind": "spacecraft", "platform": platform, "appendages": {},
            "wheels": {
                f"wheel_{k}": {"axis": a.tolist(), "inertia": 0.02, "limit": 1.0}
                for k, a in enumerate(axes / np.linalg.norm(axes, axis=1)[:, None])
            },
            "actuators": {
                f"jet_{k}": {
                    "kind": "thruster", "place": rng.uniform(-1.0, 1.0, 3).tolist(),
                    "direction": rng.standard_normal(3).tolist(), "limit": 2.0,
                }
                for k in range(thrusters)
            },
        },
        "here",
    )  # fmt: skip
    assert isinstance(found, SpacecraftTestbed)
    return found


@pytest.mark.parametrize("seed", range(5))
def test_a_thruster_changes_both_momenta_as_a_force_at_its_place_does(seed: int) -> None:
    rng = np.random.default_rng(seed)
    bench = craft(rng)
    settings = bench.actuators["jet_0"]
    model = bench.model()
    x = np.concatenate((model.rest({}), np.zeros(6)))
    push = np.array(settings.direction) / np.linalg.norm(settings.direction)
    centre = np.array(bench.platform.centre)
    about = np.diag([10.0, 14.0, 18.0]) - 50.0 * (
        centre @ centre * np.eye(3) - np.outer(centre, centre)
    )
    after = model.advance(x, np.array([1.5]), 1e-4)
    spin = after[10:13] / 1e-4
    torque = np.cross(np.array(settings.place) - centre, 1.5 * push)
    np.testing.assert_allclose(about @ spin, torque, rtol=1e-6, atol=1e-9)
    velocity = after[7:10] / 1e-4 + np.cross(spin, centre)
    np.testing.assert_allclose(50.0 * velocity, 1.5 * push, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(bench.drive_map().torque[:, 0] * 1.5, torque, atol=1e-12)


def test_its_negative_efforts_are_nothing_and_saturate() -> None:
    motors = Actuator(ActuatorSettings(), np.array([2.0, 2.0]), 0.1, None, (1,))
    assert motors.apply(np.array([-1.0, -1.0])).tolist() == [-1.0, 0.0]
    assert motors.saturated
    assert motors.apply(np.array([-3.0, 3.0])).tolist() == [-2.0, 2.0]
    assert motors.apply(np.array([-1.0, 1.0])).tolist() == [-1.0, 1.0]
    assert not motors.saturated
    bench = craft(np.random.default_rng(0))
    assert bench.model().one_way == (0,)
    own = Bench(BenchSettings(testbed=bench, active="a"))
    assert own.actuator.apply(np.array([-1.0])).tolist() == [0.0]


@pytest.mark.parametrize(("wheels", "thrusters"), [(4, 0), (6, 0), (0, 8), (4, 12), (3, 1)])
def test_a_rest_reads_the_positions_that_it_was_made_of(wheels: int, thrusters: int) -> None:
    rng = np.random.default_rng(wheels + 7 * thrusters)
    model = craft(rng, wheels, thrusters).model()
    assert model.attitude is not None
    for _ in range(20):
        turn = Rotation.random(random_state=rng)
        positions = dict(
            zip(model.joint_names, model.attitude.axes @ turn.as_rotvec(), strict=True)
        )
        q = model.rest(positions)
        assert (Rotation.from_quat(q[3:7]).inv() * turn).magnitude() < 1e-12
        x = np.concatenate((q, np.zeros(model.coordinates)))
        np.testing.assert_allclose(model.joint_state(x)[0], list(positions.values()), atol=1e-12)


def test_a_tachometer_reads_the_speed_of_every_wheel() -> None:
    rng = np.random.default_rng(4)
    tachometer = TachometerSettings(kind="tachometer")
    model = replace(craft(rng, 5, 0), sensors={"tacho": tachometer}).model()
    names = model.appendages.names
    assert names == tuple(f"tacho_wheel_{k}" for k in range(5))
    x = np.concatenate((model.rest({}), np.zeros(model.coordinates)))
    for _ in range(10):
        x = model.advance(x, rng.uniform(-1.0, 1.0, 5), 0.1)
    (instrument,) = model.appendages.instruments
    body = present(model.appendages.body)(x)
    np.testing.assert_array_equal(instrument.exact(body), model.split(x)[1][6:11])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"sensors": {"t": {"kind": "tachometer"}}}, r"sensors.t: the platform has no wheels"),
        ({"actuators": {"jet": {"kind": "thruster", "direction": [1.0, 0.0, 0.0], "limit": 1.0,
                                "appendage": "boom"}}}, r"jet.appendage.*on the platform"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_in_a_line(changes: dict[str, object], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        read_testbed({"kind": "spacecraft", "platform": BOX, "appendages": {}, **changes}, "here")
