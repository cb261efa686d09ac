"""A planar platform with one antenna: the matrices of Kwak (1989), (2-49) to (2-59), example 4.

Coordinates (R_y, R_z, theta, q): the place in inertial space, the platform's angle, one mode of the
antenna, which is along y before it turns. In slugs, feet and pounds.
"""

from typing import NamedTuple

import numpy as np

from flexslew_control.linear.small_motion import Frozen
from flexslew_plant.arrays import Matrix


class Antenna(NamedTuple):
    """The numbers of example 4."""

    platform_mass: float = 15.6  # m_r
    platform_inertia: float = 13.0  # I_r
    mass: float = 0.15  # m_e
    first: float = 0.375  # S_e
    inertia: float = 1.25  # I_e
    place: float = 0.4  # r_oe
    translation: float = 0.117449  # phi-bar
    rotation: float = 0.426619  # phi-tilde
    stiffness: float = 49.449453  # K_e


ROUNDED = Antenna(translation=0.117, rotation=0.427, stiffness=49.449)  # as in Appendix E
ANGLE, TIME = np.pi / 2.0, 3.0  # [rad, s]
MODAL_MASS = 0.15  # M_e


def bang_bang(t: float) -> tuple[float, float, float]:
    """Return beta, beta' and beta'' of the turn at a time [s]."""
    c = 4.0 * ANGLE / TIME**2
    if t < 0.5 * TIME:
        return 0.5 * c * t * t, c * t, c
    s = TIME - t
    return ANGLE - 0.5 * c * s * s, c * s, -c


def constant(a: Antenna) -> tuple[Matrix, Matrix]:
    """Return M0 and K0 (2-53), (2-54)."""
    mass, first = a.platform_mass + a.mass, a.first + a.mass * a.place
    inertia = a.platform_inertia + a.inertia + a.mass * a.place**2 + 2.0 * a.place * a.first
    coupling = a.rotation + a.place * a.translation
    m = np.array(
        [
            [mass, 0.0, 0.0, 0.0],
            [0.0, mass, first, a.translation],
            [0.0, first, inertia, coupling],
            [0.0, a.translation, coupling, MODAL_MASS],
        ]
    )
    return m, np.diag([0.0, 0.0, 0.0, a.stiffness])


def rate_matrices(a: Antenna) -> dict[str, Matrix]:
    """Return Ms, Mc, Kb1, Kb2, Kb3, Gs and Gc (2-58), the signs of Gs and Gc restored."""
    s, f = a.first, a.translation
    found = {name: np.zeros((4, 4)) for name in ("Ms", "Mc", "Kb1", "Kb2", "Kb3", "Gs", "Gc")}
    found["Ms"][0, 2:] = found["Ms"][2:, 0] = -s, -f
    found["Mc"][1, 2:] = found["Mc"][2:, 1] = s, f
    found["Mc"][2, 2] = 2.0 * s * a.place
    found["Mc"][2, 3] = found["Mc"][3, 2] = a.place * f
    found["Kb1"][0, 2:] = found["Kb2"][1, 2:] = found["Gc"][0, 2:] = found["Gs"][1, 2:] = s, f
    found["Kb2"][2, 3] = a.place * f
    found["Kb3"][3, 3] = MODAL_MASS
    found["Gs"][2, 2:] = a.place * s, a.place * f
    return found


def planar(t: float, sign: float = 1.0) -> Frozen:
    """Return the equations at a time: (2-49) with M1 = s Ms - (1 - c) Mc, (2-56), (2-57), (2-52).

    Args:
        t: time [s].
        sign: of the fourth column of Gs and Gc; -1: as printed.
    """
    a, (beta, rate, acceleration) = Antenna(), bang_bang(t)
    sin, cos = np.sin(beta), np.cos(beta)
    m0, k0 = constant(a)
    matrices = rate_matrices(a)
    damping = -2.0 * rate * (sin * matrices["Gs"] + cos * matrices["Gc"])
    damping[:, 3] *= sign
    stiffness = k0 + (rate**2 * sin - acceleration * cos) * matrices["Kb1"]
    stiffness -= (rate**2 * cos + acceleration * sin) * matrices["Kb2"] + rate**2 * matrices["Kb3"]
    force = a.first * (rate**2 * sin - acceleration * cos)
    d = np.array(
        [
            a.first * (rate**2 * cos + acceleration * sin),
            force,
            a.place * force - a.inertia * acceleration,
            -a.rotation * acceleration,
        ]
    )
    mass = m0 + sin * matrices["Ms"] - (1.0 - cos) * matrices["Mc"]
    return Frozen(mass, damping, stiffness, np.eye(4), d)


def before() -> Frozen:
    """Return the equations before the turn."""
    m, k = constant(Antenna())
    return Frozen(m, np.zeros((4, 4)), k, np.eye(4), np.zeros(4))
