"""Craig-Bampton reduction to a rigid interface: clamped modes and what they do to it.

The boundary moves as one rigid body, by r = (displacement, rotation) of the interface. Then
u = R r + Phi q with K R = 0, and the reduced matrices are
    [[R^T M R, R^T M Phi], [., 1]]  and  [[0, 0], [0, omega^2]]
(R. R. Craig and M. C. C. Bampton, Coupling of substructures for dynamic analyses, AIAA Journal 6,
1968, with constraint modes that a rigid interface makes rigid-body vectors).
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.linalg import LinAlgError, eigh
from scipy.sparse import csc_array
from scipy.sparse.linalg import (
    ArpackError,
    LinearOperator,
    SuperLU,
    eigsh,
    onenormest,
    splu,
)
from scipy.sparse.linalg import norm as sparse_norm

from flexslew_plant.arrays import Indices, Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.spacecraft.finite_elements.model import FiniteElementModel

_DENSE = 600  # degrees of freedom up to which all modes are computed at once
_SINGULAR = 1e-13  # a pivot over its entry of the diagonal, at which a stiffness is singular
_INTERFACE = 6  # degrees of freedom of a rigid interface


@dataclass(frozen=True)
class Reduction:
    """Clamped modes of modal mass 1, in SI.

    Args:
        origin: place of the interface in the axes of the model, shape (3,) [m].
        frequencies: shape (m,) [rad/s].
        shapes: Phi, zero at the boundary, shape (n, m) [1/sqrt(kg)].
        participation: R^T M Phi, three forces, then three torques, shape (6, m).
        rigid: R^T M R, shape (6, 6) [kg, kg m, kg m^2].
        strain: R^T K R, which is zero where nothing but the boundary holds the model, (6, 6).
        damping: Phi^T C Phi, shape (m, m) [1/s]; None: the model has no damping.
        condition: estimate of the condition of the clamped stiffness, in the 1-norm [-]; None:
            the modes were computed by another program.
        residual: largest |K phi - omega^2 M phi| / |K phi| of the modes [-]; likewise.
    """

    origin: Vector
    frequencies: Vector
    shapes: Matrix
    participation: Matrix
    rigid: Matrix
    strain: Matrix
    damping: Matrix | None
    condition: float | None
    residual: float | None

    @property
    def effective_mass(self) -> Matrix:
        """Share of each mode in the diagonal of the rigid matrix, shape (6, m) [-]."""
        diagonal = np.diag(self.rigid)
        shares: Matrix = self.participation**2 / np.where(diagonal > 0.0, diagonal, np.inf)[:, None]
        return shares


def reduce_model(
    model: FiniteElementModel, boundary: Indices, modes: int, origin: Vector | None, path: Path
) -> Reduction:
    """Return the slowest clamped modes of a model in SI.

    Args:
        model: in SI.
        boundary: rows of the rigid interface.
        modes: how many.
        origin: of the interface in the axes of the model, shape (3,) [m]; None: the centre of the
            boundary's nodes.
        path: for an error.

    Raises:
        BadInput: there are fewer modes, the clamped model is not stiff, or nothing tells how
            the interface moves it.
    """
    free = np.setdiff1d(np.arange(model.size), boundary)
    mass, stiffness = (csc_array(matrix[free][:, free]) for matrix in (model.mass, model.stiffness))
    factors = _factors(stiffness, path)
    squares, inner = _modes(mass, stiffness, factors, modes, path)
    shapes = np.zeros((model.size, modes))
    shapes[free] = inner
    if model.nodes is None:
        place = np.zeros(3)
        rigid_vectors = _rigid_vectors(model, boundary, free, factors, path)
    else:
        assert model.node is not None
        place = model.nodes[np.unique(model.node[boundary])].mean(axis=0)
        place = place if origin is None else origin
        rigid_vectors = model.rigid_vectors(place)
    carried = model.mass @ rigid_vectors
    force = stiffness @ inner
    off = np.linalg.norm(force - mass @ inner * squares, axis=0) / np.linalg.norm(force, axis=0)
    return Reduction(
        place,
        np.sqrt(squares),
        shapes,
        carried.T @ shapes,
        rigid_vectors.T @ carried,
        rigid_vectors.T @ (model.stiffness @ rigid_vectors),
        None if model.damping is None else shapes.T @ (model.damping @ shapes),
        _condition(stiffness, factors),
        float(off.max()),
    )


def symmetric_factors(matrix: csc_array) -> SuperLU:
    """Return the factors of a symmetric matrix, pivots on its diagonal where they can be.

    Raises:
        RuntimeError, ValueError: it is singular, or holds what is no number.
    """
    return splu(
        matrix,
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )


def _factors(stiffness: csc_array, path: Path) -> SuperLU:
    """Return the factors of the clamped stiffness, which must be positive definite."""
    refused = "with the boundary clamped, the stiffness is {}: something is not held by the "
    refused += "boundary, or not connected; clamp more nodes or repair the model"
    try:
        factors = symmetric_factors(stiffness)
    except (RuntimeError, ValueError):
        raise BadInput(refused.format("singular"), path) from None
    pivots = factors.U.diagonal()
    if (factors.perm_r == factors.perm_c).all() and not (pivots > 0.0).all():
        words = f"not positive definite ({int((pivots <= 0.0).sum())} negative eigenvalues)"
        raise BadInput(refused.format(words), path)
    if (abs(pivots[factors.perm_c]) < _SINGULAR * stiffness.diagonal()).any():
        raise BadInput(refused.format("singular"), path)
    return factors


def _modes(
    mass: csc_array, stiffness: csc_array, factors: SuperLU, modes: int, path: Path
) -> tuple[Vector, Matrix]:
    """Return omega^2, ascending, shape (m,), and modes of modal mass 1, shape (n, m)."""
    n = mass.shape[0]
    inverse: Vector  # 1 / omega^2: accurate where omega is small, and massless rows are allowed
    if not 1 <= modes <= n:
        raise BadInput(f"1 to {n}, the clamped model's", path, "modes", modes)
    try:
        if n <= _DENSE or modes > n - 2:
            inverse, vectors = eigh(
                mass.toarray(), stiffness.toarray(), subset_by_index=[n - modes, n - 1]
            )
        else:
            operator = LinearOperator((n, n), matvec=factors.solve, dtype=float)
            inverse, vectors = eigsh(
                mass, modes, M=stiffness, Minv=operator, which="LA", v0=np.ones(n)
            )
    except (LinAlgError, ArpackError) as error:
        raise BadInput(f"its clamped modes cannot be computed: {error}", path) from None
    order = np.argsort(inverse)[::-1]
    inverse, vectors = inverse[order], vectors[:, order]
    massive = int((inverse > 1e-13 * inverse[0]).sum()) if inverse[0] > 0.0 else 0
    if not massive:
        raise BadInput("what the boundary does not clamp has no mass", path, "M")
    if massive < modes:
        words = f"1 to {massive}: the other clamped degrees of freedom have no mass"
        raise BadInput(words, path, "modes", modes)
    vectors = vectors / np.sqrt(np.einsum("in,in->n", vectors, mass @ vectors))
    largest = abs(vectors).argmax(axis=0)
    return 1.0 / inverse, vectors * np.sign(vectors[largest, np.arange(modes)])


def _rigid_vectors(
    model: FiniteElementModel, boundary: Indices, free: Indices, factors: SuperLU, path: Path
) -> Matrix:
    """Return the vectors by which six boundary rows move the model: R = [1; -K_ff^-1 K_fb]."""
    if len(boundary) != _INTERFACE:
        words = (
            f"it has {len(boundary)} rows; without nodes it must have 6: displacements along, then "
            "rotations about x, y, z of the interface; give the matrices `nodes` and `dof`, or "
            "tie the boundary to one node by a rigid element"
        )
        raise BadInput(words, path, "boundary")
    vectors = np.zeros((model.size, _INTERFACE))
    vectors[boundary] = np.eye(_INTERFACE)
    coupling = model.stiffness[free][:, boundary].toarray()
    vectors[free] = -factors.solve(coupling)
    return vectors


def _condition(stiffness: csc_array, factors: SuperLU) -> float:
    """Return an estimate of the condition number in the 1-norm."""
    n = stiffness.shape[0]

    def solve(right: Vector) -> Vector:
        return factors.solve(np.ascontiguousarray(right))

    inverse = LinearOperator(
        (n, n), matvec=solve, rmatvec=solve, matmat=solve, rmatmat=solve, dtype=float
    )
    size = onenormest(inverse) if n > 4 else np.linalg.norm(solve(np.eye(n)), 1)
    return float(sparse_norm(stiffness, 1) * size)
