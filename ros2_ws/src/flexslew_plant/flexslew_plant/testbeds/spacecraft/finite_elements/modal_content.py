"""Modal data of a reduced finite element model: the keys of `modal_file`."""

from typing import Any

import numpy as np

from flexslew_plant.arrays import Indices, Matrix, Vector
from flexslew_plant.testbeds.spacecraft.finite_elements.model import FiniteElementModel
from flexslew_plant.testbeds.spacecraft.finite_elements.reduction import Reduction

_MOST_POINTS = 400  # of a file; nodes are merged beyond it
_MOST_SHAPES = 16_000  # points times modes of a file, which must stay short


def modal_content(
    model: FiniteElementModel,
    reduction: Reduction,
    rigid: tuple[float, Vector, Matrix],
    ratios: Vector | None,
    tip: int | None,
) -> dict[str, Any]:
    """Return modal data in SI as plain numbers, by key.

    Sums of first order are those of the matrices. Points with lumped masses stand for what counts
    in second order, for the tip and for the drawing.

    Args:
        model: in SI.
        reduction: of the model.
        rigid: mass, first moment and inertia about the interface.
        ratios: of damping, shape (m,); None: no damping.
        tip: index of the node that is reported as the tip; None: the farthest with mass.
    """
    mass, first, inertia = rigid
    content: dict[str, Any] = {
        "units": "si",
        "frequencies_hz": (reduction.frequencies / (2.0 * np.pi)).tolist(),
        "rigid": {
            "mass": mass,
            "first_moment": first.tolist(),
            "inertia": inertia.tolist(),
        },
        "translation": reduction.participation[:3].tolist(),
        "rotation": reduction.participation[3:].tolist(),
    }
    if ratios is not None:
        content["damping_ratios"] = ratios.tolist()
    if model.nodes is None:
        return content
    shapes = displacements(model, reduction.shapes)
    lumps = lumped_masses(model, mass)
    places = model.nodes - reduction.origin
    if tip is None:
        tip = tip_node(places, lumps)
    points, masses, moves, tip = _merged(places, lumps, shapes, tip)
    content |= {
        "points": _short(points),
        "masses": _short(masses),
        "shapes": _short(moves.transpose(2, 0, 1)),
        "tip": tip,
    }
    return content


def displacements(model: FiniteElementModel, vectors: Matrix) -> Matrix:
    """Return the displacements of the nodes, shape (k, 3, m), in vectors of shape (n, m)."""
    assert model.nodes is not None
    assert model.node is not None
    assert model.direction is not None
    along = model.direction < 3
    moves = np.zeros((len(model.nodes), 3, vectors.shape[1]))
    moves[model.node[along], model.direction[along]] = vectors[along]
    return moves


def lumped_masses(model: FiniteElementModel, mass: float) -> Vector:
    """Return a mass for each node, shape (k,): the diagonal of M, scaled to the whole mass.

    E. Hinton, T. Rock and O. C. Zienkiewicz, A note on mass lumping and related processes in the
    finite element method, Earthquake Engineering and Structural Dynamics 4, 1976.
    """
    assert model.nodes is not None
    assert model.node is not None
    assert model.direction is not None
    along = model.direction < 3
    lumps = np.bincount(model.node[along], model.mass.diagonal()[along], minlength=len(model.nodes))
    return np.asarray(lumps * mass / lumps.sum(), dtype=float)


def tip_node(places: Matrix, lumps: Vector) -> int:
    """Return the index of the node with mass that is farthest from the interface."""
    return int(np.where(lumps > 0.0, np.linalg.norm(places, axis=1), -1.0).argmax())


def _merged(
    places: Matrix, lumps: Vector, shapes: Matrix, tip: int
) -> tuple[Matrix, Vector, Matrix, int]:
    """Return some hundred points at most, masses, shapes and the index of the tip among them.

    Nodes in one cell of a grid become their centre of mass, which keeps the sums of first order
    in the displacements. The tip stays where it is.
    """
    lumps = lumps.copy()
    lumps[tip] = max(lumps[tip], 1e-9 * lumps.sum())  # a point has some mass
    kept = np.flatnonzero(lumps > 0.0)
    cells = _cells(places[kept], min(_MOST_POINTS, _MOST_SHAPES // shapes.shape[2]))
    cells[kept == tip] = cells.max() + 1
    _, group = np.unique(cells, return_inverse=True)
    total: Vector = np.bincount(group, lumps[kept]).astype(float)
    count = len(total)
    points, moves = np.zeros((count, 3)), np.zeros((count, *shapes.shape[1:]))
    np.add.at(points, group, lumps[kept, None] * places[kept])
    np.add.at(moves, group, lumps[kept, None, None] * shapes[kept])
    at = int(group[kept == tip][0])
    return points / total[:, None], total, moves / total[:, None, None], at


def _cells(places: Matrix, most: int) -> Indices:
    """Return the number of the cell of each place: each its own, where there are few."""
    if len(places) < most:
        return np.arange(len(places), dtype=np.int64)
    low, size = places.min(axis=0), np.ptp(places, axis=0).max()
    parts = 400
    while True:
        index = np.floor((places - low) / size * parts).astype(np.int64)
        _, cells = np.unique(index, axis=0, return_inverse=True)
        if cells.max() + 1 < most or parts == 1:
            return np.asarray(cells.ravel(), dtype=np.int64)
        parts = max(1, int(parts / 1.25))


def _short(values: Matrix) -> list[Any]:
    """Return numbers with nine digits, which keep a file small."""
    scale = 10.0 ** (8 - np.floor(np.log10(np.where(values == 0.0, 1.0, abs(values)))))
    rounded: list[Any] = (np.round(values * scale) / scale).tolist()
    return rounded
