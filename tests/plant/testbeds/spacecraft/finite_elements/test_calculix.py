"""Models that CalculiX computed: closed forms, and the whole model on a floating platform."""

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.sparse.linalg import eigsh
from tests.plant.testbeds.spacecraft.finite_elements.decks import (
    block,
    computed,
    deck,
    truss_files,
)
from tests.plant.testbeds.spacecraft.finite_elements.frames import Array
from tests.plant.testbeds.spacecraft.finite_elements.platforms import (
    craft,
    free_frequencies,
    platform_matrix,
)

from flexslew_plant.arrays import Indices
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.spacecraft.finite_elements.imported import (
    ImportedModel,
    ImportOptions,
    import_model,
)
from flexslew_plant.testbeds.spacecraft.finite_elements.readers import calculix

ANGLE = [*block(8, 1, 1), *((7, j, 0) for j in range(1, 6))]
BODIES = {
    "cantilever": deck(block(32, 1, 1), (0.0625, 0.02, 0.02)),
    "angle": deck(ANGLE, (0.1, 0.1, 0.02)),
    "plate": deck(block(8, 8, 1), (0.15, 0.15, 0.01), element="C3D20R"),
}
HUB = {"mass": 60.0, "centre": [0.1, -0.05, 0.2],
       "inertia": {"xx": 12.0, "yy": 15.0, "zz": 20.0, "xy": 0.5}}  # fmt: skip
CANTILEVER = np.array([1.8751040687119611, 4.694091132974175, 7.854757438237613])


def test_a_cantilever_of_solids_has_the_frequencies_of_a_beam(tmp_path: Path) -> None:
    """L/h = 100: shear and the sections' own inertia lower the third by 0.1 %."""
    path = computed(tmp_path, deck(block(32, 1, 1), (0.0625, 0.02, 0.02), poisson=0.0))
    found = import_model(path, ImportOptions(("ROOT",), 6)).content["frequencies_hz"]
    exact = CANTILEVER**2 / 4.0 * np.sqrt(70e9 * 0.02**2 / 12.0 / 2700.0) / (2.0 * np.pi)
    np.testing.assert_allclose(found, np.repeat(exact, 2), rtol=5e-3)


def test_a_square_plate_has_the_published_frequencies(tmp_path: Path) -> None:
    """A. W. Leissa, Vibration of plates, NASA SP-160, 1969, table 4.46: clamped at one side."""
    found = import_model(computed(tmp_path, BODIES["plate"]), ImportOptions(("x=0",), 4))
    rigidity = 70e9 * 0.01**3 / 12.0 / (1.0 - 0.3**2)
    factors = np.array(found.content["frequencies_hz"]) * 2.0 * np.pi * 1.2**2
    factors *= np.sqrt(2700.0 * 0.01 / rigidity)
    np.testing.assert_allclose(factors[:3], [3.4917, 8.5246, 21.429], rtol=0.015)


def on_platform(found: ImportedModel, root: Indices) -> Array:
    """Return what the whole model swings with on the platform, its root tied to it [Hz]."""
    assert found.model.node is not None
    tied = np.isin(found.model.node, root)
    rigid = found.model.rigid_vectors(found.reduction.origin)
    basis = np.zeros((found.model.size, 6 + int((~tied).sum())))
    basis[tied, :6] = rigid[tied]
    basis[np.flatnonzero(~tied), np.arange(6, basis.shape[1])] = 1.0
    mass = basis.T @ (found.model.mass @ basis)
    mass[:6, :6] += platform_matrix(HUB)
    stiffness = basis.T @ (found.model.stiffness @ basis)
    if len(mass) < 800:
        squares = eigh(stiffness, mass, eigvals_only=True, subset_by_index=[0, 20])
    else:
        squares = np.sort(eigsh(stiffness, 21, M=mass, sigma=-1.0, return_eigenvectors=False))
    swings: Array = np.sqrt(squares[6:]) / (2.0 * np.pi)
    return swings


@pytest.mark.parametrize("name", BODIES)
def test_an_imported_body_floats_as_the_whole_model_does(tmp_path: Path, name: str) -> None:
    """Within 0.1 % up to half of the highest mode that is kept."""
    path = computed(tmp_path, BODIES[name])
    found = import_model(path, ImportOptions(("ROOT",), 10))
    shape = {"kind": "finite_elements", "file": str(path), "boundary": ["ROOT"], "modes": 10}
    swings, exact = (
        free_frequencies(craft(shape, HUB)),
        on_platform(found, found.model.sets["ROOT"]),
    )
    highest = found.content["frequencies_hz"][-1]
    count = int((exact < 0.5 * highest).sum())
    assert count >= 3
    np.testing.assert_allclose(swings[:count], exact[:count], rtol=1e-3)


