"""What the imbalance of reaction wheels does to a free platform.

Of a harmonic k of a wheel at the angle p and the speed W against the platform, across its axis
(Masterson, Miller and Grogan 2002):
    F = C_k W^2 (e1 cos(k p + a) + e2 sin(k p + a)),  at its place,   T = D_k W^2 (likewise),
e1, e2 and the axis an orthonormal triad. Static and dynamic imbalance are harmonics of order 1.
"""

from collections.abc import Callable, Mapping

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.attitude import cross
from flexslew_plant.testbeds.spacecraft.assembly.craft import Spacecraft
from flexslew_plant.testbeds.spacecraft.settings import Harmonic, WheelSettings
from flexslew_plant.testbeds.spacecraft.units import Units

_PLATFORM_Q, _PLATFORM_V = 7, 6  # entries of a free platform in q and v


def harmonics_of(wheel: WheelSettings) -> tuple[Harmonic, ...]:
    """Return all that a wheel's disturbance consists of."""
    static, dynamic = wheel.static_imbalance, wheel.dynamic_imbalance
    first = (Harmonic(order=1.0, force=static, torque=dynamic),) if static or dynamic else ()
    return first + wheel.harmonics


def imbalance_forces(
    craft: Spacecraft, wheels: Mapping[str, WheelSettings], units: Units
) -> Callable[[Vector, float, float], Vector] | None:
    """Return what gives the generalised forces of the wheels; None: all are balanced.

    Args:
        craft: the spacecraft.
        wheels: its wheels' settings.
        units: in which they are written.
    """
    rows, planes = [], []
    for index, (wheel, known) in enumerate(zip(wheels.values(), craft.wheels, strict=True)):
        for one in harmonics_of(wheel):
            force, torque = one.force * units.force, one.torque * units.torque
            place = np.array(wheel.place) * units.length
            rows.append((index, one.order, one.force_phase, one.torque_phase))
            across = _across(known.axis)
            push = force * across
            planes.append((push, np.cross(place, push), torque * across))
    if not rows:
        return None
    table = np.array(rows)
    which, order = table[:, 0].astype(np.int64), table[:, 1]
    force_phase, torque_phase = table[:, 2], table[:, 3]
    pushes, levers, torques = (np.array([plane[k] for plane in planes]) for k in range(3))
    positions, rates = craft.sizes
    angle = _PLATFORM_Q + len(craft.hinged) + which
    speed = positions + _PLATFORM_V + len(craft.hinged) + which

    def forces(x: Vector, t: float, span: float) -> Vector:
        """Return the mean from t to t + span of what turns at the speeds of the state at t."""
        half = 0.5 * order * x[speed] * span
        middle = order * x[angle] + half
        size = x[speed] ** 2 * np.sinc(half / np.pi)
        found = np.zeros(rates)
        found[:3] = _turned(size, middle + force_phase, pushes)
        found[3:6] = _turned(size, middle + force_phase, levers)
        found[3:6] += _turned(size, middle + torque_phase, torques)
        return found

    return forces


def _turned(size: Vector, phase: Vector, planes: Matrix) -> Vector:
    """Return the sum of size (a cos phase + b sin phase), shape (3,).

    Args:
        size: of each harmonic, shape (harmonics,).
        phase: likewise [rad].
        planes: a and b of each, shape (harmonics, 2, 3).
    """
    found: Vector = (size * np.cos(phase)) @ planes[:, 0] + (size * np.sin(phase)) @ planes[:, 1]
    return found


def _across(axis: Vector) -> Matrix:
    """Return e1 and e2, which with the axis are right-handed, shape (2, 3)."""
    along = np.eye(3)[0 if abs(axis[0]) < np.sqrt(0.5) else 1]
    first = along - (along @ axis) * axis
    first = first / np.linalg.norm(first)
    return np.array([first, cross(axis, first)])
