"""Checks of a finite element model and of its reduction."""

from pathlib import Path

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csc_array, diags_array

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.spacecraft.finite_elements.model import FiniteElementModel
from flexslew_plant.testbeds.spacecraft.finite_elements.reduction import (
    Reduction,
    symmetric_factors,
)

LARGEST = 300_000  # degrees of freedom
_SYMMETRIC = 1e-6  # of the largest entry of a row or of its column
_NEGATIVE = 1e-9  # of the diagonal, a negative eigenvalue of the mass matrix that is rounding
_HELD = 0.1  # frequency of a rigid motion, of the first mode's, of a model that does not float
_STRAINED = 0.03  # likewise, of one that may have too few digits
_ISOTROPIC = 1e-4  # of the mass, by which its three directions may differ
_ROUNDING = 1e-12  # of the largest entry of a matrix, or of the mass (in kg m)
_ILL = 1e13  # condition of a stiffness at which frequencies lose their digits
_RESIDUAL = 1e-5  # of a mode, likewise
_SIZES = (1e-2, 2e2)  # of an appendage [m]
_DENSITIES = (1e-4, 2.5e4)  # mass over the cube of its size [kg/m^3]; osmium has 22590


def require_matrices(model: FiniteElementModel, path: Path) -> None:
    """Refuse matrices that no structure has.

    Raises:
        BadInput: one is not finite, not symmetric, or the mass matrix is not positive semidefinite.
    """
    given = {"M": model.mass, "K": model.stiffness, "C": model.damping}
    for name, matrix in given.items():
        if matrix is None:
            continue
        if not np.isfinite(matrix.data).all():
            raise BadInput("holds a number that is not finite", path, name)
        _require_symmetric(matrix, name, path)
    for name, matrix in (("M", model.mass), ("K", model.stiffness)):
        diagonal = matrix.diagonal()
        if diagonal.min() < -_ROUNDING * diagonal.max():
            words = f"entry {int(diagonal.argmin()) + 1} of its diagonal is negative"
            raise BadInput(words, path, name, float(diagonal.min()))
        if not diagonal.max() > 0.0:
            raise BadInput("it is zero", path, name)
    if not _is_positive_semidefinite(model.mass):
        raise BadInput(
            "it is not positive semidefinite: some motion has negative energy", path, "M"
        )


def _require_symmetric(matrix: csc_array, name: str, path: Path) -> None:
    off = abs(matrix - matrix.T).tocoo()
    if not off.nnz:
        return
    size = abs(matrix).max(axis=1).toarray().ravel()
    allowed = _SYMMETRIC * np.maximum(size[off.row], size[off.col]) + _ROUNDING * size.max()
    worst = int((off.data - allowed).argmax())
    if off.data[worst] > allowed[worst]:
        i, j = int(off.row[worst]), int(off.col[worst])
        raise BadInput(
            f"it is not symmetric: entry ({i + 1}, {j + 1}) is {matrix[i, j]:.6g}, entry "
            f"({j + 1}, {i + 1}) is {matrix[j, i]:.6g}",
            path,
            name,
        )


def _is_positive_semidefinite(mass: csc_array) -> bool:
    """Return whether no eigenvalue is below zero by more than rounding, from the pivots' signs."""
    diagonal = mass.diagonal()
    scale = diags_array(1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)))
    shifted = csc_array(scale @ mass @ scale + _NEGATIVE * diags_array(np.ones(len(diagonal))))
    try:
        factors = symmetric_factors(shifted)
    except (RuntimeError, ValueError):
        return False
    return bool((factors.U.diagonal() > 0.0).all() and (factors.perm_r == factors.perm_c).all())


def rigid_frequencies(reduction: Reduction) -> Vector:
    """Return the frequencies of the six rigid motions, ascending: 0 of a structure that floats.

    They are relative to the first clamped mode's.
    """
    rigid, strain = _scaled(reduction)
    energies = eigh(0.5 * (strain + strain.T), rigid, eigvals_only=True)
    relative: Vector = np.sqrt(np.maximum(energies, 0.0)) / reduction.frequencies[0]
    return relative


def rigid_body_modes(reduction: Reduction) -> int:
    """Return the number of rigid motions that hardly strain the model: 6 if it floats."""
    return int((rigid_frequencies(reduction) < _HELD).sum())


