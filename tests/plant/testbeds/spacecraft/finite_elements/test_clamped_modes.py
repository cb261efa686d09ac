"""Modes that CalculiX computed are those of its matrices, with the masses of its elements."""

from pathlib import Path

import numpy as np
import pytest
from tests.plant.testbeds.spacecraft.finite_elements.decks import (
    block,
    computed,
    deck,
    with_modes,
)
from tests.plant.testbeds.spacecraft.finite_elements.mode_files import (
    BENDING,
    LUMPS,
    PLACES,
    SQUARES,
    rod_files,
)
from tests.plant.testbeds.spacecraft.finite_elements.test_calculix import ANGLE

from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.spacecraft.finite_elements.imported import (
    ImportOptions,
    import_model,
)

BODIES = {
    "cantilever": deck(block(32, 1, 1), (0.0625, 0.02, 0.03)),
    "plate": deck(block(32, 6, 1), (0.05, 0.15, 0.01), element="C3D20R"),
    "angle": deck(ANGLE, (0.1, 0.1, 0.02)),
}


@pytest.mark.parametrize("name", BODIES)
def test_modes_of_the_program_are_those_of_its_matrices(tmp_path: Path, name: str) -> None:
    folders = tmp_path / "m", tmp_path / "k"
    for folder in folders:
        folder.mkdir()
    modes = import_model(
        computed(folders[0], with_modes(BODIES[name], 6)).with_suffix(".frd"), ImportOptions((), 6)
    )
    matrices = import_model(computed(folders[1], BODIES[name]), ImportOptions(("ROOT",), 6))
    np.testing.assert_allclose(
        modes.content["frequencies_hz"], matrices.content["frequencies_hz"], rtol=1e-4
    )
    np.testing.assert_allclose(
        modes.reduction.rigid, matrices.reduction.rigid, rtol=1e-5, atol=1e-5
    )
    np.testing.assert_allclose(modes.reduction.origin, matrices.reduction.origin, atol=1e-6)
    np.testing.assert_allclose(
        modes.reduction.effective_mass, matrices.reduction.effective_mass, atol=5e-4
    )


def test_hand_written_files_give_the_sums_of_their_masses(tmp_path: Path) -> None:
    found = import_model(rod_files(tmp_path), ImportOptions((), 2))
    rigid = found.content["rigid"]
    assert rigid["mass"] == pytest.approx(4.0)
    np.testing.assert_allclose(found.reduction.origin, PLACES[0])
    np.testing.assert_allclose(rigid["first_moment"], [4.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(rigid["inertia"], np.diag([0.0, 6.0, 6.0]), atol=1e-6)
    np.testing.assert_allclose(
        found.content["frequencies_hz"], np.sqrt(SQUARES) / (2.0 * np.pi), rtol=1e-6
    )
    np.testing.assert_allclose(found.content["translation"][2], LUMPS[1:] @ BENDING, rtol=1e-6)
    torque = -(LUMPS[1:] * PLACES[1:, 0]) @ BENDING  # about y
    np.testing.assert_allclose(found.content["rotation"][1], torque, rtol=1e-6)


def test_units_and_another_hinge_move_the_same_structure(tmp_path: Path) -> None:
    path = rod_files(tmp_path)
    own, other = (
        import_model(path, ImportOptions((), 2, units, origin))
        for units, origin in (("si", (0.0, 0.0, 0.0)), ("mm_t_s", (0.0, 0.0, 0.0)))
    )
    scale = np.array([1.0] * 3 + [1e-3] * 3)
    np.testing.assert_allclose(
        other.reduction.rigid, 1e3 * np.outer(scale, scale) * own.reduction.rigid, atol=1e-9
    )
    np.testing.assert_allclose(
        other.reduction.participation,
        np.sqrt(1e3) * scale[:, None] * own.reduction.participation,
        atol=1e-9,
    )
    np.testing.assert_allclose(other.reduction.shapes * np.sqrt(1e3), own.reduction.shapes)
    inertia = np.trace(moments := np.einsum("i,ij,ik->jk", LUMPS, PLACES, PLACES)) * np.eye(3)
    np.testing.assert_allclose(own.content["rigid"]["inertia"], inertia - moments, atol=1e-6)


@pytest.mark.parametrize(
    ("ending", "old", "new", "words"),
    [
        (".frd", "    2C", "    9C", "has 0 nodes"),
        (".frd", f"{1:38d}", f"{2:38d}", "is binary: write it as text"),
        (".frd", " 1.00000E+00 0.0", " 1.0000xE+00 0.0", "damaged at line 4"),
        (".frd", " -4  DISP", " -4  FORC", "NODE FILE with U"),
        (".frd", " -2         2         3", " -2         2         9", "node without a place"),
        (".frd", " -1         2   11", " -1         7   11", "element 7 has no mass in the .dat"),
        (".frd", "  100CL  101 ", "  100CL  101 9", "two runs"),
        (".dat", "P A R T I C I", "P A R T", "the step must be \\*FREQUENCY"),
        (".dat", "total mass for", "whole mass for", "holds no masses of the structure: add"),
        (".dat", "  4.000000E+00", "  4.000000E+01", "its elements weigh 4, those of the .dat 40"),
        (".dat", "  4.000000E+00", "  nan", "1 finite numbers belong there"),
        (".dat", "  4.000000E+00", "  4.0 4.0", "1 finite numbers belong there"),
    ],
)
def test_a_damaged_file_is_refused_in_one_line(
    tmp_path: Path, ending: str, old: str, new: str, words: str
) -> None:
    path = rod_files(tmp_path)
    file = path.with_suffix(ending)
    content = file.read_text()
    assert old in content
    file.write_text(content.replace(old, new))
    with pytest.raises(BadInput, match=words) as error:
        import_model(path, ImportOptions((), 2))
    assert "\n" not in str(error.value)


def test_options_that_do_not_fit_computed_modes_are_refused(tmp_path: Path) -> None:
    path = rod_files(tmp_path)
    with pytest.raises(BadInput, match="boundary: '1' is not allowed: the modes of this file"):
        import_model(path, ImportOptions(("1",), 2))
    assert "the file has 2 modes, 8 are requested" in import_model(path, ImportOptions()).doubts
    path.with_suffix(".dat").unlink()
    with pytest.raises(BadInput, match=r"model\.dat: cannot be read"):
        import_model(path, ImportOptions())


def test_masses_of_two_sets_are_refused(tmp_path: Path) -> None:
    path = rod_files(tmp_path)
    file = path.with_suffix(".dat")
    file.write_text(file.read_text().replace("total mass for set EALL", "total mass for set A", 1))
    with pytest.raises(BadInput, match="has masses of the sets A, EALL; print one set"):
        import_model(path, ImportOptions((), 2))
