"""A circular membrane with a fixed rim, in closed form (Kwak 1989, eqs 4-17).

w = sqrt(2 or 1) / (sqrt(pi m) a J_(k+1)(beta a)) J_k(beta r) (1, cos k phi, sin k phi), of modal
mass one, along the appendage's z; omega = c beta. The rim holds it in its plane, too: there it is
stiff, so in-plane inertia forces f only add to its tension, by the stress N(f) of plane stress, and
    sum m f . s_ij = - int N(f) : (grad w_i grad w_j^T) dA.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import jn_zeros, jv, jvp

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.spacecraft.shapes.integrals import Points, Shortening, integrals_of
from flexslew_plant.testbeds.spacecraft.shapes.shape import AppendagePoint, FlexibleShape

RADIAL, ANGULAR = 24, 32  # points of the quadrature: exact to rounding for the first modes


class _Mode(NamedTuple):
    """A mode of a membrane: size J_k(zero r / a) times cos or sin of k phi."""

    k: int  # nodal diameters
    zero: float  # of J_k
    part: int  # 0: cosine, 1: sine
    size: float  # of a modal mass of one


def membrane(
    radius: float,
    density: float,
    wave_speed: float,
    height: float,
    waves: int,
    rings: int,
    poisson_ratio: float = 0.3,
) -> FlexibleShape:
    """Return the modes of a membrane across z at a height, on a massless mast.

    Order: for 0 to `waves` nodal diameters, the cosines with 1 to `rings` zeros along the radius,
    then the sines.

    Args:
        radius: radius a [m].
        density: mass per area [kg/m^2].
        wave_speed: c, the square root of tension over density [m/s].
        height: height of the membrane above the hinge [m].
        waves: largest number of nodal diameters.
        rings: zeros along the radius, the rim included.
        poisson_ratio: Poisson's ratio of its material [-].
    """
    scale = np.sqrt(np.pi * density) * radius
    modes = [
        _Mode(k, float(zero), part, (1.0 if k == 0 else np.sqrt(2.0)) / (scale * jv(k + 1, zero)))
        for k in range(waves + 1)
        for part in ((0,) if k == 0 else (0, 1))
        for zero in jn_zeros(k, rings)
    ]
    x, w = np.polynomial.legendre.leggauss(RADIAL)
    r, phi = radius * (1.0 + x) / 2.0, 2.0 * np.pi * np.arange(ANGULAR) / ANGULAR
    weights = np.outer(w * radius / 2.0 * r, np.full(ANGULAR, 2.0 * np.pi / ANGULAR)) * density
    rr, angle = (grid.ravel() for grid in np.meshgrid(r, phi, indexing="ij"))
    deflection = _deflection(modes, rr, angle, radius)
    place = np.stack((rr * np.cos(angle), rr * np.sin(angle), np.full(rr.size, height)), axis=1)
    shape = np.zeros((rr.size, 3, len(modes)))
    shape[:, 2] = deflection
    zeros = np.zeros((rr.size, 3, len(modes), len(modes)))
    sums = integrals_of(Points(place, weights.ravel(), shape, zeros))
    stress = _stress(place[:, :2], radius, poisson_ratio)
    slopes = _slopes(modes, rr, angle, radius)
    load_sums = -np.einsum("k,klab,kai,kbj->ijl", weights.ravel(), stress, slopes, slopes)
    geometric = _shortening(load_sums, height)
    frequencies = np.array([wave_speed * zero / radius for _, zero, _, _ in modes])
    centre = np.zeros((3, len(modes)))
    centre[2] = _deflection(modes, np.zeros(1), np.zeros(1), radius)[0]
    zero_slope = np.zeros((3, len(modes)))
    s = np.linspace(-radius, radius, 21)
    line = np.stack((s, np.zeros_like(s), np.full_like(s, height)), axis=1)
    line_shape = np.zeros((len(s), 3, len(modes)))
    line_shape[:, 2] = _deflection(modes, abs(s), np.where(s < 0.0, np.pi, 0.0), radius)
    return FlexibleShape(
        replace(sums, shortening=geometric),
        np.ones(len(modes)),
        frequencies**2,
        AppendagePoint(np.array([0.0, 0.0, height]), centre, zero_slope, zero_slope),
        line,
        line_shape,
    )


def _deflection(modes: list[_Mode], r: Vector, angle: Vector, radius: float) -> Vector:
    """Return w of every mode at polar places, shape (places, modes)."""
    columns = []
    for k, zero, part, size in modes:
        angular_part = np.sin(k * angle) if part else np.cos(k * angle)
        columns.append(size * jv(k, zero * r / radius) * angular_part)
    deflections: Vector = np.stack(columns, axis=1)
    return deflections


def _slopes(modes: list[_Mode], r: Vector, angle: Vector, radius: float) -> Matrix:
    """Return dw/dx and dw/dy of every mode at polar places, shape (places, 2, modes)."""
    columns = []
    for k, zero, part, size in modes:
        angular_part, angular_slope = (
            (np.sin(k * angle), k * np.cos(k * angle))
            if part
            else (np.cos(k * angle), -k * np.sin(k * angle))
        )
        along = size * zero / radius * jvp(k, zero * r / radius) * angular_part
        azimuth_slope = size * jv(k, zero * r / radius) / r * angular_slope
        cos, sin = np.cos(angle), np.sin(angle)
        columns.append(
            np.stack((along * cos - azimuth_slope * sin, along * sin + azimuth_slope * cos), axis=1)
        )
    return np.stack(columns, axis=2)


def _stress(place: Matrix, radius: float, poisson_ratio: float) -> Matrix:
    """Return N over the density, of unit accelerations in the plane, (places, 6, 2, 2) [m^2/s^2].

    Loads: along x, along y, then x and y each growing with x, and growing with y. With
    u = (a^2 - r^2) (c + B x) the equations of plane stress hold for
        c = f / (G (4 + 2 k)),    8 B + k (2 (B + B^T) + 2 tr(B) 1) = A / G,
    k = (1 + nu)/(1 - nu), f + A x the load; G drops out of N.

    Args:
        place: x and y, shape (places, 2) [m].
        radius: a of the rim, where u = 0 [m].
        poisson_ratio: nu [-].
    """
    k, edge_factor = (
        (1.0 + poisson_ratio) / (1.0 - poisson_ratio),
        radius**2 - (place**2).sum(axis=1),
    )
    one, columns = np.eye(2), []
    loads = [(f, np.zeros((2, 2))) for f in one]
    loads += [(np.zeros(2), np.outer(f, gradient_axis)) for gradient_axis in one for f in one]
    for f, a in loads:
        even, mean = 0.5 * (a + a.T), 0.5 * np.trace(a)
        linear = 0.125 * (a - even) + (even - mean * one) / (8.0 + 4.0 * k)
        linear += mean / (8.0 + 8.0 * k) * one
        push = f / (4.0 + 2.0 * k) + place @ linear.T
        gradient = edge_factor[:, None, None] * linear - 2.0 * push[:, :, None] * place[:, None, :]
        strain = 0.5 * (gradient + gradient.transpose(0, 2, 1))
        trace = np.trace(strain, axis1=1, axis2=2)[:, None, None]
        more = poisson_ratio / (1.0 - poisson_ratio)
        columns.append(2.0 * (strain + more * trace * one))
    return np.stack(columns, axis=1)


def _shortening(load_sums: Matrix, height: float) -> Shortening:
    """Return the sums from those of the six loads of _stress, shape (n, n, 6)."""
    n = len(load_sums)
    even = 0.5 * (load_sums + load_sums.transpose(1, 0, 2))
    first, second = np.zeros((n, n, 3)), np.zeros((n, n, 3, 3))
    first[..., :2] = even[..., :2]
    second[..., 0, :2], second[..., 1, :2] = even[..., 2:4], even[..., 4:]
    second[..., 2, :] = height * first
    return Shortening(first, second)
