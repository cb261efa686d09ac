"""What a linear law sees of a free spacecraft is what its efforts and sensors see of it."""

from typing import Any

import numpy as np
import pytest

from flexslew_control.law import Reference
from flexslew_control.linear.free_platform import (
    LinearModel,
    joints_first,
    nominal,
    nominal_states,
)
from flexslew_lab.reproduce.scole_flights import example_trial
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.csa import CsaTestbed

WHEELS = {"axis": [0.0, 0.0, 1.0], "inertia": 0.02, "limit": 0.5}


def response(linear: Any, readings: Any, s: complex) -> Any:
    """Return C (M s^2 + D s + K)^-1 B."""
    dynamic = linear.mass * s**2 + linear.damping * s + linear.stiffness
    return readings @ np.linalg.solve(dynamic, linear.input_matrix.astype(complex))


@pytest.mark.parametrize("name", ["scole_s_a", "scole_full", "own_spacecraft"])
def test_a_law_sees_the_response_of_the_whole_spacecraft(name: str) -> None:
    model = example_trial(name).testbed.model()
    rest = model.rest({})
    found = joints_first(model, rest)
    assert isinstance(found, LinearModel)
    assert found.coordinates <= model.coordinates
    whole = model.linearise(rest)
    rows = [model.joint_state(np.concatenate((rest, v)))[1] for v in np.eye(model.coordinates)]
    first = np.eye(found.joints, found.coordinates)
    for s in (0.3j, 2.0j, 0.7 + 9.0j):
        expected = response(whole, np.array(rows).T, s)
        np.testing.assert_allclose(
            response(found.linear, first, s), expected, atol=1e-6 * abs(expected).max()
        )


def test_a_turned_platform_is_not_pulled_back() -> None:
    model = example_trial("scole_s_a").testbed.model()
    found = joints_first(model, model.rest({}))
    away = found.rest({"roll": 0.5, "y": 2.0, "yaw": -0.3})
    force = found.linearise(away).stiffness @ away
    assert abs(force).max() < 1e-9 * abs(found.linearise(away).stiffness).max()


def test_a_path_is_one_hold_after_the_other() -> None:
    spacecraft = example_trial("scole_s_a").testbed.model()
    model = joints_first(spacecraft, spacecraft.rest({}))
    rng = np.random.default_rng(3)
    x, efforts = rng.normal(size=2 * model.coordinates), rng.normal(size=(4, model.joints))
    for held, after in zip(efforts, model.path(x, efforts, 0.05), strict=True):
        x = model.advance(x, held, 0.05)
        np.testing.assert_array_equal(after, x)


@pytest.mark.parametrize("modes", [1, 3])
@pytest.mark.parametrize("free", [True, False])
def test_nominal_states_of_many_references_are_those_of_each(modes: int, free: bool) -> None:
    csa = CsaTestbed(modes=modes).model()
    linear = csa.linearise(csa.rest({}))
    own = linear.mass[2:, 2:]
    model = LinearModel(csa.joint_names, linear, csa.appendages, own) if free else csa
    rng = np.random.default_rng(modes)
    references = [
        Reference(rng.normal(size=2), rng.normal(size=2), rng.normal(size=2), rng.normal(size=n))
        for n in (6, 0, 6, 10, 8, 0)
    ]
    found = nominal_states(model, references)
    np.testing.assert_array_equal(found, [nominal(model, one) for one in references])


def test_joints_that_move_together_are_refused() -> None:
    testbed = read_testbed(
        {
            "kind": "spacecraft",
            "actuators": {},
            "wheels": {"one": WHEELS, "two": WHEELS},
            "appendages": {
                "boom": {
                    "shape": {
                        "kind": "beam",
                        "length": 2.0,
                        "linear_density": 0.5,
                        "bending_stiffness": 9.0,
                    }
                }
            },
        },
        "here",
    )
    model = testbed.model()
    with pytest.raises(BadInput, match=r"does not move independently .* take pd_feedforward"):
        joints_first(model, model.rest({}))
