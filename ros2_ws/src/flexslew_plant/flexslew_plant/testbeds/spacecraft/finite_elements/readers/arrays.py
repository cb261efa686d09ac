"""Matrices by name, of .npz and .mat files.

- M, K: mass and stiffness, shape (n, n); dense, sparse in a .mat, or as triplets in an .npz:
  M_row, M_col (from 0), M_data. They may have the names of Nastran's sets, as MAA, KAA.
- C: damping, likewise; may be left out.
- nodes: places, shape (k, 3).
- numbers: of the nodes, shape (k,); left out: from 1.
- dof: node number and direction of each row, shape (n, 2): 1 to 3 displacement along, 4 to 6
  rotation about x, y, z; left out: three, or six, rows per node in order.
- boundary: rows of the interface, shape (b,); from 0 in an .npz, from 1 in a .mat.

Other variables are named in a warning.
"""

import math
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array

from flexslew_plant.arrays import Indices
from flexslew_plant.errors import BadInput
from flexslew_plant.mat_file import read_mat
from flexslew_plant.near_names import spelling_hint
from flexslew_plant.npz_file import read_npz
from flexslew_plant.testbeds.spacecraft.finite_elements.checks import LARGEST
from flexslew_plant.testbeds.spacecraft.finite_elements.model import FiniteElementModel

MATRICES = ("M", "K", "C")
ARRAYS = ("nodes", "numbers", "dof", "boundary")
_SETS = ("AA", "GG", "XX", "AAX")
ALIASES = {f"{m}{s}": k for m, k in zip("MKB", "MKC", strict=True) for s in _SETS}
_MOST = 10 * LARGEST  # numbers of an array that is not sparse
_TRIPLETS = tuple(f"{name}_{part}" for name in MATRICES for part in ("row", "col", "data"))


def npz_model(path: Path, contents: dict[str, bytes]) -> FiniteElementModel:
    """Return the model of an .npz file.

    Raises:
        BadInput: see model_of_arrays.
    """
    try:
        data: dict[str, Any] = dict(read_npz(BytesIO(contents[path.suffix])))
    except ValueError as error:
        words = f"cannot be read as matrices: {error}; sparse ones as M_row, M_col, M_data"
        raise BadInput(words, path) from None
    for name in MATRICES:
        if f"{name}_data" in data:
            data[name] = _of_triplets(data, name, path)
    return model_of_arrays({k: v for k, v in data.items() if k not in _TRIPLETS}, 0, path)


def mat_model(path: Path, contents: dict[str, bytes]) -> FiniteElementModel:
    """Return the model of a .mat file of MATLAB.

    Raises:
        BadInput: see model_of_arrays.
    """
    del contents  # which count for the cache alone: its reader is a process of its own
    try:
        found = read_mat(path, (*MATRICES, *ALIASES, *ARRAYS), (), sparse=True)
    except ValueError as error:
        raise BadInput(f"cannot be read as matrices: {error}", path) from None
    data: dict[str, Any] = {}
    for key, value in found.items():
        if value is None:  # another variable
            data[key] = np.zeros(0)
        elif isinstance(value, dict):
            row, column, entries = (np.array(part) for part in value["triplets"])
            data[key] = coo_array((entries, (row, column)), shape=tuple(value["shape"]))
        else:
            data[key] = np.asarray(value, dtype=float)
    return model_of_arrays(data, 1, path)


def _of_triplets(data: dict[str, Any], name: str, path: Path) -> coo_array:
    """Return a sparse matrix; its size is that of the larger of M and K."""
    keys = [f"{name}_{part}" for part in ("row", "col", "data")]
    row, column, value = (_numbers(data, key, (None,), path) for key in keys)
    if not len(row) == len(column) == len(value):
        raise BadInput(f"{len(row)}, {len(column)} and {len(value)} triplets", path, keys[0])
    names = [f"{other}_{part}" for other in ("M", "K") for part in ("row", "col")]
    places = [_numbers(data, key, (None,), path) for key in names if key in data]
    size = 1 + int(max(place.max(initial=-1.0) for place in places))
    indices = [
        _indices(places, size, 0, key, path) for places, key in ((row, keys[0]), (column, keys[1]))
    ]
    return coo_array((value, tuple(indices)), shape=(size, size))


def model_of_arrays(data: dict[str, Any], first: int, path: Path) -> FiniteElementModel:
    """Return the model of named arrays.

    Args:
        data: by the names above; M, K and C may be sparse.
        first: what the first row is called in `boundary`, 0 or 1.
        path: for an error.

    Raises:
        BadInput: a matrix is missing or of a wrong shape, or a number is out of range.
    """
    data, unused = _model_arrays(data, path)
    mass, stiffness = (_matrix(data, name, path) for name in ("M", "K"))
    damping = _matrix(data, "C", path) if "C" in data else None
    n = mass.shape[0]
    for name, matrix in (("K", stiffness), ("C", damping)):
        if matrix is not None and matrix.shape != mass.shape:
            raise BadInput(f"has shape {matrix.shape}, M has {mass.shape}", path, name)
    boundary = None
    if "boundary" in data:
        boundary = _indices(_numbers(data, "boundary", (None,), path), n, first, "boundary", path)
    if "nodes" not in data:
        for name in ("numbers", "dof"):
            if name in data:
                raise BadInput("needs `nodes`, which are missing", path, name)
        return FiniteElementModel(mass, stiffness, damping, boundary=boundary, unused=unused)
    nodes = _numbers(data, "nodes", (None, 3), path)
    numbers = np.arange(1, len(nodes) + 1, dtype=np.int64)
    if "numbers" in data:
        numbers = _indices(
            _numbers(data, "numbers", (len(nodes),), path), 2**31, 0, "numbers", path
        )
        if len(np.unique(numbers)) < len(numbers):
            raise BadInput("two nodes have one number", path, "numbers")
    node, direction = _table(data, numbers, n, path)
    return FiniteElementModel(
        mass,
        stiffness,
        damping,
        nodes,
        numbers,
        node,
        direction,
        boundary=boundary,
        unused=unused,
    )


