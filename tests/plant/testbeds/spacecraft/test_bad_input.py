"""What no spacecraft can be is refused in one line with the numbers."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from flexslew_lab.trial.sources import example_trials
from flexslew_lab.trial.trial import load_trial
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.contract import HasDoubts
from flexslew_plant.testbeds.spacecraft.shapes.modal_file import modal_shape

BOOM: dict[str, Any] = {
    "shape": {"kind": "beam", "length": 2.0, "linear_density": 0.5, "bending_stiffness": 9.0}
}


def craft(**changes: Any) -> dict[str, Any]:
    return {"kind": "spacecraft", "appendages": {"boom": BOOM}, **changes}


TORQUE = {"kind": "torque", "direction": [1.0, 0.0, 0.0], "limit": 1.0}
WHEEL = {"axis": [1, 0, 0], "limit": 1.0}


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
        ({"platform": {"mass": 0.0}}, "mass 0 kg is not positive"),
        ({"platform": {"inertia": {"xx": 5.0, "yy": 5.0, "zz": -1.0}}}, "triangle inequality"),
        (
            {"platform": {"mass": 10.0, "centre": [3.0, 0.0, 0.0], "inertia": {"yy": 1.0}}},
            "about the centre of mass violate the triangle inequality",
        ),
        (
            {"appendages": {"boom": {"shape": {**BOOM["shape"], "tip_body": {"mass": -2.0}}}}},
            "tip_body: mass -2 kg is not positive",
        ),
        (hinged(axes=[[1, 0, 0], [0, 1, 0], [0, 0, -1]]), "left-handed"),
        (hinged(axis=[0, 0, 0]), "has no direction"),
        ({"appendages": {"boom": {}}}, "has neither shape nor body"),
        (
            {"appendages": {"boom": {**BOOM, "damping": {"ratio": [0.1, 0.1]}}}},
            "2 numbers for 4 modes",
        ),
        ({"actuators": {}}, "has no actuators"),
        ({"actuators": {"a": {**TORQUE, "direction": [0, 0, 0]}}}, "has no direction"),
        (
            {"actuators": {"spin": TORQUE}, "wheels": {"spin": {**WHEEL, "inertia": 0.1}}},
            "two actuators are called spin",
        ),
        ({"appendages": {"boom": {"shape": {**BOOM["shape"], "modes": 200}}}}, "modes"),
    ],
)
def test_impossible_spacecraft_are_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(BadInput, match=words) as error:
        read_testbed(craft(**changes), "here")
    assert "\n" not in str(error.value)


FACTORS = {"translation": [[0.0, 0.0]] * 2 + [[1.3, 0.6]], "rotation": [[0.0, 0.0]] * 3}


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


def test_a_plate_is_drawn_as_the_line_through_its_middle() -> None:
    own = modal_shape(Path("solar_panel.yaml"))
    assert (own.line[0] == 0.0).all()
    assert (np.diff(own.line[:, 0]) > 0.0).all()
    np.testing.assert_allclose(own.line[:, 1:], 0.0, atol=1e-12)
    assert own.line_shape.shape == (len(own.line), 3, own.modes)


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
        ({"units": "cgs"}, "'cgs' is not allowed: si, slug_ft_lb"),
        ({"frequencies_hz": "fast"}, "is not an array of numbers"),
        ({"damping_ratios": [0.1, 1.2]}, "are not all in 0 to 1"),
        ({"modal_mass": [1.0, -1.0]}, "not positive definite"),
        ({"modal_mass": [2.0, 1.16]}, "mode 1 has 2, its points sum to 1.16"),
        ({"tip": 7}, "7 is not allowed: a whole number from 0 to 1"),
        ({"points": [[1.0, 0, 0], [float("nan"), 0, 0]]}, "not finite"),
        ({"rigid": {"mass": 2.0}}, "first_moment: missing"),
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
        ({"translation": [[0.0, 0.0]] * 3}, "rotation: missing"),
        ({**FACTORS, "masses": [2.0, 2.0]}, r"rigid\.mass: 2 is given, the points weigh 4"),
    ],
)
def test_wrong_modal_files_are_refused_with_the_numbers(
    tmp_path: Path, changes: dict[str, Any], words: str
) -> None:
    path = tmp_path / "panel.yaml"
    path.write_text(yaml.safe_dump({**panel(), **changes}))
    with pytest.raises(BadInput, match=words) as error:
        modal_shape(path)
    assert "\n" not in str(error.value)
    assert str(path) in str(error.value)


def test_factors_count_in_first_order_and_points_in_second(tmp_path: Path) -> None:
    path = tmp_path / "panel.yaml"
    path.write_text(yaml.safe_dump(panel()))
    points = modal_shape(path)
    path.write_text(yaml.safe_dump({**panel(), **FACTORS, "modal_mass": [1.1, 1.2]}))
    both = modal_shape(path)
    np.testing.assert_array_equal(both.integrals.translation, FACTORS["translation"])
    np.testing.assert_array_equal(both.integrals.rotation, FACTORS["rotation"])
    np.testing.assert_array_equal(both.mass, [1.1, 1.2])
    np.testing.assert_array_equal(both.integrals.second_1, points.integrals.second_1)
    np.testing.assert_array_equal(both.tip.place, points.tip.place)


def test_an_appendage_that_moves_more_mass_than_it_has_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "light.yaml"
    participation = {"translation": [[0.0], [0.0], [4.0]], "rotation": [[0.0], [-6.0], [0.0]]}
    kept = {"frequencies_hz": [0.6], "rigid": panel()["rigid"], **participation}
    path.write_text(yaml.safe_dump(kept))
    sail = {"shape": {"kind": "modal_data", "file": str(path)}}
    with pytest.raises(BadInput, match=r"appendages.sail: .* not positive definite: lowest") as e:
        read_testbed(craft(appendages={"sail": sail}, platform={"mass": 3.0}), "here")
    assert "\n" not in str(e.value)


def test_modes_that_move_more_than_the_mass_of_a_light_appendage_are_reported(
    tmp_path: Path,
) -> None:
    """Masses in tonnes on a platform that is heavy enough: nothing else contradicts them."""
    rows = {"frequencies_hz": [0.0434470], "rotation": [[0.0], [0.0], [0.0]]}
    inertia = np.diag([100.0, 100.0, 100.0]).tolist()
    rigid = {"mass": 10.0, "first_moment": [0.0, 0.0, 0.0], "inertia": inertia}

    def doubts(y: float, mass: float) -> tuple[str, ...]:
        values = {**rows, "translation": [[-3.26], [y], [5.27]], "rigid": rigid | {"mass": mass}}
        path = tmp_path / f"array_of_{mass:g}_kg.yaml"
        path.write_text(yaml.safe_dump(values))
        wing = {"shape": {"kind": "modal_data", "file": str(path)}}
        bench = read_testbed(craft(appendages={"wing": wing}, platform={"mass": 1e5}), "here")
        assert isinstance(bench, HasDoubts)
        return bench.doubts()

    (words,) = doubts(-74.14, 10.0)
    assert "appendage wing: the effective mass of its modes along y is 5,496.74 kg" in words
    assert "its mass is 10 kg" in words
    assert doubts(-74.14, 5500.0) == doubts(1.0, 30.0) == ()


def test_shipped_spacecraft_raise_no_doubts() -> None:
    for shipped in example_trials():
        bench = load_trial(shipped.path).testbed
        assert not isinstance(bench, HasDoubts) or not bench.doubts(), shipped.name
