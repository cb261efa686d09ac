"""What was found flies as the appendage of a spacecraft: its free modes are those of the bench."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.lab.identification.shaken import bench, shaken
from tests.representatives import representatives

from flexslew_lab.identification.modal.modes import identify_modes
from flexslew_lab.identification.model_file import appendage_file_text
from flexslew_lab.identification.model_file import testbed_of as found_testbed
from flexslew_plant.errors import BadInput

PLAN = {"band": [0.3, 6.0], "duration": 60.0, "resolution": 0.4, "taper": 1.0}
AXES = {"x": [1.0, 0.0, 0.0], "y": [0.0, 1.0, 0.0], "z": [0.0, 0.0, 1.0]}


def found(kind: str, **keys: Any) -> Any:
    gains = np.array([0.5]), np.array([1.0])
    made = shaken(bench(kind=kind, damping_ratio=0.02), PLAN | keys, gains,
                  np.random.default_rng(3), period=0.02)  # fmt: skip
    return identify_modes(made.record, (0.3, 6.0))


@pytest.mark.parametrize(
    ("kind", "joint", "axis"),
    representatives(
        [
            (*of, axis)
            for of in (("hub_with_appendages", "hub"), ("floating_oscillator", "mass"))
            for axis in AXES
        ],
        ("hub_with_appendages", "hub", "y"),
        ("floating_oscillator", "mass", "x"),
    ),
)
def test_a_spacecraft_with_the_appendage_has_the_modes_that_were_found(
    tmp_path: Path, kind: str, joint: str, axis: str
) -> None:
    model_found = found(kind, largest_excursion=[0.05])
    path = tmp_path / "appendage.yaml"
    path.write_text(appendage_file_text(model_found, {joint: axis}))
    testbed = found_testbed(model_found)
    whole, turns = testbed.inertia[0][0], testbed.joint_units == ("rad",)
    push = {"kind": "torque" if turns else "force", "limit": 1.0, "direction": AXES[axis]}

    def craft(size: float) -> Any:
        """Return the model on a platform of this mass or inertia, alike about all axes."""
        inertia = dict.fromkeys(("xx", "yy", "zz"), size if turns else 1.0)
        return bench(
            kind="spacecraft",
            platform={"mass": 1.0 if turns else size, "inertia": inertia},
            appendages={"a": {"shape": {"kind": "modal_data", "file": str(path)}}},
            actuators={"push": push},
        ).model()

    k = "xyz".index(axis) + 3 * turns
    heavy = craft(100.0)
    carried = heavy.linearise(heavy.rest({})).mass[k, k] - 100.0
    model = craft(whole - carried)  # of what was found, the rest is the platform's
    linear = model.linearise(model.rest({}))
    poles = linear.eigenvalues
    poles = np.sort(np.abs(poles[poles.imag > 1e-6]))
    expected = [mode.frequency.value for mode in model_found.modes]
    assert poles == pytest.approx(expected, rel=1e-5)  # the damping has a part beside the diagonal


def test_a_joint_without_an_axis_is_refused_with_the_joints() -> None:
    model_found = found("floating_oscillator", largest_excursion=[0.2])
    for axes in ({}, {"mass": "w"}, {"hub": "z"}):
        with pytest.raises(BadInput, match=r"--appendage: .* x, y or z of each of mass"):
            appendage_file_text(model_found, axes)
