"""Testbeds with appendages that a law models one by one, each clamped to its platform."""

from typing import NamedTuple, Protocol, runtime_checkable

from flexslew_plant.arrays import Matrix, Vector


class Clamped(NamedTuple):
    """An appendage of n modes on a platform, in body axes; joints are those of the bench.

    Args:
        mass, stiffness: diagonals of the modal matrices, shape (n,).
        damping: modal damping matrix, shape (n, n).
        first: where its modes begin among all.
        joints: which joints are torques on it.
        torque_input: Psi^T d of these, shape (n, m).
        tip: Phi of its tip, shape (3, n).
        rows: which tip readings are its displacements and rates.
        tangential: C^T, modal force of minus the platform's angular acceleration, shape (n, 3).
        centrifugal: modal force w^T N_j w of its rate, shape (n, 3, 3).
        torque: platform torque of every joint's effort, shape (3, joints).
        force: platform force of every joint's effort, shape (3, joints).
        total_mass: of the spacecraft [kg].
        first_moment: of the spacecraft about the body origin, shape (3,) [kg m].
        inertia: of the spacecraft about the body origin, shape (3, 3) [kg m^2].
    """

    mass: Vector
    stiffness: Vector
    damping: Matrix
    first: int
    joints: list[int]
    torque_input: Matrix
    tip: Matrix
    rows: list[int]
    tangential: Matrix
    centrifugal: Matrix
    torque: Matrix
    force: Matrix
    total_mass: float
    first_moment: Vector
    inertia: Matrix


@runtime_checkable
class HasClampedAppendages(Protocol):
    """A testbed with appendages that a law may take one by one."""

    def clamped(self, name: str) -> Clamped:
        """Return an appendage clamped to the platform.

        Raises:
            BadInput: there is none of this name, or it is rigid.
        """
