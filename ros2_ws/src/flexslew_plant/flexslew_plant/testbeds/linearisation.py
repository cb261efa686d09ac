"""Small motions of a testbed about a rest."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigvals

from flexslew_plant.arrays import Matrix, Vector


@dataclass(frozen=True)
class Linearisation:
    """M x'' + D x' + K x = B u about a rest (Gorinevsky and Vukovich 1998, (14), (15))."""

    mass: Matrix  # (n, n)
    damping: Matrix  # (n, n)
    stiffness: Matrix  # (n, n)
    input_matrix: Matrix  # (n, joints)
    # rows that read the joints, (joints, n); None: the transpose of B, of efforts in the joints
    reading: Matrix | None = field(default=None, kw_only=True)

    @property
    def state_matrix(self) -> Matrix:
        """A of x' = A x + B u with x = [q, v], shape (2 n, 2 n)."""
        n = len(self.mass)
        lower = -np.linalg.solve(self.mass, np.hstack((self.stiffness, self.damping)))
        return np.vstack((np.hstack((np.zeros((n, n)), np.eye(n))), lower))

    @property
    def state_input_matrix(self) -> Matrix:
        """B of x' = A x + B u, shape (2 n, joints)."""
        return np.vstack(
            (np.zeros_like(self.input_matrix), np.linalg.solve(self.mass, self.input_matrix))
        )

    def with_feedback(self, kp: Vector, kd: Vector) -> "Linearisation":
        """Return the loop closed by PD of the joints (12), (13): Kp added to K, Kd to D."""
        b = self.input_matrix
        c = b.T if self.reading is None else self.reading
        return Linearisation(
            self.mass,
            self.damping + b @ np.diag(kd) @ c,
            self.stiffness + b @ np.diag(kp) @ c,
            b,
            reading=self.reading,
        )

    @property
    def eigenvalues(self) -> NDArray[np.complex128]:
        """Poles of x' = A x, shape (2 n,) [1/s]."""
        return np.asarray(eigvals(self.state_matrix), dtype=np.complex128)

    @property
    def frequencies(self) -> Vector:
        """Natural frequencies without the rigid motions, rising [rad/s]."""
        squares = np.sort(eigvals(self.stiffness, self.mass).real)
        return np.asarray(np.sqrt(squares[squares > 1e-9 * abs(squares).max()]))
