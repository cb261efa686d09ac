"""Matrices of .npz and .mat files: what is read alike, and what is refused in one line."""

import pickle
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat
from scipy.sparse import coo_array, csc_array
from tests.plant.testbeds.spacecraft.finite_elements.frames import ANGLE, BEAM, arrays, saved
from tests.plant.testbeds.spacecraft.finite_elements.platforms import craft

from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.spacecraft.finite_elements.imported import (
    ImportOptions,
    import_model,
)

FOUR = ImportOptions(modes=4)


def frequencies(path: Path, options: ImportOptions = FOUR) -> Any:
    return np.array(import_model(path, options).content["frequencies_hz"])


def test_triplets_and_a_mat_file_are_the_same_model(tmp_path: Path) -> None:
    data = arrays(ANGLE)
    expected = frequencies(saved(tmp_path, **data))
    parts: dict[str, Any] = {}
    for name in ("M", "K"):
        sparse = coo_array(data[name])
        parts |= {f"{name}_row": sparse.row, f"{name}_col": sparse.col, f"{name}_data": sparse.data}
    rest = {"nodes": data["nodes"], "boundary": data["boundary"]}
    np.testing.assert_allclose(frequencies(saved(tmp_path, **parts, **rest)), expected, rtol=1e-9)
    path = tmp_path / "model.mat"
    for matrices in (data, {**data, "M": csc_array(data["M"]), "K": csc_array(data["K"])}):
        savemat(path, {**matrices, "boundary": data["boundary"] + 1})  # MATLAB counts from 1
        np.testing.assert_allclose(frequencies(path), expected, rtol=1e-9)


def test_a_large_sparse_mat_file_is_read(tmp_path: Path) -> None:
    data = arrays(BEAM, 200)
    matrices = {name: csc_array(data[name]) for name in ("M", "K")}
    savemat(tmp_path / "model.mat", {**matrices, "nodes": data["nodes"]})
    found = frequencies(tmp_path / "model.mat", ImportOptions(("x=0",), 4))
    np.testing.assert_allclose(found, frequencies(saved(tmp_path, **data)), rtol=1e-6)


def test_rows_in_any_order_are_named_by_node_and_direction(tmp_path: Path) -> None:
    data = arrays(ANGLE)
    expected = frequencies(saved(tmp_path, **data))
    count = len(data["nodes"])
    dof = np.column_stack(
        (np.repeat(10 * np.arange(1, count + 1), 6), np.tile(np.arange(1, 7), count))
    )
    order = np.random.default_rng(3).permutation(len(dof))
    mixed = {name: data[name][np.ix_(order, order)] for name in ("M", "K")}
    path = saved(tmp_path, **mixed, nodes=data["nodes"], numbers=10 * np.arange(1, count + 1),
                 dof=dof[order])  # fmt: skip
    np.testing.assert_allclose(frequencies(path, ImportOptions(("10",), 4)), expected, rtol=1e-8)


def changed(**changes: Any) -> dict[str, Any]:
    data = arrays(BEAM, 4)
    return {key: value for key, value in {**data, **changes}.items() if value is not None}


def entry(name: str, at: tuple[int, int], value: float) -> dict[str, Any]:
    matrix = arrays(BEAM, 4)[name]
    matrix[at] = value
    return {name: matrix}


def held() -> dict[str, Any]:
    """Return a stiffness with a spring to the ground at the last node."""
    stiffness = arrays(BEAM, 4)["K"]
    stiffness[-5, -5] += 1e3
    return {"K": stiffness}


