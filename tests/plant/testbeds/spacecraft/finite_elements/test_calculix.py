"""Models that CalculiX computed: closed forms, and the whole model on a floating platform."""

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.sparse.linalg import eigsh
from tests.plant.testbeds.spacecraft.finite_elements.decks import block, computed, deck
from tests.plant.testbeds.spacecraft.finite_elements.frames import Array
from tests.plant.testbeds.spacecraft.finite_elements.platforms import (
    craft,
    free_frequencies,
    platform_matrix,
)

from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.spacecraft.finite_elements.imported import (
    ImportedModel,
    ImportOptions,
    import_model,
)

ANGLE = [*block(8, 1, 1), *((7, j, 0) for j in range(1, 6))]
BODIES = {
    "cantilever": (block(32, 1, 1), (0.0625, 0.02, 0.02)),
    "angle": (ANGLE, (0.1, 0.1, 0.02)),
    "plate": (block(8, 8, 1), (0.15, 0.15, 0.01), 70e9, 0.3, "C3D20R"),
}
HUB = {"mass": 60.0, "centre": [0.1, -0.05, 0.2],
       "inertia": {"xx": 12.0, "yy": 15.0, "zz": 20.0, "xy": 0.5}}  # fmt: skip
CANTILEVER = np.array([1.8751040687119611, 4.694091132974175, 7.854757438237613])


def test_a_cantilever_of_solids_has_the_frequencies_of_a_beam(tmp_path: Path) -> None:
    """L/h = 100: shear and the sections' own inertia lower the third by 0.1 %."""
    path = computed(tmp_path, deck(*BODIES["cantilever"], poisson=0.0))
    found = import_model(path, ImportOptions(("ROOT",), 6)).content["frequencies_hz"]
    exact = CANTILEVER**2 / 4.0 * np.sqrt(70e9 * 0.02**2 / 12.0 / 2700.0) / (2.0 * np.pi)
    np.testing.assert_allclose(found, np.repeat(exact, 2), rtol=5e-3)


def test_a_square_plate_has_the_published_frequencies(tmp_path: Path) -> None:
    """A. W. Leissa, Vibration of plates, NASA SP-160, 1969, table 4.46: clamped at one side."""
    found = import_model(computed(tmp_path, deck(*BODIES["plate"])), ImportOptions(("x=0",), 4))
    rigidity = 70e9 * 0.01**3 / 12.0 / (1.0 - 0.3**2)
    factors = np.array(found.content["frequencies_hz"]) * 2.0 * np.pi * 1.2**2
    factors *= np.sqrt(2700.0 * 0.01 / rigidity)
    np.testing.assert_allclose(factors[:3], [3.4917, 8.5246, 21.429], rtol=0.015)


def on_platform(found: ImportedModel, root: Array) -> Array:
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
    path = computed(tmp_path, deck(*BODIES[name]))
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
