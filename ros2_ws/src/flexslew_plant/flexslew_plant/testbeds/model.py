"""A testbed's equations of motion as one object: the mathematics that planners and laws share."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigvals

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds import dynamics


@dataclass(frozen=True)
class Linearisation:
    """M x'' + D x' + K x = B u about a rest, in the deviations of the coordinates (14), (15)."""

    mass: Matrix  # (n, n)
    damping: Matrix  # (n, n)
    stiffness: Matrix  # (n, n)
    input_matrix: Matrix  # (n, joints)

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
        """Return the loop closed by collocated PD (12), (13): K and D gain the joint gains."""
        b = self.input_matrix
        return Linearisation(
            self.mass,
            self.damping + b @ np.diag(kd) @ b.T,
            self.stiffness + b @ np.diag(kp) @ b.T,
            b,
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


@dataclass(frozen=True)
class Model:
    """M(q) a + h(q, v) = B u, with q the joints and then the modal coordinates.

    Args:
        kind: which kernels to use.
        packed: the numbers that they read.
        joint_names: one a joint, in the order of the effort.
        joint_units: rad or m, one a joint.
        modes: how many modal coordinates.
    """

    kind: int
    packed: Vector
    joint_names: tuple[str, ...]
    joint_units: tuple[str, ...]
    modes: int

    @cached_property
    def joints(self) -> int:
        """How many joints, each with one effort."""
        return len(self.joint_names)

    @cached_property
    def coordinates(self) -> int:
        """n, joints and modes together."""
        return self.joints + self.modes

    @property
    def input_matrix(self) -> Matrix:
        """B, shape (n, joints)."""
        return np.eye(self.coordinates, self.joints)

    def _terms(self, q: Vector, v: Vector) -> tuple[Matrix, Vector]:
        m, n = self.joints, self.coordinates
        joints, coupling, modal = np.empty((m, m)), np.empty((m, n - m)), np.empty(n - m)
        bias = np.empty(n)
        x = np.concatenate((q, v))
        dynamics.terms(self.kind, self.packed, x, joints, coupling, modal, bias)
        return np.block([[joints, coupling], [coupling.T, np.diag(modal)]]), bias

    def mass_matrix(self, q: Vector) -> Matrix:
        """Return M(q), shape (n, n), symmetric positive definite."""
        return self._terms(q, np.zeros_like(q))[0]

    def bias(self, q: Vector, v: Vector) -> Vector:
        """Return h(q, v): centrifugal, Coriolis, elastic and damping terms, shape (n,)."""
        return self._terms(q, v)[1]

    def derivative(self, x: Vector, effort: Vector) -> Vector:
        """Return f(x, u), shape (2 n,), for the state x = [q, v]."""
        return dynamics.derivative(self.kind, self.packed, x, effort)

    def advance(self, x: Vector, effort: Vector, dt: float, steps: int = 1) -> Vector:
        """Return the state dt later with the effort held (order 8, `steps` equal steps)."""
        after = x.copy()
        self._stepper(self.packed, effort, dt, steps, after)
        return after

    @cached_property
    def _stepper(self) -> dynamics.Stepper:
        return dynamics.stepper(self.kind, self.coordinates, self.joints)

    def jacobian(self, x: Vector, effort: Vector) -> tuple[Matrix, Matrix]:
        """Return df/dx, shape (2 n, 2 n), and df/du, shape (2 n, joints), exact."""
        dx, du = np.empty((x.size, x.size)), np.empty((x.size, self.joints))
        dynamics.jacobian(self.kind, self.packed, x, effort, dx, du)
        return dx, du

    def kinetic_energy(self, x: Vector) -> float:
        """Return T = v^T M(q) v / 2 [J]."""
        q, v = np.split(x, 2)
        return float(0.5 * v @ self.mass_matrix(q) @ v)

    def energy(self, x: Vector) -> float:
        """Return T + U [J], constant without effort and damping."""
        return self.kinetic_energy(x) + dynamics.potential(
            self.kind, self.packed, x[: self.coordinates]
        )

    def momentum(self, x: Vector) -> Vector:
        """Return dT/dv = M(q) v, shape (n,); its first entry is conserved without yaw torque."""
        q, v = np.split(x, 2)
        return self.mass_matrix(q) @ v

    def linearise(self, q: Vector) -> Linearisation:
        """Return the small motions about the rest at q (14), (15).

        Args:
            q: set point with straight beams, shape (n,).
        """
        n = self.coordinates
        zero = np.zeros(n)
        stiffness, damping = np.empty((n, n)), np.empty((n, n))
        rest = np.concatenate((q, zero))
        dynamics.residual_jacobian(self.kind, self.packed, rest, zero, stiffness, damping)
        return Linearisation(self.mass_matrix(q), damping, stiffness, self.input_matrix)
