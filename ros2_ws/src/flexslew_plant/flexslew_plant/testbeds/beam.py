"""The uniform clamped-free Euler-Bernoulli beam: wave numbers, shapes and their integrals."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from scipy.integrate import fixed_quad
from scipy.optimize import brentq

from flexslew_plant.arrays import Matrix, Vector


@lru_cache
def wave_numbers(modes: int) -> tuple[float, ...]:
    """Return beta_j L, the first `modes` roots of cos(b) cosh(b) = -1."""
    centers = (np.arange(modes) + 0.5) * np.pi
    # cos(b) + 1/cosh(b) has the same roots and does not overflow
    return tuple(
        float(brentq(lambda b: np.cos(b) + 1.0 / np.cosh(b), c - 0.5, c + 0.5, xtol=1e-15))
        for c in centers
    )


@dataclass(frozen=True)
class ClampedFreeBeam:
    """Mode shapes phi_j with phi_j(L) = 1, so that q_1 is the tip deflection of a one-mode beam.

    Args:
        length: L [m].
        linear_density: mu [kg/m].
        bending_stiffness: EI [N m^2].
        modes: how many shapes.
    """

    length: float
    linear_density: float
    bending_stiffness: float
    modes: int

    @property
    def frequencies(self) -> Vector:
        """Clamped natural frequencies, shape (modes,) [rad/s]: (beta L)^2 sqrt(EI / (mu L^4))."""
        scale = np.sqrt(self.bending_stiffness / (self.linear_density * self.length**4))
        frequencies: Vector = np.square(wave_numbers(self.modes)) * scale
        return frequencies

    def shape(self, s: Vector, derivative: int = 0) -> Matrix:
        """Return d^n phi_j / ds^n at the distances s from the clamp, shape (modes, len(s)).

        Written with decaying exponentials, so high modes lose no digits to cosh - sinh.

        Args:
            s: distances from the clamped end, shape (k,) [m].
            derivative: n, 0 to 3.
        """
        b = np.asarray(wave_numbers(self.modes))[:, None]
        z = b * np.asarray(s, dtype=float)[None, :] / self.length
        c = (np.cosh(b) + np.cos(b)) / (np.sinh(b) + np.sin(b))
        # cosh z - c sinh z = ((1 - c) e^z + (1 + c) e^-z) / 2, with 1 - c free of cancellation
        one_minus_c = (np.sin(b) - np.cos(b) - np.exp(-b)) / (np.sinh(b) + np.sin(b))
        grow, decay = 0.5 * one_minus_c * np.exp(z), 0.5 * (1.0 + c) * np.exp(-z)
        hyperbolic = grow + (-1.0) ** derivative * decay
        trigonometric = -np.cos(z + derivative * np.pi / 2) + c * np.sin(z + derivative * np.pi / 2)
        tip = 2.0 * (-1.0) ** np.arange(self.modes)[:, None]  # |phi(L)| = 2 in this scaling
        shape: Matrix = (hyperbolic + trigonometric) / tip * (b / self.length) ** derivative
        return shape

    def integral(self, weight_power: int, order: int, derivative: int) -> Vector:
        """Return integral_0^L s^p (phi_j^(n))^k ds for each mode, by Gauss quadrature on panels.

        Args:
            weight_power: p.
            order: k, 1 or 2.
            derivative: n.
        """
        return _integral(self.length, self.modes, weight_power, order, derivative).copy()


@lru_cache(maxsize=256)
def _integral(length: float, modes: int, weight_power: int, order: int, derivative: int) -> Vector:
    """Return ClampedFreeBeam.integral, which thousands of beams of one length ask for."""
    beam = ClampedFreeBeam(length, 1.0, 1.0, modes)

    def integrand(s: Vector) -> Matrix:
        return s**weight_power * beam.shape(s, derivative) ** order

    panels = pairwise(np.linspace(0.0, length, 4 * modes + 1))
    total: Vector = np.sum([fixed_quad(integrand, a, b, n=16)[0] for a, b in panels], axis=0)
    return total
