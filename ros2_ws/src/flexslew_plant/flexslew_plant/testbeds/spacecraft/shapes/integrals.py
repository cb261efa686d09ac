"""Inertia integrals of a flexible appendage: all that its equations of motion need.

An appendage is points r_k with masses m_k and displacements u_k = Phi_k q in its own axes. The
kinetic energy is a polynomial in q, with sums over the points, taken once, as coefficients; no
point is visited while the spacecraft flies.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Matrix, Vector

SYMMETRIC_ENTRIES = (
    (0, 0),
    (1, 1),
    (2, 2),
    (0, 1),
    (0, 2),
    (1, 2),
)  # entries of a symmetric matrix, as packed


@dataclass(frozen=True)
class Points:
    """Mass points and what each mode moves them.

    Args:
        place: r_k, undeformed, shape (k, 3) [m].
        mass: m_k, shape (k,) [kg].
        shape: Phi_k, shape (k, 3, n) [-].
        shortening: s_k of the displacement q^T s_k q / 2, symmetric in the modes, shape
            (k, 3, n, n) [1/m].
    """

    place: Matrix
    mass: Vector
    shape: Matrix
    shortening: Matrix

    def extend(self, other: "Points") -> "Points":
        """Return the points of both, which share their modes."""
        return Points(
            np.concatenate((self.place, other.place)),
            np.concatenate((self.mass, other.mass)),
            np.concatenate((self.shape, other.shape)),
            np.concatenate((self.shortening, other.shortening)),
        )


class Shortening(NamedTuple):
    """Sums over the displacements of second order, the geometric stiffness of a moving base.

    `first` is the stiffness per acceleration of all points alike, `second` per acceleration that
    grows with their place.
    """

    first: Matrix  # sum m s_ij, shape (n, n, 3) [kg/m]
    second: Matrix  # sum m r s_ij^T, shape (n, n, 3, 3) [kg]

    @property
    def inertia(self) -> Matrix:
        """What it adds to the moment of inertia's part of second order, shape (n, n, 3, 3)."""
        return inertia_of(self.second + self.second.transpose(0, 1, 3, 2))

    @property
    def rotation(self) -> Matrix:
        """R = sum m r x s_ij, shape (n, n, 3) [kg]."""
        moment = self.second - self.second.transpose(0, 1, 3, 2)
        return np.stack([moment[..., 1, 2], moment[..., 2, 0], moment[..., 0, 1]], axis=-1)

    def seen_from(self, place: Vector, axes: Matrix) -> "Shortening":
        """Return it about another origin, in its axes; see Integrals.seen_from."""
        first = self.first @ axes
        second_moment = np.einsum("ba,ijbc,cd->ijad", axes, self.second, axes)
        return Shortening(first, second_moment + np.einsum("a,ijb->ijab", place, first))

    def select_modes(self, n: list[int]) -> "Shortening":
        """Return it of some modes."""
        return Shortening(self.first[np.ix_(n, n)], self.second[np.ix_(n, n)])


@dataclass(frozen=True)
class Integrals:
    """Sums over the points, with x = r + Phi q.

    Args:
        mass: sum m [kg].
        first: sum m r, shape (3,) [kg m].
        second: sum m r r^T, shape (3, 3) [kg m^2].
        translation: P = sum m Phi, shape (3, n) [kg].
        rotation: H = sum m r x Phi, shape (3, n) [kg m].
        second_1: sum m (r phi_j^T + phi_j r^T), shape (n, 3, 3) [kg m].
        second_2: sum m (phi_i phi_j^T + phi_j phi_i^T), shape (n, n, 3, 3) [kg].
        gyroscopic: G_ij = sum m phi_i x phi_j, shape (n, n, 3) [kg].
        shortening: of second order; none where it is not known or does not count.
    """

    mass: float
    first: Vector
    second: Matrix
    translation: Matrix
    rotation: Matrix
    second_1: Matrix
    second_2: Matrix
    gyroscopic: Matrix
    shortening: Shortening | None = None

    @property
    def modes(self) -> int:
        """N."""
        return int(self.translation.shape[1])

    @property
    def inertia(self) -> Matrix:
        """Inertia of the undeformed appendage about its origin, shape (3, 3) [kg m^2]."""
        return inertia_of(self.second)

    def first_order(self) -> "Integrals":
        """Return these without the terms of second order in q."""
        return replace(
            self,
            second_2=np.zeros_like(self.second_2),
            gyroscopic=np.zeros_like(self.gyroscopic),
            shortening=None,
        )

    def seen_from(self, place: Vector, axes: Matrix) -> "Integrals":
        """Return the integrals about another origin, in its axes.

        Args:
            place: of this origin in the other frame, shape (3,) [m].
            axes: E, direction cosines from the other frame to this one, shape (3, 3).
        """
        r = axes.T
        first, cross_term = r @ self.first, np.outer(place, r @ self.first)
        translation = r @ self.translation
        offset_moment = np.einsum("a,bj->jab", place, translation)
        second_1 = np.einsum("ab,jbc,dc->jad", r, self.second_1, r)
        return Integrals(
            self.mass,
            self.mass * place + first,
            r @ self.second @ r.T + cross_term + cross_term.T + self.mass * np.outer(place, place),
            translation,
            r @ self.rotation + np.cross(place, translation, axisb=0, axisc=0),
            second_1 + offset_moment + offset_moment.transpose(0, 2, 1),
            np.einsum("ab,ijbc,dc->ijad", r, self.second_2, r),
            np.einsum("ab,ijb->ija", r, self.gyroscopic),
            None if self.shortening is None else self.shortening.seen_from(place, axes),
        )


