"""Small motions of a spinning hub with two chains of rigid links: what beams must agree with.

A second derivation without modes or displacements of second order: every link keeps its length and
turns by two angles, springs in its joints are the bending stiffness, and the small motions about
the steady spin follow from the exact places of all masses. In the frame that turns with w,
    M x'' + G x' + K x = 0,    M = sum m J^T J,    G = 2 sum m J^T w~ J,
and K is the second derivative of the springs' energy less sum m |w x p|^2 / 2.
"""

from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Matrix, Vector

_CHANGE = 1e-4  # of a coordinate, for the second derivatives [rad or m]


class Hub(NamedTuple):
    """A hub with a beam on either side along x.

    Args:
        mass: of the hub [kg].
        inertia: its principal moments, shape (3,) [kg m^2].
        radius: where the beams begin [m].
        length, linear_density, stiffness: of a beam [m, kg/m, N m^2].
        tip: point mass at each end [kg].
    """

    mass: float
    inertia: Vector
    radius: float
    length: float
    linear_density: float
    stiffness: float
    tip: float = 0.0


def small_motions(hub: Hub, spin: float, links: int = 24) -> Matrix:
    """Return the state matrix about a spin around z, shape (2 n, 2 n).

    Args:
        hub: with its beams.
        spin: w [rad/s].
        links: of each chain.
    """
    masses = _masses(hub, links)
    size = 6 + 4 * links
    eye = np.eye(size)
    moved = _places(hub, links, _CHANGE * eye) - _places(hub, links, -_CHANGE * eye)
    slopes = moved / (2.0 * _CHANGE)  # (n, masses, 3)
    across = slopes @ np.array([[0.0, spin, 0.0], [-spin, 0.0, 0.0], [0.0, 0.0, 0.0]])
    mass = np.einsum("k,ika,jka->ij", masses, slopes, slopes)
    turning = 2.0 * np.einsum("k,ika,jka->ij", masses, slopes, across)

    def potential(x: Matrix) -> Vector:
        places = _places(hub, links, x)
        swung = (places[..., 0] ** 2 + places[..., 1] ** 2) @ masses
        return _springs(hub, links, x) - 0.5 * spin**2 * swung

    here = potential(np.zeros((1, size)))
    both = potential(_CHANGE * eye) + potential(-_CHANGE * eye)
    stiffness = np.empty((size, size))
    for i in range(size):
        pair = _CHANGE * (eye[i] + eye)
        mixed = potential(pair) + potential(-pair) - both[i] - both + 2.0 * here
        stiffness[i] = 0.5 * mixed / _CHANGE**2
    below = -np.linalg.solve(mass, np.hstack((stiffness, turning)))
    return np.block([[np.zeros((size, size)), np.eye(size)], [below]])


def _masses(hub: Hub, links: int) -> Vector:
    """Return the masses: six of the hub, then of every link and the tip, chain by chain."""
    chain = np.append(np.full(links, hub.linear_density * hub.length / links), hub.tip)
    return np.concatenate((np.full(6, hub.mass / 6.0), chain, chain))


def _places(hub: Hub, links: int, x: Matrix) -> Matrix:
    """Return the place of every mass in the turning frame, shape (rows of x, masses, 3)."""
    moments = 0.5 * hub.inertia.sum() - hub.inertia
    arms = np.diag(np.sqrt(3.0 * moments / hub.mass))
    found = [np.broadcast_to(np.vstack((arms, -arms)), (len(x), 6, 3))]
    length = hub.length / links
    for side, angles in ((1.0, x[:, 6 : 6 + 2 * links]), (-1.0, x[:, 6 + 2 * links :])):
        in_plane, out = angles[:, :links], angles[:, links:]
        forward = side * np.cos(in_plane) * np.cos(out)
        along = np.stack((forward, np.sin(in_plane) * np.cos(out), np.sin(out)), axis=2)
        ends = length * np.cumsum(along, axis=1) + np.array([side * hub.radius, 0.0, 0.0])
        found += [ends - 0.5 * length * along, ends[:, -1:]]
    places = np.concatenate(found, axis=1)
    turn = x[:, None, 3:6]  # a small one, exact to second order
    once = np.cross(turn, places)
    moved: Matrix = x[:, None, :3] + places + once + 0.5 * np.cross(turn, once)
    return moved


def _springs(hub: Hub, links: int, x: Matrix) -> Vector:
    """Return the energy of the springs; the first one is half a link from the clamp."""
    stiffness = np.full(links, hub.stiffness * links / hub.length)
    stiffness[0] *= 2.0
    bent = np.diff(x[:, 6:].reshape(-1, 4, links), prepend=0.0, axis=2)
    energy: Vector = 0.5 * (bent**2).sum(axis=1) @ stiffness
    return energy
