"""A circular membrane with a fixed rim, in closed form (Kwak 1989, eqs 4-17).

w = sqrt(2 or 1) / (sqrt(pi m) a J_(k+1)(beta a)) J_k(beta r) (1, cos k phi, sin k phi), of modal
mass one, along the appendage's z; omega = c beta.
"""

import numpy as np
from scipy.special import jn_zeros, jv

from flexslew_plant.arrays import Vector
from flexslew_plant.testbeds.spacecraft.shapes.integrals import Points, integrals_of
from flexslew_plant.testbeds.spacecraft.shapes.shape import FlexibleShape, Spot

RADIAL, ANGULAR = 24, 32  # points of the quadrature: exact to rounding for the first modes


def membrane(
    radius: float, density: float, wave_speed: float, height: float, waves: int, rings: int
) -> FlexibleShape:
    """Return the modes of a membrane that lies across z at a height, on a massless mast.

    Order: for 0 to `waves` nodal diameters, the cosines with 1 to `rings` zeros along the radius,
    then the sines.

    Args:
        radius: a [m].
        density: per area [kg/m^2].
        wave_speed: c, the square root of tension over density [m/s].
        height: of the membrane above the hinge [m].
        waves: largest number of nodal diameters.
        rings: zeros along the radius, the rim included.
    """
    modes = [
        (k, float(zero), part)
        for k in range(waves + 1)
        for part in ((0,) if k == 0 else (0, 1))
        for zero in jn_zeros(k, rings)
    ]
    x, w = np.polynomial.legendre.leggauss(RADIAL)
    r, phi = radius * (1.0 + x) / 2.0, 2.0 * np.pi * np.arange(ANGULAR) / ANGULAR
    weights = np.outer(w * radius / 2.0 * r, np.full(ANGULAR, 2.0 * np.pi / ANGULAR)) * density
    rr, angle = (grid.ravel() for grid in np.meshgrid(r, phi, indexing="ij"))
    deflection = _deflection(modes, rr, angle, radius, density)
    place = np.stack((rr * np.cos(angle), rr * np.sin(angle), np.full(rr.size, height)), axis=1)
    shape = np.zeros((rr.size, 3, len(modes)))
    shape[:, 2] = deflection
    frequencies = np.array([wave_speed * zero / radius for _, zero, _ in modes])
    centre = np.zeros((3, len(modes)))
    centre[2] = _deflection(modes, np.zeros(1), np.zeros(1), radius, density)[0]
    still = np.zeros((3, len(modes)))
    s = np.linspace(-radius, radius, 21)
    line = np.stack((s, np.zeros_like(s), np.full_like(s, height)), axis=1)
    line_shape = np.zeros((len(s), 3, len(modes)))
    line_shape[:, 2] = _deflection(modes, abs(s), np.where(s < 0.0, np.pi, 0.0), radius, density)
    return FlexibleShape(
        integrals_of(Points(place, weights.ravel(), shape)),
        np.ones(len(modes)),
        frequencies**2,
        Spot(np.array([0.0, 0.0, height]), centre, still, still),
        line,
        line_shape,
    )


def _deflection(
    modes: list[tuple[int, float, int]],
    r: Vector,
    angle: Vector,
    radius: float,
    density: float,
) -> Vector:
    """Return w of every mode at polar places, shape (places, modes)."""
    columns = []
    for k, zero, part in modes:
        size = (1.0 if k == 0 else np.sqrt(2.0)) / (
            np.sqrt(np.pi * density) * radius * jv(k + 1, zero)
        )
        around = np.sin(k * angle) if part else np.cos(k * angle)
        columns.append(size * jv(k, zero * r / radius) * around)
    deflections: Vector = np.stack(columns, axis=1)
    return deflections