def first_order_integrals(
    mass: float, first: Vector, second: Matrix, translation: Matrix, rotation: Matrix
) -> Integrals:
    """Return sums without those of second order in q, as of a body or by participation factors."""
    n = translation.shape[1]
    return Integrals(
        mass,
        first,
        second,
        translation,
        rotation,
        np.zeros((n, 3, 3)),
        np.zeros((n, n, 3, 3)),
        np.zeros((n, n, 3)),
    )


def inertia_of(second: Matrix) -> Matrix:
    """Return tr(X) 1 - X for second moments X, over the last two indices."""
    trace = np.trace(second, axis1=-2, axis2=-1)
    inertia: Matrix = trace[..., None, None] * np.eye(3) - second
    return inertia


def point_inertia(r: Vector) -> Matrix:
    """Return r.r 1 - r r^T, the inertia of a unit mass at r, shape (3, 3)."""
    inertia: Matrix = r @ r * np.eye(3) - np.outer(r, r)
    return inertia


def second_of(inertia: Matrix) -> Matrix:
    """Return the second moments tr(I)/2 - I of an inertia matrix, shape (3, 3)."""
    moments: Matrix = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    return moments


def integrals_of(points: Points) -> Integrals:
    """Return the sums over mass points."""
    m, r, phi = points.mass, points.place, points.shape
    weighted = m[:, None, None] * phi
    arm = np.einsum("ka,kbj->jab", m[:, None] * r, phi)
    pair = np.einsum("kai,kbj->ijab", weighted, phi)
    axial = np.stack(
        [
            pair[..., 1, 2] - pair[..., 2, 1],
            pair[..., 2, 0] - pair[..., 0, 2],
            pair[..., 0, 1] - pair[..., 1, 0],
        ],
        axis=-1,
    )
    rotation = np.stack(
        [arm[:, 1, 2] - arm[:, 2, 1], arm[:, 2, 0] - arm[:, 0, 2], arm[:, 0, 1] - arm[:, 1, 0]]
    )
    return Integrals(
        float(m.sum()),
        m @ r,
        np.einsum("k,ka,kb->ab", m, r, r),
        weighted.sum(axis=0),
        rotation,
        arm + arm.transpose(0, 2, 1),
        pair + pair.transpose(0, 1, 3, 2),
        axial,
        Shortening(
            np.einsum("k,kaij->ija", m, points.shortening),
            np.einsum("k,ka,kbij->ijab", m, r, points.shortening),
        ),
    )


def rigid_points(
    mass: float,
    place: Vector,
    inertia: Matrix,
    modes_at: Matrix,
    rotation_at: Matrix,
    shortening_at: Matrix,
) -> Points:
    """Return six points that weigh and turn like a rigid body at the end of an appendage.

    They move by Phi q + (Psi q) x d, which stretches the body by the square of its turn; the
    displacement of second order, (Psi q) x ((Psi q) x d) / 2, takes that back.

    Args:
        mass: of the body [kg].
        place: of its centre of mass, undeformed, shape (3,) [m].
        inertia: about its centre of mass, shape (3, 3) [kg m^2].
        modes_at: Phi of its centre, shape (3, n) [-].
        rotation_at: Psi, the turn of each mode, shape (3, n) [rad/m].
        shortening_at: of its centre, shape (3, n, n) [1/m].
    """
    moments, directions = np.linalg.eigh(second_of(inertia))
    # a plate has no moment across itself; rounding must not make it imaginary
    offset_moment = np.sqrt(3.0 * np.maximum(moments, 0.0) / mass) * directions
    offsets = np.concatenate((offset_moment.T, -offset_moment.T))
    shape = modes_at[None] - np.cross(offsets[:, :, None], rotation_at[None], axis=1)
    second_order = np.stack(
        [shortening_at + second_order_rotation(rotation_at, d) for d in offsets]
    )
    return Points(place + offsets, np.full(6, mass / 6.0), shape, second_order)


def second_order_rotation(rotation: Matrix, arm: Vector) -> Matrix:
    """Return (psi_i x (psi_j x d) + psi_j x (psi_i x d)) / 2, shape (3, n, n).

    Args:
        rotation: Psi, shape (3, n).
        arm: d, shape (3,).
    """
    along = arm @ rotation
    one_way = np.einsum("ai,j->aij", rotation, along)
    square: Matrix = 0.5 * (one_way + one_way.transpose(0, 2, 1))
    square -= np.einsum("a,bi,bj->aij", arm, rotation, rotation)
    return square
