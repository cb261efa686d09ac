"""What is read of an attitude grows without a jump, however far it turns."""

from typing import Any

import numpy as np
import pytest
from tests.plant.testbeds.spacecraft.crafts import random_axes

from flexslew_plant.settings import plain
from flexslew_plant.testbeds import Model, initial_positions, initial_state, read_testbed


@pytest.mark.parametrize("seed", range(4))
def test_a_turn_through_half_a_turn_is_read_without_a_jump(seed: int) -> None:
    own = read_testbed({"kind": "spacecraft"}, "here").model()
    axis = random_axes(np.random.default_rng(seed))[0]
    read = []
    angles = np.linspace(0.0, 1.9 * np.pi, 400)
    for angle in angles:
        x = np.zeros(own.positions + own.coordinates)
        x[3:6], x[6] = np.sin(angle / 2.0) * axis, np.cos(angle / 2.0)
        read.append(own.joint_state(x)[0])
    turned = np.array(read)  # roll, pitch, yaw
    np.testing.assert_allclose(turned, angles[:, None] * axis, atol=1e-9)
    assert abs(np.diff(turned, axis=0)).max() < 0.02


def with_forces(platform: dict[str, Any]) -> Model:
    """Return a platform with two forces beside its origin, as a couple pushes, and a torque."""
    forces = {
        name: {"kind": "force", "direction": [0.0, 1.0, 0.0], "place": place, "limit": 5.0}
        for name, place in (("ahead", [1.0, 0.2, 0.4]), ("behind", [-0.8, 0.0, 0.3]))
    }
    roll = {"kind": "torque", "direction": [1.0, 0.0, 0.0], "limit": 5.0}
    craft = {"kind": "spacecraft", "platform": platform, "actuators": {**forces, "roll": roll}}
    return read_testbed(craft, "here").model()


PLATFORMS = [
    {},
    {"motion": "pivot", "axis": [0.0, 0.6, 0.8], "place": [0.3, -0.1, 0.2]},
    {"motion": "pivot", "axis": [1.0, 0.0, 0.0]},
]


@pytest.mark.parametrize("platform", PLATFORMS)
def test_what_a_force_beside_the_origin_reads_moves_as_its_rate_sensor_says(platform: Any) -> None:
    own = with_forces(platform)
    efforts = np.array([0.3, -0.2, 0.1])
    x = np.concatenate((own.rest({}), np.zeros(own.coordinates)))
    h, read = 1e-3, []
    for _ in range(40):  # turns by less than 1e-4 rad
        read.append(own.joint_state(x))
        x = own.advance(x, efforts, h)
    position, velocity = (np.array(part) for part in zip(*read, strict=True))
    moved = np.trapezoid(velocity, dx=h, axis=0)
    np.testing.assert_allclose(position[-1], moved, atol=1e-3 * abs(position[-1]).max())
    assert abs(position[-1][:2]).min() > 1e-8


@pytest.mark.parametrize("platform", PLATFORMS[:2])
def test_rest_of_forces_beside_the_origin_is_read_as_it_was_given(platform: Any) -> None:
    own = with_forces(platform)
    asked = {"ahead": 0.02} if platform else {"ahead": 0.02, "behind": -0.01, "roll": 0.03}
    read = own.joint_state(np.concatenate((own.rest(asked), np.zeros(own.coordinates))))[0]
    found = dict(zip(own.joint_names, read, strict=True))
    assert {name: found[name] for name in asked} == pytest.approx(asked, abs=2e-3)


def test_a_force_that_is_left_out_leaves_the_attitude_and_reads_what_that_makes_it_read() -> None:
    testbed: Any = read_testbed({"kind": "spacecraft"}, "here")
    actuators: Any = {**plain(testbed.actuators)}
    for name, x in (("left", 0.7), ("right", -0.7)):
        side = {"kind": "force", "direction": [0.0, 1.0, 0.0], "place": [x, 0.0, 0.0], "limit": 5.0}
        actuators[name] = side
    values = {"kind": "spacecraft", "actuators": actuators, "initial": {"yaw": 0.9}}
    own = read_testbed(values, "here")
    first, state = initial_positions(own), initial_state(own)
    read = own.model().joint_state(state)[0]
    np.testing.assert_allclose(read, list(first.values()), atol=1e-12)
    assert first["yaw"] == 0.9
    assert (first["left"], first["right"]) == pytest.approx((0.63, -0.63))


@pytest.mark.parametrize("degrees", [179.9, 180.0, 180.1, -179.9])
def test_rest_at_any_angle_is_read_as_it_was_given(degrees: float) -> None:
    own = read_testbed({"kind": "spacecraft"}, "here").model()
    q = own.rest({"yaw": np.radians(degrees)})
    position, _ = own.joint_state(np.concatenate((q, np.zeros(own.coordinates))))
    np.testing.assert_allclose(position, [0.0, 0.0, np.radians(degrees)], atol=1e-12)


def test_where_it_rests_is_ones_own_to_change() -> None:
    """It is asked for by every block of a run, and found once."""
    own = read_testbed({"kind": "spacecraft"}, "here").model()
    asked = {"yaw": 0.3}
    first = own.rest(asked)
    expected = first.copy()
    first[:] = 7.0
    asked["yaw"] = 0.4
    assert (own.rest({"yaw": 0.3}) == expected).all()
    assert (own.rest(asked) != expected).any()
