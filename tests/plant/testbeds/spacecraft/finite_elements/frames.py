"""Frames of Euler-Bernoulli beams: matrices from a textbook, independent of the bench.

J. S. Przemieniecki, Theory of matrix structural analysis, 1968, chapters 5 and 11. The twist has
the inertia of the section, the bending none of it.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class Section(NamedTuple):
    """Of a beam along its own x."""

    axial: float = 4e6  # EA [N]
    twist: float = 60.0  # GJ [N m^2]
    bend_y: float = 90.0  # EI of the deflection along its z [N m^2]
    bend_z: float = 250.0  # EI of the deflection along its y [N m^2]
    density: float = 0.8  # rho A [kg/m]
    polar: float = 2e-3  # rho I_p [kg m]


def bending(length: float, sign: float) -> tuple[Array, Array]:
    """Return stiffness over EI and mass over rho A of deflection and turn at both ends."""
    a, b, c = length * sign, length**2, 13.0 * length * sign
    stiffness = [[12, 6 * a, -12, 6 * a], [6 * a, 4 * b, -6 * a, 2 * b],
                 [-12, -6 * a, 12, -6 * a], [6 * a, 2 * b, -6 * a, 4 * b]]  # fmt: skip
    mass = [[156, 22 * a, 54, -c], [22 * a, 4 * b, c, -3 * b],
            [54, c, 156, -22 * a], [-c, -3 * b, -22 * a, 4 * b]]  # fmt: skip
    return np.array(stiffness) / length**3, np.array(mass) * length / 420.0


def element(start: Array, end: Array, s: Section) -> tuple[Array, Array]:
    """Return mass and stiffness in global axes, shape (12, 12) each."""
    length = float(np.linalg.norm(end - start))
    mass, stiffness = np.zeros((2, 12, 12))
    two, rod = np.array([[1.0, -1.0], [-1.0, 1.0]]), np.array([[2.0, 1.0], [1.0, 2.0]]) / 6.0
    for rows, ea, rho in (((0, 6), s.axial, s.density), ((3, 9), s.twist, s.polar)):
        stiffness[np.ix_(rows, rows)] = ea / length * two
        mass[np.ix_(rows, rows)] = rho * length * rod
    for places, ei, sign in (((1, 5, 7, 11), s.bend_z, 1.0), ((2, 4, 8, 10), s.bend_y, -1.0)):
        k, m = bending(length, sign)
        stiffness[np.ix_(places, places)] = ei * k
        mass[np.ix_(places, places)] = s.density * m
    along = (end - start) / length
    helper = np.array([0.0, 0.0, 1.0]) if abs(along[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    across = np.cross(helper, along) / np.linalg.norm(np.cross(helper, along))
    axes = np.kron(np.eye(4), np.stack((along, across, np.cross(along, across))))
    return axes.T @ mass @ axes, axes.T @ stiffness @ axes


def frame(places: Array, edges: list[tuple[int, int]], section: Section) -> tuple[Array, Array]:
    """Return mass and stiffness of a frame with six rows per node."""
    size = 6 * len(places)
    mass, stiffness = np.zeros((2, size, size))
    for a, b in edges:
        rows = np.r_[6 * a : 6 * a + 6, 6 * b : 6 * b + 6]
        m, k = element(places[a], places[b], section)
        mass[np.ix_(rows, rows)] += m
        stiffness[np.ix_(rows, rows)] += k
    return mass, stiffness


def chain(corners: list[list[float]], elements: int) -> tuple[Array, list[tuple[int, int]]]:
    """Return places and edges of straight legs through corners, each of so many elements."""
    legs = [np.linspace(a, b, elements + 1)[k > 0 :] for k, (a, b) in
            enumerate(zip(np.array(corners[:-1]), np.array(corners[1:]), strict=True))]  # fmt: skip
    places = np.concatenate(legs)
    return places, [(k, k + 1) for k in range(len(places) - 1)]


BEAM = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]
ANGLE = [[0.2, 0.1, 0.0], [1.5, 0.1, 0.0], [1.5, 1.1, 0.4]]


def arrays(corners: list[list[float]], elements: int = 12, section: Section = Section()) -> Any:  # noqa: B008
    """Return what an .npz of a frame holds that is clamped at its first node."""
    places, edges = chain(corners, elements)
    mass, stiffness = frame(places, edges, section)
    return {"M": mass, "K": stiffness, "nodes": places, "boundary": np.arange(6)}


def saved(folder: Path, **data: Any) -> Path:
    """Return an .npz file of arrays."""
    path = folder / "model.npz"
    np.savez(path, **data)
    return path
