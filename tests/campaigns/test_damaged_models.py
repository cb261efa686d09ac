"""A finite element model that is damaged is refused in one line, or is a model all the same."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat
from scipy.sparse import csc_array

from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.spacecraft.finite_elements.imported import (
    ImportOptions,
    import_model,
)
from tests.plant.testbeds.spacecraft.finite_elements.decks import truss_files
from tests.plant.testbeds.spacecraft.finite_elements.frames import ANGLE, arrays, saved
from tests.plant.testbeds.spacecraft.finite_elements.mode_files import rod_files
from tests.plant.testbeds.spacecraft.finite_elements.test_op4 import binary, text


def npz(folder: Path) -> Path:
    return saved(folder, **arrays(ANGLE, 2))


def mat(folder: Path) -> Path:
    data = arrays(ANGLE, 2)
    path = folder / "model.mat"
    savemat(path, {**data, "K": csc_array(data["K"]), "boundary": data["boundary"] + 1})
    return path


def op4(folder: Path, write: Callable[[str, np.ndarray], bytes]) -> Path:
    data = arrays(ANGLE, 2)
    path = folder / "model.op4"
    matrices = {"MAA": data["M"], "KAA": data["K"], "NODES": data["nodes"],
                "BOUNDARY": data["boundary"][:, None] + 1.0}  # fmt: skip
    path.write_bytes(b"".join(write(name, matrix) for name, matrix in matrices.items()))
    return path


MODELS: dict[str, Callable[[Path], Path]] = {
    "npz": npz,
    "mat": mat,
    "op4 dense": lambda folder: op4(folder, lambda n, m: text(n, m, "dense").encode()),
    "op4 strings": lambda folder: op4(folder, lambda n, m: text(n, m, "nonbigmat").encode()),
    "op4 binary": lambda folder: op4(folder, lambda n, m: binary(n, m, "<")),
    "calculix": truss_files,
    "calculix modes": rod_files,
}


def damaged(content: bytes, case: np.random.Generator) -> bytes:
    """Return bytes after flipping, clearing, doubling, dropping or cutting some of them."""
    changed = bytearray(content)
    at, size = int(case.integers(len(content))), int(case.integers(1, 60))
    how = case.choice(["flip", "zero", "double", "drop", "noise", "digit", "cut"])
    if how == "flip":
        changed[at] ^= 1 << int(case.integers(8))
    elif how == "zero":
        changed[at : at + size] = bytes(len(changed[at : at + size]))
    elif how == "noise":
        changed[at : at + size] = case.bytes(len(changed[at : at + size]))
    elif how == "digit":
        changed[at] = int(case.choice(list(b"0123456789-+.eE ,")))
    elif how == "cut":
        del changed[at:]
    else:
        changed[at : at + size] = changed[at : at + size] * (2 * (how == "double"))
    return bytes(changed)


@pytest.mark.parametrize("kind", MODELS)
def test_a_damaged_model_is_refused_in_one_line_or_is_a_model(
    tmp_path: Path, case: np.random.Generator, kind: str
) -> None:
    path = MODELS[kind](tmp_path)
    boundary = {"calculix": ("ROOT",), "calculix modes": ()}.get(kind, ("1",))
    options = ImportOptions(boundary, 3)
    assert import_model(path, options).content["frequencies_hz"]
    files = sorted(path.parent.glob("model.*"))
    victim = files[int(case.integers(len(files)))]
    victim.write_bytes(damaged(victim.read_bytes(), case))
    try:
        found = import_model(path, options)
    except BadInput as error:
        assert str(error).isprintable()  # noqa: PT017
        assert "model." in str(error)  # noqa: PT017
        return
    numbers = [
        found.content[key] for key in ("frequencies_hz", "translation", "rotation", "shapes")
    ]
    assert all(np.isfinite(np.array(values)).all() for values in numbers)
    assert (np.array(found.content["frequencies_hz"]) > 0.0).all()
