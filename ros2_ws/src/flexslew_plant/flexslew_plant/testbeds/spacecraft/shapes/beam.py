"""Clamped beams that bend both ways and twist, with a rigid body at the tip.

Local axes: z along the beam, deflections u along x and v along y, twist about z. A section turns
by (-v', u', twist). Slender sections: their own inertia counts for the twist alone. A beam that
bends does not stretch: its sections move towards the root by int (u'^2 + v'^2) ds / 2.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.linalg import eigh

from flexslew_plant.arrays import Indices, Matrix, Vector
from flexslew_plant.testbeds.beam import ClampedFreeBeam
from flexslew_plant.testbeds.spacecraft.shapes.integrals import (
    Points,
    integrals_of,
    rigid_points,
    second_order_rotation,
)
from flexslew_plant.testbeds.spacecraft.shapes.shape import AppendagePoint, FlexibleShape

DOF = 5  # of a node: u, u', v, v', twist
GAUSS = 4  # points of an element: exact for products of two cubics and for their moments
SUM_POINTS = 4  # points between two of these, for what is summed along the beam
LINE_POINTS = 21  # points along a drawn beam
_MAX_DIRECT_ELEMENTS = 26  # elements up to which K q = omega^2 M q has its digits


@dataclass(frozen=True)
class ClampedBeam:
    """A uniform beam.

    Args:
        length: L [m].
        linear_density: rho A [kg/m].
        stiffness_x, stiffness_y: EI of the deflections u and v [N m^2].
        torsion_stiffness: GJ [N m^2].
        polar_inertia: per length, about the beam's axis [kg m].
    """

    length: float
    linear_density: float
    stiffness_x: float
    stiffness_y: float
    torsion_stiffness: float = 0.0
    polar_inertia: float = 0.0


@dataclass(frozen=True)
class TipBody:
    """A rigid body at the end of a beam.

    Args:
        mass: [kg].
        inertia: about its centre of mass in the beam's axes, shape (3, 3) [kg m^2].
        offset: of its centre of mass from the beam's end, shape (3,) [m].
    """

    mass: float
    inertia: Matrix
    offset: Vector

    def matrices(self) -> tuple[Matrix, Matrix]:
        """Return what the last node's five freedoms move and turn it, each of shape (3, 5)."""
        move, rotation = np.zeros((3, DOF)), np.zeros((3, DOF))
        move[0, 0] = move[1, 2] = 1.0
        rotation[1, 1], rotation[0, 3], rotation[2, 4] = 1.0, -1.0, 1.0
        return move - np.cross(self.offset[:, None], rotation, axis=0), rotation


def _hermite(x: float, h: float, derivative: int) -> Vector:
    """Return the cubic shape functions (w1, w1', w2, w2') of an element at x in 0..1."""
    rows = {
        0: (
            1 - 3 * x**2 + 2 * x**3,
            h * (x - 2 * x**2 + x**3),
            3 * x**2 - 2 * x**3,
            h * x**2 * (x - 1),
        ),
        1: (6 * x * (x - 1), h * (1 - 4 * x + 3 * x**2), 6 * x * (1 - x), h * x * (3 * x - 2)),
        2: (12 * x - 6, h * (6 * x - 4), 6 - 12 * x, h * (6 * x - 2)),
    }
    values: Vector = np.array(rows[derivative], dtype=float) / h**derivative
    return values


@dataclass(frozen=True)
class FiniteElementModes:
    """Modes of a beam by finite elements.

    Args:
        length: of the beam [m].
        nodal: mode shapes at the nodes, the clamped one included, shape (elements + 1, 5, n).
    """

    length: float
    nodal: Matrix

    def _element(self, s: float) -> tuple[int, float, float]:
        elements = len(self.nodal) - 1
        h = self.length / elements
        e = min(int(s / h), elements - 1)
        return e, s / h - e, h

    def point(self, s: float) -> AppendagePoint:
        """Return what the modes do at the distance s from the clamp."""
        e, x, h = self._element(s)
        deflection = self.nodal[e : e + 2, :4]  # (2, 4, n)
        u, v = (deflection[:, k : k + 2].reshape(4, -1) for k in (0, 2))
        twist = (1.0 - x) * self.nodal[e, 4] + x * self.nodal[e + 1, 4]
        n0, n1, n2 = (_hermite(x, h, k) for k in range(3))
        return AppendagePoint(
            np.array([0.0, 0.0, s]),
            np.stack([n0 @ u, n0 @ v, np.zeros_like(twist)]),
            np.stack([-n1 @ v, n1 @ u, twist]),
            np.stack([n2 @ u, n2 @ v, np.zeros_like(twist)]),
        )


