"""Clamped modes that a finite element program computed, with the masses that belong to them.

Without the mass matrix, the coupling of modes and interface is that of the participation factors,
and the rigid-body sums are those of the elements. Nodes get equal shares of their elements' masses,
which counts in second order, and for the drawing.
"""

from pathlib import Path

import numpy as np
from scipy.sparse import csc_array, diags_array

from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.spacecraft.finite_elements.model import FiniteElementModel
from flexslew_plant.testbeds.spacecraft.finite_elements.readers import MODES
from flexslew_plant.testbeds.spacecraft.finite_elements.readers.dat import MassTables, dat_tables
from flexslew_plant.testbeds.spacecraft.finite_elements.readers.frd import ModeShapes, frd_modes
from flexslew_plant.testbeds.spacecraft.finite_elements.reduction import Reduction
from flexslew_plant.testbeds.spacecraft.units import Units

_SAME = 1e-4  # of a frequency, by which the two files may differ
_STILL = 1e-9  # of the largest displacement, of a node that the boundary holds
_MODAL_MASS = (0.4, 2.5)  # of a mode by the nodes' shares; 1 by the mass matrix
_EXCESS = 1e-2  # of effective masses over the structure's own, which is rounding
_HELD_MASS = 0.02  # share of the mass at the boundary's nodes, which participation factors lack


def clamped_modes(
    path: Path, contents: dict[str, bytes], units: Units, modes: int, origin: Vector | None
) -> tuple[FiniteElementModel, Reduction, list[str]]:
    """Return modes of CalculiX as a model of lumped masses and its reduction, in SI, and doubts.

    Args:
        path: of the .frd.
        contents: of .frd and .dat.
        units: of their numbers.
        modes: how many are kept, at most those of the files.
        origin: of the interface in the axes of the model, shape (3,) [m]; None: the centre of the
            nodes that no mode moves.

    Raises:
        BadInput: a file is damaged, the two do not belong together, or nothing is clamped.
    """
    table_path = path.with_suffix(MODES[1])
    shapes = frd_modes(contents[MODES[0]], path)
    tables = dat_tables(contents[MODES[1]], table_path)
    lumps = _lumps(shapes, tables, path)
    _require_one_run(shapes, tables, lumps, path)
    held = np.abs(shapes.shapes).max(axis=(1, 2)) <= _STILL * np.abs(shapes.shapes).max()
    if origin is None and not held.any():
        raise BadInput("every node moves: give the place of the hinge", path, "origin")
    place = shapes.nodes[held].mean(axis=0) if origin is None else origin / units.length
    kept = min(modes, len(tables.frequencies))
    found = []
    if kept < modes:
        found.append(f"the file has {kept} modes, {modes} are requested")
    share = 1.0 - float(tables.total[:3].max()) / tables.mass
    if share > _HELD_MASS:
        found.append(
            f"{share:.1%} of the mass is at the clamped nodes, whose coupling to the modes the "
            ".dat leaves out: refine the mesh there, or import stored matrices"
        )
    count = len(shapes.numbers)
    rows = np.arange(3 * count, dtype=np.int64)
    model = FiniteElementModel(
        csc_array(diags_array(np.repeat(lumps * units.mass, 3))),
        csc_array((3 * count, 3 * count)),
        nodes=shapes.nodes * units.length,
        numbers=shapes.numbers,
        node=rows // 3,
        direction=rows % 3,
    )
    return model, _reduction(shapes, tables, place, kept, units), found


