"""What is read of an attitude grows without a jump, however far it turns."""

import numpy as np
import pytest
from tests.plant.testbeds.spacecraft.crafts import random_axes

from flexslew_plant.testbeds import read_testbed


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


@pytest.mark.parametrize("degrees", [179.9, 180.0, 180.1, -179.9])
def test_rest_at_any_angle_is_read_as_it_was_given(degrees: float) -> None:
    own = read_testbed({"kind": "spacecraft"}, "here").model()
    q = own.rest({"yaw": np.radians(degrees)})
    position, _ = own.joint_state(np.concatenate((q, np.zeros(own.coordinates))))
    np.testing.assert_allclose(position, [0.0, 0.0, np.radians(degrees)], atol=1e-12)