def _scaled(reduction: Reduction) -> tuple[Matrix, Matrix]:
    """Return mass and strain of the six rigid motions, rotations by a length of the order of 1."""
    diagonal = np.diag(reduction.rigid)
    scale = 1.0 / np.sqrt(np.where(diagonal > 1e-12 * diagonal.max(), diagonal, 1.0))
    outer = np.outer(scale, scale)
    return reduction.rigid * outer + 1e-9 * np.eye(6), reduction.strain * outer


def require_rigid(reduction: Reduction, path: Path) -> tuple[float, Vector, Matrix]:
    """Return mass, first moment, shape (3,), and inertia about the interface, shape (3, 3).

    Raises:
        BadInput: the model is held by more than its boundary, or its mass differs by direction.
    """
    masses = np.diag(reduction.rigid)[:3]
    mass = float(masses.mean())
    found = ", ".join(f"{m:.6g}" for m in masses)
    if not mass > 0.0:
        raise BadInput("the model weighs nothing", path, "M")
    if np.ptp(masses) > _ISOTROPIC * mass:
        words = (
            f"the model weighs {found} kg along x, y, z, which must agree: it lacks displacements "
            "in a direction, or rows of supports were removed; write the matrices of the model "
            "without supports, with all three displacements"
        )
        raise BadInput(words, path, "M")
    count = rigid_body_modes(reduction)
    if count < 6:
        words = (
            f"it has {count} rigid-body modes, not 6: something besides the boundary holds the "
            "model, or a place or a direction of a node is wrong; write the matrices without "
            "supports, and check nodes and units"
        )
        raise BadInput(words, path, "K")
    moment = reduction.rigid[3:, :3]
    first = 0.5 * np.array(
        [moment[2, 1] - moment[1, 2], moment[0, 2] - moment[2, 0], moment[1, 0] - moment[0, 1]]
    )
    inertia = 0.5 * (reduction.rigid[3:, 3:] + reduction.rigid[3:, 3:].T)
    return mass, _rounded(first, mass), _rounded(inertia, float(inertia.max()))


def _rounded(values: Vector, size: float) -> Vector:
    """Return numbers of which those that are rounding errors are zero."""
    rounded: Vector = np.where(abs(values) < _ROUNDING * size, 0.0, values)
    return rounded


def doubts(reduction: Reduction, size: float | None) -> list[str]:
    """Return what may be wrong with a reduction, a sentence each.

    Args:
        reduction: in SI.
        size: largest extent of the nodes [m]; None: unknown.
    """
    found = []
    mass = float(reduction.rigid[0, 0])
    if size is None:  # twice the radius of gyration
        size = 2.0 * float(np.sqrt(np.trace(reduction.rigid[3:, 3:]) / (2.0 * mass)))
    density = mass / size**3 if size > 0.0 else 0.0
    if not (_SIZES[0] < size < _SIZES[1] and _DENSITIES[0] < density < _DENSITIES[1]):
        found.append(
            f"{mass:.4g} kg in {size:.4g} m with a first mode at "
            f"{reduction.frequencies[0] / (2.0 * np.pi):.4g} Hz is not likely: give the units of "
            "the model (--units, or the key units), as mm_t_s"
        )
    strained = float(rigid_frequencies(reduction)[-1])
    if strained > _STRAINED:
        found.append(
            f"a rigid motion has {strained:.2g} of the first frequency, where 0 is due: the "
            "matrices have too few digits, or a weak support is left in them"
        )
    if reduction.condition is not None and reduction.condition > _ILL:
        found.append(
            f"the clamped stiffness has a condition of {reduction.condition:.1e}: the frequencies "
            "lose digits; look for parts that are far too stiff or hardly held"
        )
    if reduction.residual is not None and reduction.residual > _RESIDUAL:
        found.append(
            f"the modes have a residual of {reduction.residual:.1e}: they are not accurate"
        )
    if reduction.damping is not None:
        diagonal = np.diag(reduction.damping)
        off = abs(reduction.damping - np.diag(diagonal)).max()
        if off > 0.1 * abs(diagonal).max():
            found.append(
                "the damping couples modes: the part that does, up to "
                f"{off / abs(diagonal).max():.0%} of the largest, is left out"
            )
    return found