WRONG: dict[str, tuple[dict[str, Any], ImportOptions, str]] = {
    "no K": (changed(K=None), FOUR, "K: missing: .*; the file has M, boundary, nodes"),
    "not square": (changed(M=np.ones((30, 29))), FOUR, r"M: has shape \(30, 29\)"),
    "another size": (changed(K=np.eye(29)), FOUR, r"K: has shape \(29, 29\), M has \(30, 30\)"),
    "not a number": (changed(**entry("K", (3, 3), np.nan)), FOUR, "K: .*not finite"),
    "infinite": (changed(**entry("M", (3, 3), np.inf)), FOUR, "M: .*not finite"),
    "not symmetric": (changed(**entry("K", (8, 2), 5e6)), FOUR, "K: it is not symmetric"),
    "negative mass": (changed(M=-arrays(BEAM, 4)["M"]), FOUR, "M: .* diagonal is negative"),
    "indefinite": (changed(**{"M": arrays(BEAM, 4)["M"] + 40.0 * (1 - np.eye(30))}), FOUR,
                   "M: it is not positive semidefinite"),
    "zero": (changed(M=np.zeros((30, 30))), FOUR, "M: it is zero"),
    "complex": (changed(M=arrays(BEAM, 4)["M"] * 1j), FOUR, "M: is not an array of real numbers"),
    "text": (changed(M=np.array("heavy")), FOUR, "M: is not an array of real numbers"),
    "boundary out of range": (changed(boundary=np.array([0, 99])), FOUR, "boundary: 99 is not"),
    "boundary twice": (changed(boundary=np.array([0, 0, 1])), FOUR, "boundary: .*named twice"),
    "boundary of halves": (changed(boundary=np.array([0.5])), FOUR, "boundary: 0.5 is not allowed"),
    "no boundary": (changed(boundary=None), FOUR, "boundary: missing, and the file names none"),
    "all clamped": (changed(), ImportOptions(("1-99",), 4), "clamps 30 of 30"),
    "boundary too small": (changed(boundary=np.array([0, 1])), FOUR, "clamped, the stiffness is"),
    "no such node": (changed(), ImportOptions(("77",), 4), "no node with a degree of freedom"),
    "no such set": (changed(), ImportOptions(("root",), 4), "boundary: 'root' is not allowed"),
    "no plane": (changed(), ImportOptions(("x=1e",), 4), "a plane as `x=0`"),
    "too many modes": (changed(), ImportOptions(modes=25), "modes: 25 is not allowed: 1 to 24"),
    "units": (changed(), ImportOptions(units="mm"), "units: 'mm' is not allowed"),
    "tip": (changed(), ImportOptions(tip=9), "tip: 9 is not allowed: a node from 1 to 5"),
    "held": (changed(**held()), FOUR, "K: it has 5 rigid-body modes, not 6"),
    "nodes moved": (changed(nodes=arrays(BEAM, 4)["nodes"] * 1.5), FOUR, "rigid-body modes, not 6"),
    "nodes of two": (changed(nodes=np.ones((5, 2))), FOUR, r"nodes: has shape \(5, 2\)"),
    "too few nodes": (changed(nodes=np.ones((4, 3))), FOUR, "dof: missing: 30 rows are neither"),
    "misspelt key": (changed(boundary=None, boundry=np.arange(6)), FOUR,
                     "boundry: unknown key; did you mean boundary"),
    "M twice": (changed(MAA=np.eye(30)), FOUR, "MAA: is there twice, as M, too"),
    "dof without nodes": (changed(nodes=None, dof=np.ones((30, 2))), FOUR, "dof: needs `nodes`"),
    "direction 7": (changed(dof=np.full((30, 2), 7)), FOUR, "dof: 7 is not allowed"),
    "damping that drives": (changed(C=-arrays(BEAM, 4)["M"]), FOUR, "C: gives damping ratios"),
    "five of an interface": (changed(nodes=None, boundary=np.arange(5)), FOUR,
                             "boundary: .*without nodes it must have 6|clamped, the stiffness is"),
    "origin without nodes": (changed(nodes=None), ImportOptions(modes=4, origin=(0.0, 0.0, 0.0)),
                             "origin: the file has no nodes"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_model_is_refused_in_one_line(tmp_path: Path, name: str) -> None:
    data, options, words = WRONG[name]
    with pytest.raises(BadInput, match=words) as error:
        import_model(saved(tmp_path, **data), options)
    assert "\n" not in str(error.value)
    assert "model.npz" in str(error.value)


def test_a_pickle_in_an_npz_is_never_loaded(tmp_path: Path) -> None:
    class Bomb:
        def __reduce__(self) -> Any:
            return (Path.touch, (tmp_path / "exploded",))

    assert pickle.dumps(Bomb())
    with pytest.raises(BadInput, match="cannot be read as matrices"):
        frequencies(saved(tmp_path, M=np.array([Bomb()], dtype=object), K=np.eye(6)))
    assert not (tmp_path / "exploded").exists()


def test_an_unknown_ending_is_refused_with_those_that_are_read(tmp_path: Path) -> None:
    (tmp_path / "model.xyz").write_text("x")
    with pytest.raises(BadInput, match=r"a finite element model ends in \.npz, \.mat"):
        frequencies(tmp_path / "model.xyz")


def test_a_sparse_array_of_many_zeros_is_not_unpacked(tmp_path: Path) -> None:
    data = arrays(BEAM, 4)
    nodes = csc_array(([1.0], ([0], [0])), shape=(200_000, 200_000))
    savemat(tmp_path / "model.mat", {**data, "nodes": nodes, "boundary": np.arange(1, 7)})
    with pytest.raises(BadInput, match=r"nodes: has shape \(200000, 200000\); at most"):
        frequencies(tmp_path / "model.mat")


@pytest.mark.parametrize("ending", [".npz", ".mat"])
def test_other_variables_of_a_file_are_named_in_a_warning_of_the_trial(
    tmp_path: Path, ending: str
) -> None:
    data = arrays(BEAM, 4)
    data["boundary"] = data["boundary"] + (ending == ".mat")
    path = tmp_path / f"model{ending}"
    others = {"title": np.array("boom"), "freq_hz": np.arange(3.0)}
    if ending == ".npz":
        saved(tmp_path, **data, **others)
    else:
        savemat(path, data | others)
    (doubt,) = craft({"kind": "finite_elements", "file": str(path), "modes": 4}).doubts()
    assert re.fullmatch(
        "appendages.arm.shape: variables that are not used: (title, freq_hz|freq_hz, title)", doubt
    )