def _reduction(
    shapes: ModeShapes, tables: MassTables, place: Vector, kept: int, units: Units
) -> Reduction:
    """Return the slowest modes about a place in the units of the files, in SI."""
    forces, torques = tables.participation[:3, :kept], tables.participation[3:, :kept]
    torques = torques - np.cross(place, forces, axis=0)
    centre = tables.centre - place
    off = np.outer(place, tables.centre)
    second = tables.second + tables.mass * (np.outer(place, place) - off - off.T)
    moment = tables.mass * np.cross(np.eye(3), centre)  # [c]x
    rigid = np.block(
        [
            [tables.mass * np.eye(3), moment.T],
            [moment, np.trace(second) * np.eye(3) - second],
        ]
    )
    scale = np.array([1.0] * 3 + [units.length] * 3)
    root = np.sqrt(units.mass)
    return Reduction(
        place * units.length,
        tables.frequencies[:kept],
        shapes.shapes[..., :kept].reshape(-1, kept) / root,
        root * scale[:, None] * np.vstack((forces, torques)),
        units.mass * np.outer(scale, scale) * rigid,
        np.zeros((6, 6)),
        None,
        None,
        None,
    )


def _lumps(shapes: ModeShapes, tables: MassTables, path: Path) -> Vector:
    """Return the mass of each node, shape (k,): equal shares of its elements'."""
    lumps = np.zeros(len(shapes.numbers))
    for element, nodes in shapes.elements.items():
        if element not in tables.masses:
            raise BadInput(f"element {element} has no mass in the .dat: print EMAS of all", path)
        at = np.searchsorted(shapes.numbers, nodes)
        if not nodes or (at >= len(lumps)).any() or (shapes.numbers[at] != nodes).any():
            raise BadInput(f"element {element} has a node without a place", path)
        np.add.at(lumps, at, tables.masses[element] / len(nodes))
    if not (tables.mass > 0.0 and (lumps >= 0.0).all()):
        raise BadInput("a mass is not positive", path.with_suffix(MODES[1]))
    if abs(lumps.sum() / tables.mass - 1.0) > _EXCESS:
        words = f"its elements weigh {lumps.sum():.6g}, those of the .dat {tables.mass:.6g}"
        raise BadInput(words, path)
    return lumps


def _require_one_run(shapes: ModeShapes, tables: MassTables, lumps: Vector, path: Path) -> None:
    """Refuse files of two runs, modes of a structure that floats, and masses of another one."""
    cycles = tables.frequencies / (2.0 * np.pi)
    if not (cycles > 0.0).all():
        words = "a frequency is 0: the structure floats; clamp its hinge with *BOUNDARY"
        raise BadInput(words, path.with_suffix(MODES[1]))
    if len(cycles) != len(shapes.frequencies) or not np.allclose(
        cycles, shapes.frequencies, rtol=_SAME
    ):
        raise BadInput("has not the frequencies of the .dat: they are of two runs", path)
    if (np.diff(cycles) < 0.0).any():
        raise BadInput("the frequencies do not rise", path)
    masses = np.einsum("i,ijm,ijm->m", lumps, shapes.shapes, shapes.shapes)
    if not ((masses > _MODAL_MASS[0]) & (masses < _MODAL_MASS[1])).all():
        worst = int(np.abs(np.log(np.maximum(masses, 1e-30))).argmax())
        words = f"mode {worst + 1} has a modal mass of {masses[worst]:.3g}, not 1"
        raise BadInput(f"{words}: shapes and masses do not belong together", path)
    forces = np.einsum("i,ijm->jm", lumps, shapes.shapes)
    largest = np.abs(tables.participation[:3]).argmax(axis=0)
    pairs = np.take_along_axis(np.stack((forces, tables.participation[:3])), largest[None, None], 1)
    opposed = pairs[0, 0] * pairs[1, 0] < -0.01 * tables.mass
    if opposed.any():
        words = f"mode {int(opposed.argmax()) + 1} moves against its participation factor"
        raise BadInput(f"{words}: the files are of two runs", path)
    diagonal = np.concatenate(
        (np.full(3, tables.mass), np.trace(tables.second) - np.diag(tables.second))
    )
    effective = np.maximum((tables.participation**2).sum(axis=1), tables.total)
    if (effective > diagonal + _EXCESS * diagonal.max()).any() or np.linalg.eigvalsh(
        tables.second - tables.mass * np.outer(tables.centre, tables.centre)
    ).min() < -_EXCESS * float(np.trace(tables.second)):
        words = "its effective masses exceed the mass and the inertia of its elements"
        raise BadInput(words, path.with_suffix(MODES[1]))
