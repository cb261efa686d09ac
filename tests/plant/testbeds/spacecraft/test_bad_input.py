"""What no spacecraft can be is refused in one line with the numbers."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.spacecraft.shapes.modal_file import modal_shape

BOOM: dict[str, Any] = {
    "shape": {"kind": "beam", "length": 2.0, "linear_density": 0.5, "bending_stiffness": 9.0}
}


def craft(**changes: Any) -> dict[str, Any]:
    return {"kind": "spacecraft", "appendages": {"boom": BOOM}, **changes}


TORQUE = {"kind": "torque", "direction": [1.0, 0.0, 0.0], "limit": 1.0}


def hinged(**hinge: Any) -> dict[str, Any]:
    return {"appendages": {"boom": {**BOOM, "hinge": hinge}}}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"platform": {"mass": -1.0}}, "mass -1 kg is not positive"),
        (
            {"platform": {"mass": 1.0, "inertia": {"xx": 1.0, "yy": 1.0, "zz": 3.0}}},
            "1 \\+ 1 < 3",
        ),
        (
            hinged(axes=[[1, 0, 0], [0, 1, 0], [0, 0.1, 1]]),
            "not orthonormal",
        ),
        (
            {"appendages": {"boom": {"shape": {**BOOM["shape"], "across": [0.0, 0.1, 1.0]}}}},
            "cosine is",
        ),
        (
            {"wheels": {"spin": {"axis": [1, 0, 0], "inertia": 60.0, "limit": 1.0}}},
            "not positive definite",
        ),
        (
            {"actuators": {"a": {**TORQUE, "appendage": "sail"}}},
            "sail is no appendage; allowed: boom",
        ),
        ({"appendages": {"boom": {**BOOM, "only_modes": [9]}}}, "9 is not allowed: 1 to 4"),
        (
            {
                "appendages": {
                    "boom": {
                        **BOOM,
                        "hinge": {
                            "motion": [
                                {"to": 1.0, "duration": 3.0},
                                {"to": 0.0, "duration": 1.0, "at": 2.0},
                            ]
                        },
                    }
                }
            },
            "before the last one ends at 3 s",
        ),
        (
            hinged(range=[-1, 1], motion={"to": 2.0, "duration": 3.0}),
            "outside of the range -1 to 1 rad",
        ),
    ],
)
def test_impossible_spacecraft_are_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(BadInput, match=words) as error:
        read_testbed(craft(**changes), "here")
    assert "\n" not in str(error.value)


def panel() -> dict[str, Any]:
    return {
        "frequencies_hz": [0.6, 2.7],
        "rigid": {
            "mass": 2.0,
            "first_moment": [3.0, 0.0, 0.0],
            "inertia": [[0, 0, 0], [0, 5.0, 0], [0, 0, 5.0]],
        },
        "points": [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]],
        "masses": [1.0, 1.0],
        "shapes": [[[0, 0, 0.4], [0, 0, 1.0]], [[0, 0, 1.0], [0, 0, -0.4]]],
    }


def test_a_modal_file_gives_its_masses_and_frequencies(tmp_path: Path) -> None:
    path = tmp_path / "panel.yaml"
    path.write_text(yaml.safe_dump(panel()))
    found = modal_shape(path)
    np.testing.assert_allclose(found.frequencies, 2.0 * np.pi * np.array([0.6, 2.7]))
    np.testing.assert_allclose(found.mass, [1.16, 1.16])
    np.savez(tmp_path / "panel.npz", **{k: v for k, v in panel().items() if k != "rigid"})
    other = modal_shape(tmp_path / "panel.npz")
    np.testing.assert_allclose(other.integrals.rotation, found.integrals.rotation)
    rows = ["# frequencies_hz: [0.6, 2.7]", "x,y,z,mass,1x,1y,1z,2x,2y,2z"]
    rows += ["1,0,0,1,0,0,0.4,0,0,1", "2,0,0,1,0,0,1,0,0,-0.4"]
    (tmp_path / "panel.csv").write_text("\n".join(rows))
    third = modal_shape(tmp_path / "panel.csv")
    np.testing.assert_allclose(third.integrals.translation, found.integrals.translation)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"shapes": [[[0, 0, 1.0]], [[0, 0, 1.0]]]},
            "has shape \\(2, 1, 3\\); it must be 2 x 2 x 3",
        ),
        ({"shapes": [[[0, 0, 1], [0, 0, 1]], [[0, 0, 1], [0, 0, 0]]]}, "not orthogonal in mass"),
        ({"masses": [1.0, -1.0]}, "-1 is not positive"),
        ({"frequencies_hz": [0.6, 0.0]}, "0 is not positive"),
        ({"modal_mass": [[1.0, 0.2], [0.0, 1.0]]}, "not symmetric"),
        ({"masses": [14.5939, 14.5939]}, "in slug"),
        ({"points": [[1000.0, 0, 0], [2000.0, 0, 0]]}, "in mm"),
        ({"colour": 1}, "unknown key"),
    ],
)
def test_wrong_modal_files_are_refused_with_the_numbers(
    tmp_path: Path, changes: dict[str, Any], words: str
) -> None:
    path = tmp_path / "panel.yaml"
    path.write_text(yaml.safe_dump({**panel(), **changes}))
    with pytest.raises(BadInput, match=words):
        modal_shape(path)