def _assemble(beam: ClampedBeam, tip: TipBody | None, elements: int) -> tuple[Matrix, Matrix]:
    """Return the mass and stiffness matrices of the free nodes, shape (5 elements, 5 elements)."""
    h = beam.length / elements
    size = DOF * (elements + 1)
    mass, stiffness = np.zeros((size, size)), np.zeros((size, size))
    x, w = np.polynomial.legendre.leggauss(GAUSS)
    shapes = [(_hermite((1 + a) / 2, h, 0), _hermite((1 + a) / 2, h, 2)) for a in x]
    bending_mass = sum(b * h / 2 * np.outer(n, n) for b, (n, _) in zip(w, shapes, strict=True))
    bending = sum(b * h / 2 * np.outer(n, n) for b, (_, n) in zip(w, shapes, strict=True))
    twist_mass = h / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
    twist = np.array([[1.0, -1.0], [-1.0, 1.0]]) / h
    for e in range(elements):
        at = DOF * e
        for first, ei in ((0, beam.stiffness_x), (2, beam.stiffness_y)):
            i = at + np.array([first, first + 1, DOF + first, DOF + first + 1])
            mass[np.ix_(i, i)] += beam.linear_density * bending_mass
            stiffness[np.ix_(i, i)] += ei * bending
        i = at + np.array([4, DOF + 4])
        mass[np.ix_(i, i)] += beam.polar_inertia * twist_mass
        stiffness[np.ix_(i, i)] += beam.torsion_stiffness * twist
    if tip is not None:
        move, rotation = tip.matrices()
        mass[-DOF:, -DOF:] += tip.mass * move.T @ move + rotation.T @ tip.inertia @ rotation
    return mass[DOF:, DOF:], stiffness[DOF:, DOF:]


def _solve_by_elements(
    beam: ClampedBeam, mass: Matrix, elements: int, kept: Indices, modes: int
) -> tuple[Vector, Matrix]:
    """Return squares of the lowest frequencies, rising, and mode shapes of modal mass one.

    The nodes follow from what each element bends and twists by itself, q = T e, and the stiffness
    of these is that of the elements, S: so T^T M T e = S e / omega^2 has the lowest modes first, to
    rounding. K q = omega^2 M q has them last, and loses as many digits as the mesh is fine.

    Args:
        beam: its numbers.
        mass: of the freedoms that are kept.
        elements: how many of equal length.
        kept: which freedoms of the free nodes.
        modes: how many modes.
    """
    h = beam.length / elements
    forward, element_stiffness = np.eye(DOF), np.zeros((DOF, DOF))
    forward[0, 1] = forward[2, 3] = h
    for first, ei in ((0, beam.stiffness_x), (2, beam.stiffness_y)):
        of = slice(first, first + 2)
        element_stiffness[of, of] = (
            ei / h**3 * np.array([[12.0, -6.0 * h], [-6.0 * h, 4.0 * h * h]])
        )
    element_stiffness[4, 4] = beam.torsion_stiffness / h
    nodes = np.zeros((DOF * elements, DOF * elements))
    for k in range(elements):
        rows = slice(DOF * k, DOF * (k + 1))
        if k:
            nodes[rows] = forward @ nodes[DOF * (k - 1) : DOF * k]
        nodes[rows, rows] = np.eye(DOF)
    of_kept = np.ix_(kept, kept)
    chain, stiffness = nodes[of_kept], np.kron(np.eye(elements), element_stiffness)[of_kept]
    last = len(kept) - 1
    compliance, eigenvectors = eigh(
        chain.T @ mass @ chain, stiffness, subset_by_index=(last - modes + 1, last)
    )
    compliance, eigenvectors = compliance[::-1], eigenvectors[:, ::-1]
    return 1.0 / compliance, chain @ eigenvectors / np.sqrt(compliance)


def finite_element_beam(
    beam: ClampedBeam, tip: TipBody | None, elements: int, modes: int
) -> FlexibleShape:
    """Return the lowest modes of a clamped beam by cubic elements, of modal mass one.

    A beam without torsional stiffness or inertia does not twist.
    """
    mass, stiffness = _assemble(beam, tip, elements)
    kept = np.arange(len(mass))
    if beam.torsion_stiffness == 0.0:
        kept = kept[kept % DOF != 4]
    elif beam.polar_inertia == 0.0:  # massless in twist but for the tip: condense it out
        raise ValueError("a beam that twists needs a polar inertia")
    of = np.ix_(kept, kept)
    if elements > _MAX_DIRECT_ELEMENTS:
        squares, vectors = _solve_by_elements(beam, mass[of], elements, kept, modes)
    else:
        squares, vectors = eigh(stiffness[of], mass[of], subset_by_index=(0, modes - 1))
    nodal = np.zeros((len(mass), modes))
    nodal[kept] = vectors * np.sign(vectors[np.argmax(abs(vectors), axis=0), np.arange(modes)])
    free = nodal.reshape(elements, DOF, modes)
    line = FiniteElementModes(beam.length, np.concatenate((np.zeros((1, DOF, modes)), free)))
    h = beam.length / elements
    x, w = np.polynomial.legendre.leggauss(GAUSS)
    s = (np.arange(elements)[:, None] + (1.0 + x) / 2.0) * h
    weights = np.tile(beam.linear_density * w * h / 2.0, elements)
    return _shape(beam, tip, line, s.ravel(), weights, np.ones(modes), squares)


