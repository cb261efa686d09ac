"""Models of Nastran: matrices of .op2 files, external superelements of punch files (.pch).

The matrices of a punch file are its DMIG cards, or stand in the .op4 or .op2 file of its name, with
their rows in the order of its EXTRN cards. GRID and CORD2 cards have the places; they may stand in
an .asm, .bdf, .nas or .dat file of its name. Displacements are turned from the axes of their grids
into the basic ones.

With scalar points the model is reduced already: its grids are the interface, which moves as one
rigid body about their centre, and the scalar points are modes that do not move it
(R. R. Craig and M. C. C. Bampton, AIAA Journal 6, 1968).
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_diag, coo_array, csc_array

from flexslew_plant.arrays import Indices, Matrix
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.spacecraft.finite_elements.checks import require_matrices
from flexslew_plant.testbeds.spacecraft.finite_elements.model import FiniteElementModel
from flexslew_plant.testbeds.spacecraft.finite_elements.readers.arrays import (
    ALIASES,
    ARRAYS,
    MATRICES,
    indices_of,
    model_of_arrays,
)
from flexslew_plant.testbeds.spacecraft.finite_elements.readers.nastran_cards import (
    read_cards,
    read_output2,
)
from flexslew_plant.testbeds.spacecraft.finite_elements.readers.op4 import op4_matrices

PUNCH, OUTPUT2 = ".pch", ".op2"
_PLACES = (".asm", ".bdf", ".nas", ".dat")  # files of cards beside a punch file
BESIDE = (*_PLACES, ".op4", OUTPUT2)
_DIGITS = 1e-9  # of the terms of a sum, what ten digits of a card leave
_CARDS = (*MATRICES, *ALIASES)
_Arrays: TypeAlias = dict[str, NDArray[Any]]


def output2_model(path: Path, contents: dict[str, bytes]) -> FiniteElementModel:
    """Return the model of an .op2 file, whose matrices are named as in an .op4 file.

    Raises:
        BadInput: it is damaged, or see model_of_arrays.
    """
    del contents  # which count for the cache alone: its reader is a process of its own
    return model_of_arrays(_output2(path), 1, path)


def punch_model(path: Path, contents: dict[str, bytes]) -> FiniteElementModel:
    """Return the model of a .pch file, with the files of its name beside it.

    Raises:
        BadInput: one is damaged, matrices, their order or places are missing, or see
            model_of_arrays.
    """
    cards = _cards(path)
    order, matrices = _matrices(cards, path, contents)
    places = next(
        (found for found in _with_places(cards, path, contents) if "grids" in found), None
    )
    scalar = order[:, 1] == 0
    if scalar.all():
        raise BadInput("it has scalar points alone, and no grid that a hinge could hold", path)
    if places is None:
        words = f"it has no GRID cards, and no file {path.stem}{'|'.join(_PLACES)} has them"
        raise BadInput(f"{words}: write it by EXTSEOUT(EXTBULK), or put the model beside it", path)
    turn, nodes = _basic_axes(order[~scalar], places, path)
    if scalar.any():
        return _with_rigid_interface(matrices, order, turn, nodes, path)
    matrices = {name: turn.T @ matrix @ turn for name, matrix in matrices.items()}
    return model_of_arrays({**_coo_matrices(matrices), **nodes, "dof": order}, 1, path)


def _matrices(
    cards: _Arrays, path: Path, contents: dict[str, bytes]
) -> tuple[Indices, dict[str, csc_array]]:
    """Return node and direction of each row, shape (n, 2), and M, K and C if there is one."""
    names = [name for name in cards if f"{name}.dof" in cards]
    if names:
        order = np.unique(np.concatenate([cards[f"{name}.dof"] for name in names]), axis=0)
        found = {name: _on_rows(cards[name], cards[f"{name}.dof"], order) for name in names}
    else:
        if "order" not in cards:
            words = "it has neither DMIG cards of mass and stiffness nor EXTRN cards"
            raise BadInput(f"{words}: write it by EXTSEOUT(EXTBULK, DMIGPCH)", path)
        order = cards["order"]
        found = _matrices_beside(path, contents)
    matrices = {}
    for name, matrix in found.items():
        key = ALIASES.get(name, name)
        if key not in MATRICES or (key == "C" and matrix.shape == (1, 1)):
            continue  # Nastran writes one number where there is no damping
        if key in matrices:
            raise BadInput(f"is there twice, as {key}, too", path, name)
        if matrix.shape != (len(order), len(order)):
            words = f"has shape {matrix.shape}; {path.name} names {len(order)} rows"
            raise BadInput(words, path, name)
        matrices[key] = csc_array(matrix)
    for key in ("M", "K"):
        if key not in matrices:
            words = f"missing: mass M and stiffness K are needed, as {key}AA or {key}XX"
            raise BadInput(words, path, key)
    return order, matrices


def _matrices_beside(path: Path, contents: dict[str, bytes]) -> dict[str, Any]:
    """Return the matrices of the file of this name that has them."""
    if ".op4" in contents:
        return op4_matrices(path.with_suffix(".op4"), contents[".op4"])
    if OUTPUT2 in contents:
        return _output2(path.with_suffix(OUTPUT2))
    words = f"it has no DMIG cards of mass and stiffness, and {path.stem}.op4 or .op2 is missing"
    raise BadInput(words, path)


def _on_rows(matrix: NDArray[Any], dof: NDArray[Any], order: Indices) -> csc_array:
    """Return a matrix on more rows, in another order."""
    at = {tuple(row): place for place, row in enumerate(order.tolist())}
    rows = np.array([at[tuple(row)] for row in dof.tolist()])
    given = coo_array(matrix)
    size = len(order)
    return csc_array((given.data, (rows[given.row], rows[given.col])), shape=(size, size))


def _with_places(cards: _Arrays, path: Path, contents: dict[str, bytes]) -> Iterator[_Arrays]:
    yield cards
    for ending in _PLACES:
        if ending in contents:
            yield _cards(path.with_suffix(ending))


def _basic_axes(order: Indices, cards: _Arrays, path: Path) -> tuple[csc_array, _Arrays]:
    """Return the matrix that turns basic displacements into those of rows, and nodes.

    Args:
        order: node and direction of each row, shape (n, 2), without scalar points.
        cards: with the places.
        path: for an error.
    """
    numbers = np.unique(order[:, 0])
    at = indices_of(numbers, cards["grids"], path)
    blocks = []
    for number, axes in zip(numbers, cards["axes"][at], strict=True):
        directions = order[order[:, 0] == number, 1] - 1
        block = np.kron(np.eye(2), axes)[np.ix_(directions, directions)]
        if len(directions) < 6 and not np.array_equal(block @ block.T, np.eye(len(block))):
            words = "its displacements have axes of their own, and some of its six rows are missing"
            raise BadInput(words, path, "GRID", int(number))
        blocks.append(block)
    return csc_array(block_diag(blocks)), {"nodes": cards["places"][at], "numbers": numbers}


def _with_rigid_interface(
    matrices: dict[str, csc_array], order: Indices, turn: csc_array, nodes: _Arrays, path: Path
) -> FiniteElementModel:
    """Return the model whose first six rows move all grids as one rigid body."""
    scalar = order[:, 1] == 0
    inner, outer = np.flatnonzero(scalar), np.flatnonzero(~scalar)
    held = {
        name: turn.T @ matrix[outer][:, outer] @ turn
        for name, matrix in matrices.items()
        if name != "C"
    }
    interface = model_of_arrays({**_coo_matrices(held), **nodes, "dof": order[outer]}, 1, path)
    assert interface.nodes is not None
    rigid = turn @ interface.rigid_vectors(interface.nodes.mean(axis=0))
    moved = np.zeros((len(order), 6 + len(inner)))
    moved[outer, :6] = rigid
    moved[inner, 6 + np.arange(len(inner))] = 1.0
    require_matrices(FiniteElementModel(matrices["M"], matrices["K"], matrices.get("C")), path)
    reduced = {name: _congruent(matrix, moved) for name, matrix in matrices.items()}
    return FiniteElementModel(
        reduced["M"], reduced["K"], reduced.get("C"), boundary=np.arange(6, dtype=np.int64)
    )


def _congruent(matrix: csc_array, moved: Matrix) -> csc_array:
    """Return T^T A T, symmetric, without what is rounding of its terms."""
    product = moved.T @ (matrix @ moved)
    terms = abs(moved).T @ (abs(matrix) @ abs(moved))
    return csc_array(np.where(abs(product) > _DIGITS * terms, 0.5 * (product + product.T), 0.0))


def _coo_matrices(matrices: dict[str, csc_array]) -> dict[str, Any]:
    """Return matrices in coordinate form, as `model_of_arrays` takes them."""
    return {name: coo_array(matrix) for name, matrix in matrices.items()}


def _cards(path: Path) -> _Arrays:
    try:
        return {k: v for k, v in read_cards(path, _CARDS).items() if v is not None}
    except ValueError as error:
        raise BadInput(f"cannot be read: {error}", path) from None


def _output2(path: Path) -> dict[str, Any]:
    names = (*_CARDS, *(name.upper() for name in ARRAYS))
    try:
        found = read_output2(path, names)
    except ValueError as error:
        raise BadInput(f"cannot be read: {error}", path) from None
    named = {name if name in _CARDS else name.lower(): value for name, value in found.items()}
    return {name: np.zeros(0) if value is None else value for name, value in named.items()}
