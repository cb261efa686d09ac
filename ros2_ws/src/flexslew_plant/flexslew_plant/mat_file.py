"""What a .mat file of MATLAB holds, read by a process of its own.

SciPy's reader, which is run here as a program, ends its process over some damaged files.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

_VERSION_7_3 = b"\x00\x02IM"  # bytes 124 to 127, also where MATLAB writes big-endian: never
_ERROR = "refused"  # key of what the reader prints, in place of the variables
_MOST = 1_000_000  # numbers of a matrix
_TIMEOUT = 60.0  # of a reader [s]
_MEMORY = 256 << 20  # of a reader, besides its modules [B]
_TOO_LARGE = 3  # exit code of a reader that needs more


def read_mat(
    path: Path, numbers: tuple[str, ...], names: tuple[str, ...], sparse: bool = False
) -> dict[str, Any]:
    """Return these variables of a file as plain data, those that it has; others as None.

    Args:
        path: of MATLAB's version 5 to 7.
        numbers: variables that hold real numbers, as rows.
        names: variables that hold text in cells or rows, as lists.

        sparse: whether sparse matrices are returned as keys `shape` and `triplets`: rows and
            columns from 0, values.

    Raises:
        OSError: it cannot be opened.
        ValueError: it is of version 7.3, damaged or no such file, or a variable holds no numbers.
    """
    with path.open("rb") as file:
        if file.read(128)[124:] == _VERSION_7_3:
            raise ValueError(
                "it is of MATLAB's version 7.3; save it again with -v7: "
                "save system.mat A B C D Ts -v7"
            )
    request = [sys.executable, "-P", __file__, str(path), json.dumps([numbers, names, sparse])]
    try:
        done = subprocess.run(request, capture_output=True, text=True, timeout=_TIMEOUT, check=True)
    except subprocess.TimeoutExpired:
        raise ValueError(f"its reader has not ended within {_TIMEOUT:g} s") from None
    except subprocess.CalledProcessError as error:
        if error.returncode == _TOO_LARGE:
            raise ValueError(f"it unpacks to more than {_MEMORY >> 20} MiB") from None
        raise ValueError("it is no MATLAB file of version 5 to 7, or damaged") from None
    found: dict[str, Any] = json.loads(done.stdout)
    if why := found.pop(_ERROR, ""):
        raise ValueError(why)
    return found


class _NoNumbers(Exception):
    """A variable is no matrix of real numbers."""


def _main(path: str, request: str) -> None:
    """Print the variables as JSON."""
    import numpy as np
    from scipy.io import loadmat, whosmat
    from scipy.sparse import issparse

    def numbers_of(key: str) -> Any:
        value: Any = variables[key]
        is_sparse = issparse(value)
        if not is_sparse and (not isinstance(value, np.ndarray) or value.dtype.kind not in "biufc"):
            raise _NoNumbers(
                f"{key} holds no matrix of numbers; save every matrix as a variable of its own"
            )
        if sparse and is_sparse and value.nnz <= _MOST and not np.iscomplexobj(value):
            triplets = value.tocoo()
            parts = (triplets.row, triplets.col, triplets.data)
            return {"shape": value.shape, "triplets": [part.tolist() for part in parts]}
        if np.prod(value.shape) > _MOST:
            raise _NoNumbers(
                f"{key} has {value.shape[0]} x {value.shape[1]} numbers, at most {_MOST:,} are read"
            )
        dense = value.toarray() if is_sparse else value
        if np.iscomplexobj(dense):
            if dense.imag.any():
                raise _NoNumbers(f"{key} holds complex numbers; a system has real ones")
            dense = dense.real
        return dense.tolist()

    def text(entry: Any) -> str:
        while isinstance(entry, np.ndarray):  # MATLAB keeps a name in a cell of a cell
            entry = entry.ravel()[0]
        return str(entry).strip()

    numbers, names, sparse = json.loads(request)
    _limit_memory()
    try:
        variables = loadmat(path, variable_names=[*numbers, *names])
        present = [name for name, _, _ in whosmat(path) if not name.startswith("__")]
        found: dict[str, Any] = {key: numbers_of(key) for key in numbers if key in variables}
        found |= {
            key: [text(entry) for entry in variables[key].ravel()]
            for key in names
            if key in variables
        }
        found |= dict.fromkeys(name for name in present if name not in found)
    except MemoryError:
        sys.exit(_TOO_LARGE)
    except _NoNumbers as error:
        found = {_ERROR: str(error)}
    print(json.dumps(found))


def _limit_memory() -> None:
    """Limit the address space of this process, where the system can."""
    try:
        import resource

        pages = int(Path("/proc/self/statm").read_text().split()[0])
    except (ImportError, OSError):
        return
    limit = pages * resource.getpagesize() + _MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (limit, resource.getrlimit(resource.RLIMIT_AS)[1]))


if __name__ == "__main__":
    _main(*sys.argv[1:])
