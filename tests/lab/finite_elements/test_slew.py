"""A slew with an imported model is that with the beam of the bench."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.plant.testbeds.spacecraft.finite_elements.decks import block, computed, deck
from tests.plant.testbeds.spacecraft.finite_elements.frames import BEAM, Section, arrays, saved

import flexslew as fs

RHO, EI = 1.08, 70e9 * 0.02**4 / 12.0  # of a bar of 20 mm x 20 mm of aluminium
SECTION = Section(axial=70e9 * 4e-4, twist=600.0, bend_y=EI, bend_z=EI, density=RHO, polar=7.2e-5)


def flown(shape: dict[str, Any]) -> fs.Flight:
    """Return a rotation by 0.5 rad about the yaw axis, which bends the arm along y."""
    platform = {"mass": 20.0, "inertia": dict.fromkeys(("xx", "yy", "zz"), 4.0)}
    torque = {"kind": "torque", "direction": [0, 0, 1], "limit": 20.0}
    arm = {"hinge": {"place": [0.2, 0.0, 0.0]}, "shape": shape, "damping": {"ratio": 0.005}}
    return fs.fly(
        {
            "duration": 4.0,
            "period": 0.005,
            "testbed": {"kind": "spacecraft", "platform": platform, "appendages": {"arm": arm},
                        "actuators": {"yaw": torque}},
            "plan": {"method": "reference_only", "goal": {"yaw": 0.5}, "duration": 2.0},
            "controllers": {"pd_feedforward": {"kp": [40.0], "kd": [30.0]}},
        }
    )  # fmt: skip


@pytest.fixture(scope="module")
def expected() -> fs.Flight:
    return flown({"kind": "beam", "length": 2.0, "linear_density": RHO, "bending_stiffness": EI,
                  "along": [1, 0, 0], "across": [0, 1, 0], "modes": 4})  # fmt: skip


def require_equal(found: fs.Flight, expected: fs.Flight) -> None:
    """Require joint and tip within 1 % of their largest values."""
    assert abs(expected["tip.arm_y"]).max() > 1e-3
    for name in ("position.yaw", "velocity.yaw", "tip.arm_y"):
        largest = abs(expected[name]).max()
        np.testing.assert_allclose(found[name], expected[name], atol=0.01 * largest)


def test_an_imported_frame_slews_as_the_beam_does(tmp_path: Path, expected: fs.Flight) -> None:
    path = saved(tmp_path, **arrays(BEAM, 20, SECTION))
    require_equal(flown({"kind": "finite_elements", "file": str(path), "modes": 4}), expected)


def test_a_bar_of_calculix_slews_as_the_beam_does(tmp_path: Path, expected: fs.Flight) -> None:
    path = computed(tmp_path, deck(block(32, 1, 1), (0.0625, 0.02, 0.02), poisson=0.0))
    shape = {"kind": "finite_elements", "file": str(path), "boundary": ["ROOT"], "modes": 4}
    require_equal(flown(shape), expected)
