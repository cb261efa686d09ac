"""The rows of a finite element model that its boundary clamps."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from flexslew_plant.arrays import Indices
from flexslew_plant.errors import BadInput
from flexslew_plant.near_names import spelling_hint
from flexslew_plant.testbeds.spacecraft.finite_elements.model import (
    FiniteElementModel,
    rows_of_nodes,
)

_NUMBERS = re.compile(r"(\d{1,9})(?:-(\d{1,9}))?")
_PLANE = re.compile(r"([xyz])=([-+0-9.eE]+)")
_PLANE_TOLERANCE = 1e-6  # of the size of the model
FORMS = "numbers (`7`, `5-9`), node sets of the file, or planes (`x=0`)"


def boundary_rows(model: FiniteElementModel, entries: Sequence[str], path: Path) -> Indices:
    """Return the rows of the boundary, in ascending order; of numbered rows, in the order given.

    Args:
        model: in the units of its file.
        entries: node numbers or ranges of them, names of node sets, planes; of a model without
            nodes, numbers of rows from 1. Empty: the boundary that the file names.
        path: for an error.

    Raises:
        BadInput: an entry means no node, or everything would be clamped.
    """
    if not entries:
        if model.boundary is None:
            words = f"missing, and the file names none; give {FORMS}"
            raise BadInput(words, path, "boundary")
        rows = model.boundary
    elif model.nodes is None:
        rows = np.concatenate([_numbered_rows(entry, model.size, path) for entry in entries])
    else:
        nodes = np.unique(np.concatenate([_nodes(model, entry, path) for entry in entries]))
        rows = rows_of_nodes(model, nodes)
    if not len(rows) or len(rows) >= model.size:
        words = f"it clamps {len(rows)} of {model.size} degrees of freedom; allowed: some, not all"
        raise BadInput(words, path, "boundary", ",".join(entries))
    if len(np.unique(rows)) < len(rows):
        raise BadInput("a row is named twice", path, "boundary", ",".join(entries))
    return rows


def _numbered_rows(entry: str, size: int, path: Path) -> Indices:
    """Return the rows, from 0, of a number or a range of numbers from 1."""
    found = _NUMBERS.fullmatch(entry)
    if found is None:
        words = f"a row or a range of rows from 1 to {size}: the file has no nodes"
        raise BadInput(words, path, "boundary", entry)
    first, last = int(found[1]), int(found[2] or found[1])
    if not 1 <= first <= last <= size:
        raise BadInput(f"rows from 1 to {size}", path, "boundary", entry)
    return np.arange(first - 1, last, dtype=np.int64)


def _nodes(model: FiniteElementModel, entry: str, path: Path) -> Indices:
    """Return the indices of the nodes that an entry means."""
    assert model.nodes is not None
    assert model.node is not None
    if (names := {name.lower(): name for name in model.sets}) and entry.lower() in names:
        chosen = model.sets[names[entry.lower()]]
    elif (found := _NUMBERS.fullmatch(entry)) is not None:
        first, last = int(found[1]), int(found[2] or found[1])
        chosen = np.flatnonzero((model.numbers >= first) & (model.numbers <= last))
    elif (plane := _PLANE.fullmatch(entry)) is not None:
        chosen = _on_plane(model, "xyz".index(plane[1]), plane[2], entry, path)
    else:
        sets = sorted(model.sets)
        known = f"; {spelling_hint(entry, sets)}sets: {', '.join(sets)}" if sets else ""
        raise BadInput(f"{FORMS}{known}", path, "boundary", entry)
    moving = np.intersect1d(chosen, model.node)
    if not len(moving):
        words = f"no node with a degree of freedom; the nodes are {_extent(model)}"
        raise BadInput(words, path, "boundary", entry)
    return moving


def _on_plane(model: FiniteElementModel, axis: int, text: str, entry: str, path: Path) -> Indices:
    """Return the indices of the nodes on a plane across an axis."""
    assert model.nodes is not None
    try:
        place = float(text)
    except ValueError:
        raise BadInput("a plane as `x=0`", path, "boundary", entry) from None
    size = float(np.ptp(model.nodes, axis=0).max())
    return np.flatnonzero(abs(model.nodes[:, axis] - place) <= _PLANE_TOLERANCE * size)


def _extent(model: FiniteElementModel) -> str:
    """Return numbers and places of the nodes in words."""
    assert model.nodes is not None
    low, high = model.nodes.min(axis=0), model.nodes.max(axis=0)
    places = ", ".join(
        f"{axis} {a:g} to {b:g}" for axis, a, b in zip("xyz", low, high, strict=True)
    )
    return f"{model.numbers.min()} to {model.numbers.max()}, {places}"