@dataclass(frozen=True)
class ClosedFormModes:
    """Clamped-free modes of both deflections, then of the twist; each of one direction alone.

    Args:
        x, y: beams with the modes u and v.
        twists: number of torsional modes sin((2 j - 1) pi z / 2 L).
    """

    x: ClampedFreeBeam
    y: ClampedFreeBeam
    twists: int

    def point(self, s: float) -> AppendagePoint:
        """Return what the modes do at the distance s from the clamp."""
        a, b = self.x.modes, self.y.modes
        n = a + b + self.twists
        at = np.array([s])
        displacement, rotation, curvature = np.zeros((3, n)), np.zeros((3, n)), np.zeros((3, n))
        for row, beam, modes in ((0, self.x, slice(0, a)), (1, self.y, slice(a, a + b))):
            if beam.modes:
                displacement[row, modes] = beam.shape(at)[:, 0]
                rotation[1 - row, modes] = (1.0, -1.0)[row] * beam.shape(at, 1)[:, 0]
                curvature[row, modes] = beam.shape(at, 2)[:, 0]
        numbers = (np.arange(self.twists) + 0.5) * np.pi / self.x.length
        rotation[2, a + b :] = np.sin(numbers * s)
        return AppendagePoint(np.array([0.0, 0.0, s]), displacement, rotation, curvature)


def closed_form_beam(beam: ClampedBeam, modes_x: int, modes_y: int, twists: int) -> FlexibleShape:
    """Return clamped-free modes in closed form, one at the tip (twist: one radian there).

    Args:
        beam: its numbers.
        modes_x, modes_y: how many of each deflection.
        twists: how many torsional modes.
    """
    beams = [
        ClampedFreeBeam(beam.length, beam.linear_density, ei, modes)
        for ei, modes in ((beam.stiffness_x, modes_x), (beam.stiffness_y, modes_y))
    ]
    line = ClosedFormModes(beams[0], beams[1], twists)
    panels = 4 * max(modes_x, modes_y, twists, 1)
    x, w = np.polynomial.legendre.leggauss(16)
    h = beam.length / panels
    s = ((np.arange(panels)[:, None] + (1.0 + x) / 2.0) * h).ravel()
    weights = np.tile(w * h / 2.0, panels)
    numbers = (np.arange(twists) + 0.5) * np.pi / beam.length
    mass: list[Vector] = [beam.linear_density * b.integral(0, 2, 0) for b in beams if b.modes]
    stiffness = [
        m * b.frequencies**2 for m, b in zip(mass, [b for b in beams if b.modes], strict=True)
    ]
    mass.append(np.full(twists, beam.polar_inertia * beam.length / 2.0))
    half = 0.5 * beam.torsion_stiffness * beam.length
    twisting = np.asarray(half * numbers**2, dtype=np.float64)
    stiffness.append(twisting)
    shape = _shape(
        beam,
        None,
        line,
        s,
        beam.linear_density * weights,
        np.concatenate(mass),
        np.concatenate(stiffness),
    )
    return replace(shape, tip_scaled=True)


def _shape(
    beam: ClampedBeam,
    tip: TipBody | None,
    line: FiniteElementModes | ClosedFormModes,
    s: Vector,
    weights: Vector,
    mass: Vector,
    stiffness: Vector,
) -> FlexibleShape:
    """Sum over the mass points at the distances s, and over those of the tip body."""
    sections = [line.point(float(at)) for at in s]
    ends = np.append(s, beam.length)
    shortening = _shortening(line, ends)
    points = Points(
        np.stack([point.place for point in sections]),
        weights,
        np.stack([point.displacement for point in sections]),
        shortening[:-1],
    )
    end = line.point(beam.length)
    if tip is not None:
        move = end.displacement - np.cross(tip.offset[:, None], end.turn, axis=0)
        place, second_order = (
            end.place + tip.offset,
            shortening[-1] + second_order_rotation(end.turn, tip.offset),
        )
        points = points.extend(
            rigid_points(tip.mass, place, tip.inertia, move, end.turn, second_order)
        )
    line_points = [line.point(float(at)) for at in np.linspace(0.0, beam.length, LINE_POINTS)]
    return FlexibleShape(
        integrals_of(points),
        mass,
        stiffness,
        end,
        np.stack([point.place for point in line_points]),
        np.stack([point.displacement for point in line_points]),
        line,
    )


def _shortening(line: FiniteElementModes | ClosedFormModes, s: Vector) -> Matrix:
    """Return s_ij of the displacement q^T s q / 2 at places along a beam, (places, 3, n, n).

    s_ij = -int (u_i' u_j' + v_i' v_j') ds from the clamp, along the beam.

    Args:
        line: the modes.
        s: rising distances from the clamp, shape (places,) [m].
    """
    x, w = np.polynomial.legendre.leggauss(SUM_POINTS)
    edges = np.concatenate(([0.0], s))
    total, rows = 0.0, []
    for first, last in pairwise(edges):
        for a, weight in zip(x, w, strict=True):
            rotation = line.point(float(0.5 * (first + last) + 0.5 * (last - first) * a)).turn[:2]
            total = total + 0.5 * (last - first) * weight * rotation.T @ rotation
        rows.append(np.multiply.outer([0.0, 0.0, -1.0], total))
    return np.stack(rows)
