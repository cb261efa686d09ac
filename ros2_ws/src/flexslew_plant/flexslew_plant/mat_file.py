"""Variables of a .mat file of MATLAB, version 5 to 7.3, read by a process of its own.

SciPy's reader and HDF5, which are run here as a program, end their process over some damaged files.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from flexslew_plant.reader_process import Unreadable, read_arrays, write_arrays

_VERSION_7_3 = b"\x00\x02IM"  # bytes 124 to 127, also where MATLAB writes big-endian: never
MOST = 1_000_000  # numbers of a matrix
_MEMORY = 256 << 20  # of the reader, besides its modules [bytes]
_DAMAGED = "it is no MATLAB file of version 5 to 7.3, or damaged"


def read_mat(
    path: Path,
    numbers: tuple[str, ...],
    names: tuple[str, ...],
    sparse: bool = False,
    most: int = MOST,
) -> dict[str, Any]:
    """Return these variables of a file, those that it has; others as None.

    Args:
        path: of MATLAB's version 5 to 7.3.
        numbers: variables that hold real numbers; they become arrays.
        names: variables that hold text in cells or rows, as lists.
        sparse: whether sparse matrices are returned as keys `shape` and `triplets`: rows and
            columns from 0, values; of version 5 to 7.
        most: numbers of a matrix, at most.

    Raises:
        OSError: it cannot be opened.
        ValueError: it is damaged or no such file, a variable holds no numbers, or it is of version
            7.3 and h5py is missing.
    """
    with path.open("rb") as file:
        hdf5 = file.read(128)[124:] == _VERSION_7_3
    if hdf5:
        _require_h5py()
    request = (numbers, names, sparse, most, hdf5)
    return read_arrays("flexslew_plant.mat_file", path, request, _MEMORY, _DAMAGED)


def _require_h5py() -> None:
    import importlib.util

    from flexslew_plant.extras import install_command

    if importlib.util.find_spec("h5py") is None:
        raise ValueError(
            "it is of MATLAB's version 7.3, which needs the package h5py: "
            f"{install_command('h5py')}; or save it again with -v7: save system.mat A B C D Ts -v7"
        )


def _read(
    path: str,
    numbers: list[str],
    names: list[str],
    sparse: bool,
    most: int,
    hdf5: bool,
    limit_memory: Callable[[], None],
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return matrices, and lists of texts by name; None for other variables."""
    if hdf5:
        arrays, texts, present = _read_hdf5(path, numbers, names, most, limit_memory)
    else:
        arrays, texts, present = _read_version_5(path, numbers, names, sparse, most, limit_memory)
    return arrays, texts | {name: None for name in present if name not in {*texts, *arrays}}


def _read_version_5(
    path: str,
    numbers: list[str],
    names: list[str],
    sparse: bool,
    most: int,
    limit_memory: Callable[[], None],
) -> tuple[dict[str, Any], dict[str, Any], list[str]]:
    """Return matrices, sparse ones and lists of texts, and the names of all variables."""
    import numpy as np
    from scipy.io import loadmat, whosmat
    from scipy.sparse import issparse

    def numbers_of(key: str) -> Any:
        value: Any = variables[key]
        is_sparse = issparse(value)
        if not is_sparse and (not isinstance(value, np.ndarray) or value.dtype.kind not in "biufc"):
            raise Unreadable(_no_matrix(key))
        _check_size(key, value.shape, most)
        return _real(key, value.toarray() if is_sparse else value)

    def triplets_of(value: Any) -> dict[str, Any]:
        coordinates = value.tocoo()
        parts = (coordinates.row, coordinates.col, coordinates.data)
        return {"shape": value.shape, "triplets": [part.tolist() for part in parts]}

    def text(entry: Any) -> str:
        while isinstance(entry, np.ndarray):  # MATLAB keeps a name in a cell of a cell
            entry = entry.ravel()[0]
        return str(entry).strip()

    limit_memory()
    variables = loadmat(path, variable_names=[*numbers, *names])
    present = [name for name, _, _ in whosmat(path) if not name.startswith("__")]

    def is_kept(value: Any) -> bool:
        is_sparse = issparse(value)
        return bool(is_sparse and value.nnz <= most and not np.iscomplexobj(value))

    kept = {key: triplets_of(v) for key, v in variables.items() if sparse and is_kept(v)}
    found = [key for key in numbers if key in variables and key not in kept]
    arrays = {key: numbers_of(key) for key in found}
    texts = kept | {
        key: [text(entry) for entry in variables[key].ravel()] for key in names if key in variables
    }
    return arrays, texts, present


def _read_hdf5(
    path: str, numbers: list[str], names: list[str], most: int, limit_memory: Callable[[], None]
) -> tuple[dict[str, Any], dict[str, Any], list[str]]:
    """Return the same of version 7.3, which is HDF5 with matrices turned."""
    import h5py
    import numpy as np

    def matrix(key: str) -> Any:
        node = member(key)
        if not isinstance(node, h5py.Dataset) or node.dtype.kind not in "biufV":
            raise Unreadable(_no_matrix(key))
        if node.external or node.is_virtual:
            raise Unreadable(f"{key} lies in another file")
        _check_size(key, node.shape, most)
        if node.attrs.get("MATLAB_empty", 0):
            return np.zeros(tuple(int(n) for n in node[()][:2]))
        value = node[()].T
        if value.dtype.kind == "V":
            if value.dtype.names != ("real", "imag"):
                raise Unreadable(_no_matrix(key))
            value = value["real"] + 1j * value["imag"]
        return _real(key, value)

    def member(key: str) -> Any:
        if not isinstance(file.get(key, getlink=True), h5py.HardLink):
            raise Unreadable(f"{key} lies in another file")
        return file[key]

    def text(key: str) -> list[str]:
        node = member(key)
        if not isinstance(node, h5py.Dataset) or node.size > most:
            raise Unreadable(f"{key} holds no text")
        if node.dtype.kind in "iu":
            return ["".join(map(chr, row)) for row in np.atleast_2d(node[()].T)]
        cells = [file[one][()] for one in node[()].ravel(order="F")]
        return ["".join(map(chr, cell.ravel(order="F"))) for cell in cells]

    limit_memory()
    with h5py.File(path, "r") as file:
        present = [str(name) for name in file if not name.startswith("#")]
        arrays = {key: matrix(key) for key in numbers if key in present}
        return arrays, {key: text(key) for key in names if key in present}, present


def _no_matrix(key: str) -> str:
    return f"{key} holds no matrix of numbers; save every matrix as a variable of its own"


def _check_size(key: str, shape: tuple[int, ...], most: int) -> None:
    size = 1
    for one in shape:
        size *= one
    if size > most:
        extent = " x ".join(map(str, shape))
        raise Unreadable(f"{key} has {extent} numbers, at most {most:,} are read")


def _real(key: str, value: Any) -> Any:
    """Return a matrix without its imaginary part, which must be zero."""
    if value.dtype.kind != "c":
        return value
    if value.imag.any():
        raise Unreadable(f"{key} holds complex numbers; a system has real ones")
    return value.real


if __name__ == "__main__":
    write_arrays(_read)
