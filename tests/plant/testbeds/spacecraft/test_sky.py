"""Where axes of a platform look, against rotations by another library."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.contract import HasSky, Sky
from flexslew_plant.testbeds.spacecraft.sky import MAIN

CONE: dict[str, Any] = {"direction": [0.2, 0.8, 0.3], "half_angle": 0.4}


def sky(**values: Any) -> Sky:
    testbed = read_testbed({"kind": "spacecraft", **values}, "here")
    assert isinstance(testbed, HasSky)
    found = testbed.sky()
    assert found is not None
    return found


@pytest.mark.parametrize("seed", range(8))
def test_a_margin_is_the_angle_to_the_cone_s_edge_in_any_frame(seed: int) -> None:
    rng = np.random.default_rng(seed)
    boresight, direction = rng.standard_normal((2, 3))
    half = float(rng.uniform(0.01, 3.0))
    turned = Rotation.random(50, random_state=seed)
    keys = {"boresight": boresight.tolist(), "direction": direction.tolist(), "half_angle": half}
    [cone] = sky(keep_out={"sun": keys}).cones
    look = turned.apply(boresight / np.linalg.norm(boresight))
    expected = np.arccos(look @ direction / np.linalg.norm(direction)) - half
    np.testing.assert_allclose(cone.margin(turned.as_quat()), expected, atol=1e-7)
    frame = Rotation.random(random_state=seed + 100)
    keys["direction"] = frame.apply(direction).tolist()
    [other] = sky(keep_out={"sun": keys}).cones
    np.testing.assert_allclose(other.margin((frame * turned).as_quat()), expected, atol=1e-7)


def test_a_look_along_the_axis_itself_has_no_rounding_to_fear() -> None:
    [cone] = sky(keep_out={"sun": {"direction": [0, 0, 5], "half_angle": 0.1}}).cones
    small = np.array([[1e-9, 0.0, 0.0, 1.0]])  # half of 2e-9 rad
    assert cone.margin(small)[0] == pytest.approx(2e-9 - 0.1, abs=1e-15)


def test_instruments_look_along_their_boresights_and_the_orbit_says_where_the_sun_is() -> None:
    found = sky(
        orbit={"altitude": 5e5, "sun": [0.0, 3.0, 0.0]},
        sensors={
            "tracker": {"kind": "star_tracker", "boresight": [0.0, 2.0, 0.0]},
            "dial": {"kind": "sun_sensor"},
            "gyro": {"kind": "gyro"},
        },
        keep_out={
            "sun": {"half_angle": 0.3, "boresight": [0.0, 1.0, 0.0]},
            "earth": {**CONE, "boresight": [1.0, 1.0, 0.0]},
        },
    )
    assert list(found.boresights) == [MAIN, "tracker", "dial", "boresight of earth"]
    np.testing.assert_allclose(found.cones[0].axis, [0.0, 1.0, 0.0])


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"keep_out": {"sun": {"half_angle": 0.3}}}, r"keep_out\.sun\.direction: is required"),
        ({"keep_out": {"sun": {**CONE, "direction": [0, 0, 0]}}}, r"keep_out\.sun\.direction"),
        ({"keep_out": {"sun": {**CONE, "boresight": [0, 0, 0]}}}, r"keep_out\.sun\.boresight"),
        ({"keep_out": {"sun": {**CONE, "half_angle": 3.2}}}, "half_angle"),
        ({"keep_out": {"sun": {**CONE, "half_angle": 0.0}}}, "half_angle"),
        ({"keep_out": {"sun": CONE}, "platform": {"motion": "pivot"}}, "motion: free"),
    ],
)
def test_what_is_no_cone_is_refused_by_its_key(values: Any, words: str) -> None:
    if values.get("platform"):
        values = {**values, "actuators": {"roll": {"kind": "torque", "direction": [1, 0, 0],
                                                   "limit": 1.0}}}  # fmt: skip
    with pytest.raises(BadInput, match=words) as refused:
        sky(**values)
    assert "\n" not in str(refused.value)