def test_beam_elements_are_refused_with_the_remedy(tmp_path: Path) -> None:
    text = "*NODE, NSET=NALL\n1, 0\n2, .5\n3, 1.\n*ELEMENT, TYPE=B32, ELSET=EALL\n1, 1, 2, 3\n"
    text += "*MATERIAL, NAME=M\n*ELASTIC\n7e10, .3\n*DENSITY\n2700\n"
    text += "*BEAM SECTION, ELSET=EALL, MATERIAL=M, SECTION=RECT\n.02, .04\n0, 0, 1\n"
    text += "*STEP\n*FREQUENCY, SOLVER=MATRIXSTORAGE\n1\n*END STEP\n"
    path = computed(tmp_path, text)
    with pytest.raises(BadInput, match="use solid elements"):
        import_model(path, ImportOptions(("1",)))


def test_stored_matrices_are_read_without_the_program(tmp_path: Path) -> None:
    found = import_model(truss_files(tmp_path), ImportOptions(("root",), 6))
    rigid = found.content["rigid"]
    assert rigid["mass"] == pytest.approx(10.0)
    np.testing.assert_allclose(found.reduction.origin, [0.0, 1.0 / 3.0, 1.0 / 3.0])
    np.testing.assert_allclose(
        rigid["first_moment"], [9.0, 2.0 * (1.5 - 5.0 / 3.0), 2.0 * (1.4 - 5.0 / 3.0)]
    )
    free = np.arange(9, 15)
    squares = np.linalg.eigvalsh(found.model.stiffness.toarray()[np.ix_(free, free)]) / 2.0
    np.testing.assert_allclose(found.content["frequencies_hz"], np.sqrt(squares) / (2.0 * np.pi))


@pytest.mark.parametrize(
    ("ending", "content", "words"),
    [
        (".dof", "1.1\n1.1\n", "a direction twice"),
        (".dof", "1.1\n1.4\n", "directions must be 1 to 3"),
        (".dof", "1.1\n9.1\n", "dof: 9 is not allowed: a node without a place"),
        (".dof", "1;1\n", "node.direction in each line"),
        (".sti", "1 1\n", "row, column and value"),
        (".sti", "", "row, column and value"),
        (".sti", "1 1 2\n99 1 2\n", "whole numbers from 1 to 15"),
        (".sti", "1 2 3\n2 1 3\n", "one triangle"),
        (".sti", "1 1 3\n1 1 3\n", "there twice"),
        (".mas", "1 1 3\n", "M: what the boundary does not clamp has no mass"),
        (".inp", "*NODE\n1, a\n", "line 2: cannot be read as \\*NODE"),
        (".inp", "*TRANSFORM, NSET=ROOT\n", "line 1: \\*TRANSFORM is not read"),
        (".inp", "*NSET, NSET=A\n1\n", "has no \\*NODE"),
        (".inp", "*NODE\n1, 0\n*NSET, NSET=A, GENERATE\n1, 9, 0\n", "line 4: cannot be read"),
    ],
)
def test_a_damaged_file_is_refused_with_its_name(
    tmp_path: Path, ending: str, content: str, words: str
) -> None:
    path = truss_files(tmp_path)
    path.with_suffix(ending).write_text(content)
    with pytest.raises(BadInput, match=words) as error:
        import_model(path, ImportOptions(("ROOT",), 3))
    assert "\n" not in str(error.value)


def test_a_missing_file_of_the_four_is_named(tmp_path: Path) -> None:
    path = truss_files(tmp_path)
    path.with_suffix(".mas").unlink()
    with pytest.raises(BadInput, match=r"model\.mas: cannot be read: No such file"):
        import_model(path, ImportOptions(("ROOT",), 3))


def test_sets_are_generated_and_named_in_others(tmp_path: Path) -> None:
    path = truss_files(tmp_path)
    text = path.read_text() + "*NSET, NSET=ODD, GENERATE\n1, 1000000000, 2\n*NSET, NSET=B\nODD, 2\n"
    path.write_text(text)
    sets = import_model(path, ImportOptions(("root",), 3)).model.sets
    assert sets["ODD"].tolist() == [0, 2, 4]
    assert sets["B"].tolist() == [0, 1, 2, 4]


def test_sets_that_take_for_ever_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calculix, "_MOST_WORK", 20_000)
    path = truss_files(tmp_path)
    nodes = "".join(f"{n}, 0\n" for n in range(6, 1000))
    many = "1, 999\n" * 30
    path.write_text(f"*NODE\n{nodes}*NSET, NSET=A, GENERATE\n{many}")
    with pytest.raises(BadInput, match="its node sets are too many"):
        import_model(path, ImportOptions(("ROOT",), 3))
