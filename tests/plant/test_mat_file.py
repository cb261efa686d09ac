"""Matrices of MATLAB files: sparse ones are read as dense, others are refused by what they are."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat
from scipy.sparse import csc_array, csc_matrix

from flexslew_plant.errors import BadInput
from flexslew_plant.system_file import system_from_file

A, D = np.array([[-1.0, 2.0], [0.0, -3.0]]), np.array([[0.5, 0.0], [0.0, 0.25]])
DENSE = {"A": A, "B": np.eye(2), "C": np.eye(2), "D": D, "Ts": 0.0}


def read(values: dict[str, Any], folder: Path) -> dict[str, Any]:
    savemat(folder / "law.mat", values)
    found: dict[str, Any] = system_from_file(str(folder / "law.mat"), "here")["system"]
    return found


@pytest.mark.slow
@pytest.mark.parametrize("kind", [csc_matrix, csc_array, lambda value: value + 0j])
def test_sparse_and_purely_real_matrices_are_read_as_dense(kind: Any, tmp_path: Path) -> None:
    other = {key: kind(value) if key in "ABCD" else value for key, value in DENSE.items()}
    assert read(other, tmp_path) == read(DENSE, tmp_path)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (A + 1j, "A holds complex numbers"),
        (csc_matrix(A + 1j), "A holds complex numbers"),
        ({"x": 1.0}, "A holds no matrix of numbers"),
        (np.array([["a", "b"]], dtype=object), "A holds no matrix of numbers"),
        ("text", "A holds no matrix of numbers"),
        (csc_matrix((100_000, 100_000)), "A has 100000 x 100000 numbers, at most 1,000,000"),
    ],
)
def test_other_variables_are_refused_by_what_they_are(
    value: Any, words: str, tmp_path: Path
) -> None:
    with pytest.raises(BadInput, match=rf"law\.mat: cannot be read: {words}"):
        read(DENSE | {"A": value}, tmp_path)
