"""A finite element model: matrices, nodes, and the node and direction of each row."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, diags_array

from flexslew_plant.arrays import Indices, Matrix, Vector
from flexslew_plant.testbeds.spacecraft.units import FOOT, SLUG, UNITS, Units

INCH = FOOT / 12.0  # [m]
MODEL_UNITS: dict[str, Units] = {
    "si": UNITS["si"],
    "slug_ft_lb": UNITS["slug_ft_lb"],
    "mm_t_s": Units(1e-3, 1e3),
    "in_lbf_s": Units(INCH, SLUG * FOOT / INCH),
}


@dataclass(frozen=True)
class FiniteElementModel:
    """Matrices of n degrees of freedom, of a structure that nothing holds.

    Args:
        mass: M, shape (n, n).
        stiffness: K, shape (n, n).
        damping: shape (n, n); None: the model has none.
        nodes: places of the nodes, shape (k, 3); None: unknown.
        numbers: of the nodes in the file, shape (k,).
        node: index of the node of each row, shape (n,); None: unknown.
        direction: of each row: 0 to 2 displacement along, 3 to 5 rotation about x, y, z; (n,).
        sets: indices of the nodes of named sets.
        boundary: rows that the file itself names as the boundary; None: it names none.
        unused: names of variables of the file that no model has.
    """

    mass: csc_array
    stiffness: csc_array
    damping: csc_array | None = None
    nodes: Matrix | None = None
    numbers: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    node: Indices | None = None
    direction: Indices | None = None
    sets: dict[str, Indices] = field(default_factory=dict)
    boundary: Indices | None = None
    unused: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Number of degrees of freedom n."""
        return int(self.mass.shape[0])

    def rigid_vectors(self, origin: Vector) -> Matrix:
        """Return unit displacements along and rotations about x, y, z at a place, shape (n, 6).

        Args:
            origin: the place, shape (3,).
        """
        assert self.nodes is not None
        assert self.node is not None
        assert self.direction is not None
        arm = self.nodes[self.node] - origin
        vectors = np.zeros((self.size, 6))
        rows = np.arange(self.size)
        vectors[rows, self.direction] = 1.0
        for axis in range(3):
            turned = np.cross(np.eye(3)[axis], arm)  # e x r
            along = self.direction < 3
            vectors[along, 3 + axis] = turned[rows[along], self.direction[along]]
        return vectors

    def in_si(self, units: Units, boundary: Indices) -> "FiniteElementModel":
        """Return the model in SI.

        Args:
            units: of its numbers.
            boundary: rows of the boundary; without a table of directions the last three of these
                six are rotations.
        """
        if units == UNITS["si"]:
            return self
        if self.direction is None:
            rotation = np.zeros(self.size, dtype=bool)
            rotation[boundary[3:]] = True
        else:
            rotation = self.direction >= 3
        scale = diags_array(1.0 / np.where(rotation, 1.0, units.length))
        energy = units.mass * units.length**2

        def converted(matrix: csc_array) -> csc_array:
            return csc_array(energy * (scale @ matrix @ scale))

        return replace(
            self,
            mass=converted(self.mass),
            stiffness=converted(self.stiffness),
            damping=None if self.damping is None else converted(self.damping),
            nodes=None if self.nodes is None else self.nodes * units.length,
        )


def rows_of_nodes(model: FiniteElementModel, nodes: NDArray[np.integer]) -> Indices:
    """Return the rows of these nodes, given by index, in ascending order."""
    assert model.node is not None
    return np.flatnonzero(np.isin(model.node, nodes)).astype(np.int64)
