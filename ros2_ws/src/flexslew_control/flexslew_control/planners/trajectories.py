"""Rest-to-rest references: straight lines in joint space, polynomials in time."""

from collections.abc import Callable
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.model import Model

Profile: TypeAlias = Literal["cubic", "quintic"]


class Trajectory(NamedTuple):
    """A reference at given times: position and velocity, each (times, joints)."""

    position: Matrix  # [rad or m]
    velocity: Matrix  # [rad/s or m/s]


def rest_to_rest(
    profile: Profile, start: Vector, goal: Vector, duration: float, times: Vector
) -> Trajectory:
    """Return the reference r(t) = start + (goal - start) p(t / T), at rest before 0 and after T.

    With s = t / T clipped to [0, 1] (Gorinevsky and Vukovich 1998, section 3: "a straight line in
    the actuator coordinate space and a third order polynomial in time"):
        cubic    p = 3 s^2 - 2 s^3, with an acceleration that jumps at both ends;
        quintic  p = 10 s^3 - 15 s^4 + 6 s^5, with zero acceleration there.

    Args:
        profile: a key of PROFILES.
        start, goal: joint positions, shape (joints,) [rad or m].
        duration: T [s], positive.
        times: shape (k,) [s].
    """
    s = np.clip(times / duration, 0.0, 1.0)
    p, dp = PROFILES[profile](s)
    span = goal - start
    return Trajectory(start + np.multiply.outer(p, span), np.multiply.outer(dp / duration, span))


# p and p' at s, each of the shape of s
PROFILES: dict[Profile, Callable[[Vector], tuple[Vector, Vector]]] = {
    "cubic": lambda s: (s * s * (3.0 - 2.0 * s), 6.0 * s * (1.0 - s)),
    "quintic": lambda s: (
        s**3 * (10.0 + s * (6.0 * s - 15.0)),
        30.0 * s * s * (1.0 - s) ** 2,
    ),
}


def rigid_duration(model: Model, first: Vector, last: Vector, effort_limit: Vector) -> float:
    """Return the least time for a rigid body, 2 sqrt(J d/u) of the slowest joint [s].

    J is the smaller one of the inertias at the start and at the goal.

    Args:
        model: what is turned.
        first, last: where the joints rest, shape (joints,) [rad or m].
        effort_limit: shape (joints,) [N m or N].
    """
    modes = np.zeros(model.modes)
    inertia = np.minimum(
        *(np.diag(model.mass_matrix(np.concatenate((q, modes)))) for q in (first, last))
    )[: model.joints]
    return float((2.0 * np.sqrt(inertia * np.abs(last - first) / effort_limit)).max())


def rounded_up(value: float) -> float:
    """Return the next number with three significant digits, which a message prints in full."""
    unit = 10.0 ** (np.floor(np.log10(value)) - 2.0)
    return float(f"{np.ceil(value / unit) * unit:.3g}")
