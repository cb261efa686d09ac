"""A finite element model, reduced, checked and as modal data."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.near_names import spelling_hint
from flexslew_plant.testbeds.spacecraft.finite_elements.boundary import boundary_rows
from flexslew_plant.testbeds.spacecraft.finite_elements.checks import (
    doubts,
    require_matrices,
    require_rigid,
)
from flexslew_plant.testbeds.spacecraft.finite_elements.clamped_modes import clamped_modes
from flexslew_plant.testbeds.spacecraft.finite_elements.modal_content import modal_content
from flexslew_plant.testbeds.spacecraft.finite_elements.model import (
    MODEL_UNITS,
    FiniteElementModel,
)
from flexslew_plant.testbeds.spacecraft.finite_elements.readers import (
    MODES,
    contents_of,
    read_model,
)
from flexslew_plant.testbeds.spacecraft.finite_elements.reduction import Reduction, reduce_model


class ImportOptions(NamedTuple):
    """How a finite element model is reduced.

    Args:
        boundary: entries of `boundary_rows`.
        modes: how many are kept.
        units: of the model, a key of MODEL_UNITS.
        origin: place of the hinge in the axes and units of the model; None: the centre of the
            boundary's nodes.
        tip: number of the node that is reported as the tip; None: the farthest.
        damping: ratio of all modes; None: that of the model's damping matrix, or none.
    """

    boundary: tuple[str, ...] = ()
    modes: int = 8
    units: str = "si"
    origin: tuple[float, float, float] | None = None
    tip: int | None = None
    damping: float | None = None


@dataclass(frozen=True)
class ImportedModel:
    """A reduced model.

    Args:
        model: in SI.
        reduction: its clamped modes.
        content: modal data by key, see `modal_file`.
        doubts: what may be wrong, a sentence each.
    """

    model: FiniteElementModel
    reduction: Reduction
    content: dict[str, Any]
    doubts: list[str]


def import_model(path: Path, options: ImportOptions) -> ImportedModel:
    """Return the reduction of a finite element model.

    Raises:
        BadInput: the file is not a model, an option does not fit it, or it fails a check.
    """
    return _imported(path, tuple(contents_of(path).items()), options)


@lru_cache(maxsize=4)
def _imported(
    path: Path, contents: tuple[tuple[str, bytes], ...], options: ImportOptions
) -> ImportedModel:
    """Return the reduction of files with this content: the same in every trial of a study."""
    if options.units not in MODEL_UNITS:
        words = f"{spelling_hint(options.units, MODEL_UNITS)}allowed: {', '.join(MODEL_UNITS)}"
        raise BadInput(words, path, "units", options.units)
    units = MODEL_UNITS[options.units]
    origin = None if options.origin is None else np.array(options.origin) * units.length
    if path.suffix.lower() == MODES[0]:
        if options.boundary:
            words = "the modes of this file are clamped already: leave it out"
            raise BadInput(words, path, "boundary", ",".join(options.boundary))
        model, reduction, found = clamped_modes(path, dict(contents), units, options.modes, origin)
    else:
        found = []
        given = read_model(path, dict(contents))
        require_matrices(given, path)
        boundary = boundary_rows(given, options.boundary, path)
        model = given.in_si(units, boundary)
        if origin is not None and model.nodes is None:
            raise BadInput("the file has no nodes: the interface is its origin", path, "origin")
        reduction = reduce_model(model, boundary, options.modes, origin, path)
    rigid = require_rigid(reduction, path)
    size = None if model.nodes is None else float(np.ptp(model.nodes, axis=0).max())
    content = modal_content(model, reduction, rigid, _ratios(reduction, options, path),
                            _tip(model, options.tip, path))  # fmt: skip
    found += doubts(reduction, size)
    if model.unused:
        found.append(f"variables that are not used: {', '.join(model.unused):.200}")
    return ImportedModel(model, reduction, content, found)


def _ratios(reduction: Reduction, options: ImportOptions, path: Path) -> Vector | None:
    """Return the damping ratios of the modes, shape (m,); None: no damping."""
    if options.damping is not None:
        return np.full(len(reduction.frequencies), options.damping)
    if reduction.damping is None:
        return None
    ratios: Vector = np.diag(reduction.damping) / (2.0 * reduction.frequencies)
    if not ((ratios >= 0.0) & (ratios < 1.0)).all():
        words = f"gives damping ratios from {ratios.min():.3g} to {ratios.max():.3g}, not in 0 to 1"
        raise BadInput(words, path, "C")
    return ratios


def _tip(model: FiniteElementModel, number: int | None, path: Path) -> int | None:
    """Return the index of the node with this number."""
    if number is None:
        return None
    if model.nodes is None:
        raise BadInput("the file has no nodes", path, "tip", number)
    found = np.flatnonzero(model.numbers == number)
    if not len(found):
        words = f"a node from {model.numbers.min()} to {model.numbers.max()}"
        raise BadInput(words, path, "tip", number)
    return int(found[0])