def _model_arrays(data: dict[str, Any], path: Path) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return the arrays of a model by its own names, and the names of others.

    Raises:
        BadInput: two are the same matrix, or a name is almost one that is missing.
    """
    found: dict[str, Any] = {}
    unused = []
    for name, value in data.items():
        key = ALIASES.get(name, name)
        if key not in (*MATRICES, *ARRAYS):
            unused.append(name)
        elif key in found:
            raise BadInput(f"is there twice, as {key}, too", path, name)
        else:
            found[key] = value
    missing = [key for key in ARRAYS if key not in found]
    for name in unused:
        if hint := spelling_hint(name, missing):
            raise BadInput(f"unknown key; {hint}rename it", path, name)
    for key in ("M", "K"):
        if key not in found:
            rest = f"; the file has {', '.join(sorted(data)) or 'nothing'}"
            raise BadInput(f"missing: mass M and stiffness K are needed{rest:.200}", path, key)
    return found, tuple(unused)


def _table(data: dict[str, Any], numbers: Indices, n: int, path: Path) -> tuple[Indices, Indices]:
    """Return the index of the node and the direction of each row, shape (n,) each."""
    if "dof" in data:
        dof = _numbers(data, "dof", (n, 2), path)
        direction = _indices(dof[:, 1], 6, 1, "dof", path)
        return indices_of(_indices(dof[:, 0], 2**31, 0, "dof", path), numbers, path), direction
    per_node = n // len(numbers) if len(numbers) else 0
    if per_node not in (3, 6) or n != per_node * len(numbers):
        words = f"missing: {n} rows are neither three nor six of each of the {len(numbers)} nodes"
        raise BadInput(words, path, "dof")
    rows = np.arange(n, dtype=np.int64)
    return rows // per_node, rows % per_node


def indices_of(called: Indices, numbers: Indices, path: Path) -> Indices:
    """Return the indices of nodes that are called by number.

    Raises:
        BadInput: if a node has no place.
    """
    order = np.argsort(numbers)
    at = np.minimum(np.searchsorted(numbers[order], called), len(numbers) - 1)
    found = order[at]
    wrong = numbers[found] != called
    if wrong.any():
        raise BadInput("a node without a place", path, "dof", int(called[wrong][0]))
    return np.asarray(found, dtype=np.int64)


def _matrix(data: dict[str, Any], name: str, path: Path) -> csc_array:
    """Return a square matrix of numbers."""
    value = data[name]
    if not isinstance(value, coo_array):
        value = _numbers(data, name, (None, None), path)
    elif value.dtype.kind not in "biuf":
        raise BadInput("is not a matrix of real numbers", path, name)
    if value.shape[0] != value.shape[1] or not 1 < value.shape[0] <= LARGEST:
        words = f"has shape {value.shape}; it must be square, with 2 to {LARGEST:,} rows"
        raise BadInput(words, path, name)
    matrix = csc_array(value, dtype=float)
    matrix.sum_duplicates()
    return matrix


def _numbers(
    data: dict[str, Any], key: str, shape: tuple[int | None, ...], path: Path
) -> NDArray[np.float64]:
    """Return an array of finite real numbers of the required shape; None: any length."""
    if key not in data:
        raise BadInput("missing", path, key)
    value = data[key]
    if isinstance(value, coo_array):
        if math.prod(value.shape) > _MOST:
            raise BadInput(
                f"has shape {value.shape}; at most {_MOST:,} numbers are read", path, key
            )
        value = value.toarray()
    value = np.asarray(value)
    if value.dtype.kind not in "biuf":
        raise BadInput(f"is not an array of real numbers but of {value.dtype}", path, key)
    if len(shape) == 1 and value.ndim == 2 and 1 in value.shape:
        value = value.ravel()  # MATLAB has no vectors
    fits = value.ndim == len(shape) and all(
        b is None or a == b for a, b in zip(value.shape, shape, strict=True)
    )
    if not fits:
        required = " x ".join("any" if b is None else str(b) for b in shape)
        raise BadInput(f"has shape {value.shape}; it must be {required}", path, key)
    numbers: NDArray[np.float64] = value.astype(float)
    if not np.isfinite(numbers).all():
        raise BadInput("holds a number that is not finite", path, key)
    return numbers


def _indices(values: NDArray[np.float64], count: int, first: int, key: str, path: Path) -> Indices:
    """Return indices from 0 of numbers that count from `first` to `first` + `count` - 1."""
    good = (values == np.floor(values)) & (values >= first) & (values < first + count)
    if not good.all():
        words = f"whole numbers from {first} to {first + count - 1}"
        wrong = float(values[~good][0])
        raise BadInput(words, path, key, int(wrong) if wrong.is_integer() else wrong)
    return values.astype(np.int64) - first
