"""Matrices that CalculiX stores: `*FREQUENCY, SOLVER=MATRIXSTORAGE` of an input deck NAME.inp.

NAME.sti and NAME.mas hold `row column value` of one triangle of the stiffness and the mass matrix,
NAME.dof holds `node.direction` per row (CalculiX CrunchiX user's manual, *FREQUENCY). Places and
node sets come from the deck.
"""

import warnings
from io import BytesIO
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array, csc_array

from flexslew_plant.arrays import Indices, Matrix
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.spacecraft.finite_elements.checks import LARGEST
from flexslew_plant.testbeds.spacecraft.finite_elements.model import FiniteElementModel
from flexslew_plant.testbeds.spacecraft.finite_elements.readers.arrays import indices_of

ENDINGS = (".inp", ".sti", ".mas", ".dof")
_MOST_WORK = 20_000_000  # nodes that the lines of *NSET go through
_LOCAL = ("*TRANSFORM", "*INCLUDE")  # keywords after which places or directions are others


def calculix_model(path: Path, contents: dict[str, bytes]) -> FiniteElementModel:
    """Return the model of a deck and the matrices that CalculiX stored of it.

    Raises:
        BadInput: a file is damaged, or has elements whose nodes CalculiX replaces.
    """
    numbers, nodes, sets = _deck(contents[".inp"], path.with_suffix(".inp"))
    rows = path.with_suffix(".dof")
    table = _table(contents[".dof"], rows)
    doubled = len(np.unique(table, axis=0)) < len(table)
    if doubled:
        words = (
            "a node has a direction twice: CalculiX expands beam and shell elements to solids with "
            "nodes of its own; use solid elements (C3D20, C3D10)"
        )
        raise BadInput(words, rows)
    node = indices_of(table[:, 0], numbers, rows)
    return FiniteElementModel(
        mass=_matrix(contents[".mas"], len(table), path.with_suffix(".mas")),
        stiffness=_matrix(contents[".sti"], len(table), path.with_suffix(".sti")),
        nodes=nodes,
        numbers=numbers,
        node=node,
        direction=table[:, 1] - 1,
        sets=sets,
    )


def _table(content: bytes, path: Path) -> Indices:
    """Return node number and direction from 1 of each row, shape (n, 2)."""
    try:
        words = [line.split(".") for line in content.decode("ascii").split()]
        table = np.array([[int(node), int(direction)] for node, direction in words])
    except ValueError:
        raise BadInput("must hold node.direction in each line", path) from None
    if not 1 < len(table) <= LARGEST:
        raise BadInput(f"has {len(table)} rows; allowed: 2 to {LARGEST:,}", path)
    if table[:, 1].min() < 1 or table[:, 1].max() > 3 or not 0 < table[:, 0].max() < 2**31:
        raise BadInput("directions must be 1 to 3: displacements alone are read", path)
    return table.astype(np.int64)


def _matrix(content: bytes, n: int, path: Path) -> csc_array:
    """Return the symmetric matrix of one triangle."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # an empty file
            rows = np.loadtxt(BytesIO(content), ndmin=2, comments=None)
    except (ValueError, UserWarning):
        raise BadInput("must hold row, column and value in each line", path) from None
    if rows.shape[1] != 3:
        raise BadInput(f"must hold row, column and value, it has {rows.shape[1]} columns", path)
    places = rows[:, :2]
    if not ((places >= 1) & (places <= n) & (places == np.floor(places))).all():
        raise BadInput(f"rows and columns must be whole numbers from 1 to {n}, as in .dof", path)
    i, j = (places.T - 1).astype(np.int64)
    if (i > j).any() and (i < j).any():
        raise BadInput("must hold one triangle of the matrix", path)
    if len(np.unique(i * n + j)) < len(i):
        raise BadInput("an entry of the matrix is there twice", path)
    half = coo_array((rows[:, 2], (i, j)), shape=(n, n))
    off = coo_array((np.where(i == j, 0.0, rows[:, 2]), (j, i)), shape=(n, n))
    return csc_array(half + off)


def _deck(content: bytes, path: Path) -> tuple[Indices, Matrix, dict[str, Indices]]:
    """Return numbers, places and sets of the nodes of a deck."""
    places: dict[int, list[float]] = {}
    sets: dict[str, set[int]] = {}
    keyword, work = "", 0
    options: dict[str, str] = {}
    for number, raw in enumerate(content.decode("utf-8", "replace").splitlines(), start=1):
        line = raw.strip()
        if not line or line.startswith("**"):
            continue
        if line.startswith("*"):
            keyword, options = _keyword(line)
            if keyword in _LOCAL:
                raise BadInput(
                    f"line {number}: {keyword} is not read; write the deck without", path
                )
            continue
        try:
            fields = [field for field in line.split(",") if field.strip()]
            if keyword == "*NODE":
                places[int(fields[0])] = [*map(float, fields[1:4]), *(0.0,) * (4 - len(fields))]
                sets.setdefault(options.get("NSET", ""), set()).add(int(fields[0]))
            elif keyword == "*NSET":
                members = _members(fields, options, sets, places)
                work += len(members) + len(places) * ("GENERATE" in options)
                if work > _MOST_WORK:
                    raise BadInput(f"line {number}: its node sets are too many", path)
                sets.setdefault(options["NSET"], set()).update(members)
        except (ValueError, KeyError, IndexError):
            raise BadInput(
                f"line {number}: cannot be read as {keyword}", path, value=line
            ) from None
    if not places:
        raise BadInput("has no *NODE", path)
    numbers = np.array(sorted(places), dtype=np.int64)
    nodes = np.array([places[n] for n in numbers.tolist()])
    if not np.isfinite(nodes).all() or numbers[0] < 1 or numbers[-1] >= 2**31:
        raise BadInput("a place is not finite, or a node's number out of range", path, "*NODE")
    known = {
        name: np.flatnonzero(np.isin(numbers, list(members)))
        for name, members in sets.items()
        if name
    }
    return numbers, nodes, known


def _keyword(line: str) -> tuple[str, dict[str, str]]:
    """Return a keyword and its options, in capitals."""
    first, *rest = [part.strip().upper() for part in line.split(",")]
    pairs = [part.partition("=") for part in rest]
    return first.replace(" ", ""), {name.strip(): value.strip() for name, _, value in pairs}


def _members(
    fields: list[str],
    options: dict[str, str],
    sets: dict[str, set[int]],
    places: dict[int, list[float]],
) -> set[int]:
    """Return the node numbers that a line of *NSET adds: numbers, sets, or from, to, step."""
    if "GENERATE" in options:
        numbers = range(*_range(fields))
        return {node for node in places if node in numbers}
    found: set[int] = set()
    for field in fields:
        name = field.strip().upper()
        found |= sets[name] if name in sets else {int(name)}
    return found


def _range(fields: list[str]) -> tuple[int, int, int]:
    """Return first, one after the last, and step."""
    first, last, *step = map(int, fields)
    (by,) = step or [1]
    if by < 1:
        raise ValueError(fields)
    return first, last + 1, by
