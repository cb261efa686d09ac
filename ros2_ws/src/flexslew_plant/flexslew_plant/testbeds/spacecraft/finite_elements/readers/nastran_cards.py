"""Nastran's output2 files and bulk data, read by pyYeti in a process of its own.

The program of this module writes what `reader_process` asks for.
"""

import contextlib
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from flexslew_plant.reader_process import Unreadable, read_arrays, write_arrays

MOST = 9_000_000  # numbers of a matrix
_MEMORY = 1 << 30  # of the reader, besides its modules [bytes]
_DAMAGED = "it is no {} file of Nastran, or damaged"
_REAL = (1, 2)  # types of matrices, of single and double precision


def read_output2(path: Path, names: tuple[str, ...]) -> dict[str, Any]:
    """Return these matrices of an .op2 file, those that it has; others as None.

    Raises:
        ValueError: see read_cards.
    """
    return _read_by_pyyeti(path, ["output2", names], "output2")


def read_cards(path: Path, names: tuple[str, ...]) -> dict[str, Any]:
    """Return what the cards of bulk data say of a model.

    Args:
        path: of the bulk data: a punch file, an assembly file or an input file.
        names: DMIG matrices that are read.

    Returns:
        Matrices by name, with rows and columns as `NAME.dof`, shape (n, 2): number of the node and
        direction 1 to 6, or 0 of a scalar point. `order`: the same of EXTRN, shape (n, 2).
        `grids`: numbers, shape (g,), `places`: in the basic axes, shape (g, 3), and `axes`: of
        displacements, as rows, shape (g, 3, 3). Whatever the file lacks is left out.

    Raises:
        ValueError: it is damaged, too large, or pyYeti is missing.
    """
    return _read_by_pyyeti(path, ["cards", names], "bulk data")


def _read_by_pyyeti(path: Path, request: list[Any], kind: str) -> dict[str, Any]:
    import importlib.util

    from flexslew_plant.extras import install_command

    if importlib.util.find_spec("pyyeti") is None:
        raise ValueError(f"it needs the package pyYeti: {install_command('pyyeti')}")
    return read_arrays(__name__, path, request, _MEMORY, _DAMAGED.format(kind))


def _read(
    path: str, kind: str, names: list[str], limit_memory: Callable[[], None]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return arrays, and None for the names of matrices that are not read."""
    os.environ["ARROW_DEFAULT_MEMORY_POOL"] = "system"  # the other sets memory aside
    with contextlib.redirect_stdout(sys.stderr):  # pyYeti prints
        return (_matrices if kind == "output2" else _cards)(path, names, limit_memory)


def _matrices(
    path: str, names: list[str], limit_memory: Callable[[], None]
) -> tuple[dict[str, Any], dict[str, Any]]:
    from pyyeti.nastran import op2

    limit_memory()
    with op2.OP2(path) as file:
        found = {name: blocks[-1] for name, blocks in file.dbdct.items() if blocks[-1].dbtype}
        read = [name for name in names if name in found]
        for name in read:
            columns, rows = found[name].trailer[1:3]
            _require_size(name, rows, columns)
            if found[name].trailer[4] not in _REAL:
                raise Unreadable(f"{name} holds no real numbers")
        arrays = file.rdop2mats(read) if read else {}
    return arrays, {name: None for name in found if name not in arrays}


def _cards(
    path: str, names: list[str], limit_memory: Callable[[], None]
) -> tuple[dict[str, Any], dict[str, Any]]:
    import numpy as np
    from pyyeti.nastran import bulk, n2p

    limit_memory()
    options: dict[str, Any] = {"follow_includes": False, "encoding": "latin-1"}
    arrays: dict[str, Any] = {}
    with open(path, encoding="latin-1") as file:
        present = bulk.rdcards(file, "dmig", return_var="list", blank="", **options) or []
        every = {str(card[0]).upper() for card in present}
        if every & set(names):
            matrices = bulk.rddmig(file, sorted(every & set(names)), square=True, **options)
            for key, frame in matrices.items():
                _require_size(key.upper(), *frame.shape)
                arrays[key.upper()] = frame.to_numpy()
                arrays[f"{key.upper()}.dof"] = np.array(frame.index.to_list())
        extern = bulk.rdcards(file, "extrn", dtype=np.int64, **options)
        if extern is not None:
            arrays["order"] = n2p.expanddof(extern.reshape(-1, 2))
        grids = bulk.rdgrids(file, **options)
    if grids is not None:
        coordinates = bulk.rdcord2cards(path, **options)
        number = grids[:, 0].astype(np.int64)
        table = n2p.addgrid(None, number, "b", grids[:, 1], grids[:, 2:5], grids[:, 5], coordinates)
        vectors = n2p.rbgeom_uset(table).reshape(len(number), 6, 6)
        arrays |= {
            "grids": number,
            "places": table.iloc[::6][["x", "y", "z"]].to_numpy(),
            "axes": vectors[:, :3, :3],
        }
    return arrays, {name: None for name in sorted(every) if name not in arrays}


def _require_size(name: str, rows: int, columns: int) -> None:
    if rows * columns > MOST:
        raise Unreadable(f"{name} has {rows} x {columns} numbers, at most {MOST:,} are read")


if __name__ == "__main__":
    write_arrays(_read)
